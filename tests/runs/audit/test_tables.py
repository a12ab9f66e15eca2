"""Tables of hands as spreadsheets and other programs save them."""

from pathlib import Path

import pytest
import torch

from hand_recon.hand.model import HandModel
from hand_recon.runs.audit.tables import read_table
from tests.support.audited_hands import natural_angles, points_of

COUNT = 3
NAMES = [f"{axis}{i}" for i in range(21) for axis in "xyz"]


@pytest.fixture(scope="module")
def points(hand: HandModel) -> torch.Tensor:
    return points_of(hand, natural_angles(COUNT))


def lines_of(rows: list[list[object]]) -> str:
    return "".join(",".join(map(str, row)) + "\n" for row in rows)


def text_of(points: torch.Tensor, form: str) -> str:
    flat = points.flatten(1).tolist()
    by_axis = points.mT.flatten(1).tolist()
    single = points.flatten(0, 1).tolist()
    bare = lines_of(flat)
    return {
        "columns with numbers": lines_of([list(range(63)), *flat]),
        "an index and columns with numbers": lines_of(
            [["", *range(63)], *([i, *row] for i, row in enumerate(flat))]
        ),
        "a label behind": lines_of([[*row, "fist"] for row in flat]),
        "a named score behind": lines_of([[*NAMES, "score"], *([*row, 0.5] for row in flat)]),
        "all x first": lines_of([[f"{a}_{i}" for a in "xyz" for i in range(21)], *by_axis]),
        "pixels before metres": lines_of(
            [["u_px", "x_px", "y_px", "x_m", "y_m", "z_m"], *([1, 2, 3, *row] for row in single)]
        ),
        "a byte order mark": "\ufeff" + bare,
        "semicolons": bare.replace(",", ";"),
        "decimal commas": bare.replace(",", ";").replace(".", ","),
        "tabs": bare.replace(",", "\t"),
    }[form]


@pytest.mark.parametrize(
    "form",
    [
        "columns with numbers", "an index and columns with numbers", "a label behind",
        "a named score behind", "all x first", "pixels before metres", "a byte order mark",
        "semicolons", "decimal commas", "tabs",
    ],
)  # fmt: skip
def test_the_numbers_are_the_same_in_every_form(
    points: torch.Tensor, tmp_path: Path, form: str
) -> None:
    (tmp_path / "hands.csv").write_text(text_of(points, form), encoding="utf-8")
    found = read_table(tmp_path / "hands.csv").points
    assert found.shape == points.shape
    assert torch.allclose(found, points, atol=1e-6)


def test_a_hand_without_points_keeps_its_row(points: torch.Tensor, tmp_path: Path) -> None:
    (tmp_path / "hands.csv").write_text(lines_of([["nan"] * 63, *points.flatten(1).tolist()]))
    found = read_table(tmp_path / "hands.csv").points
    assert found[0].isnan().all()
    assert torch.allclose(found[1:], points, atol=1e-6)


def test_names_in_another_code_page_are_read(points: torch.Tensor, tmp_path: Path) -> None:
    text = lines_of([["händ", *NAMES], *(["1", *row] for row in points.flatten(1).tolist())])
    (tmp_path / "hands.csv").write_bytes(text.encode("latin-1"))
    assert torch.allclose(read_table(tmp_path / "hands.csv").points, points, atol=1e-6)


def test_rows_of_different_widths_are_named(tmp_path: Path) -> None:
    (tmp_path / "hands.csv").write_text(lines_of([[0.5] * 63, [0.5] * 62]))
    with pytest.raises(
        ValueError, match="row 2 has 62 cells and the first one 63; expected as many"
    ):
        read_table(tmp_path / "hands.csv")


def test_text_behind_other_numbers_is_refused(tmp_path: Path) -> None:
    (tmp_path / "hands.csv").write_text(lines_of([[7, *[0.5] * 63, "fist"]]))
    with pytest.raises(ValueError, match="text behind its numbers and 64 columns of numbers"):
        read_table(tmp_path / "hands.csv")


@pytest.mark.parametrize("quote", ["", '"'])
def test_a_table_of_names_alone_is_refused(tmp_path: Path, quote: str) -> None:
    """A quote that is not closed makes one cell of all that follows."""
    rows: list[list[object]] = [["x", "y", "z", f"{quote}score"]]
    rows += [[0.5] * 4 for _ in range(21 if quote else 0)]
    (tmp_path / "hands.csv").write_text(lines_of(rows))
    with pytest.raises(
        ValueError, match=r"hands\.csv has no rows of numbers; expected one or more hands\. Check"
    ):
        read_table(tmp_path / "hands.csv")
