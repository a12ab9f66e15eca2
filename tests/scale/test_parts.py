"""Part files: complete or absent, no row lost or doubled."""

import random
from pathlib import Path

import pytest

pytest.importorskip("pyarrow")

import pyarrow.parquet
from hypothesis import given, settings
from hypothesis import strategies as st

from hand_recon.scale.parts import PartFiles
from hand_recon.scale.schema import image_type

FIELDS = ("hands", "width", "height", "error")


def batch(rows: list[int]) -> "pyarrow.Table":
    """Results of some rows; every third image failed, the others have a doubtful hand."""
    hand = {"handedness": "left", "verdict": "doubtful"}
    found = [
        {"hands": None, "error": "damaged"} if row % 3 == 0 else {"hands": [hand], "width": row}
        for row in rows
    ]
    column = pyarrow.array(found, image_type())
    return pyarrow.table({"row": rows} | {name: column.field(name) for name in FIELDS})


def rows_in(folder: Path) -> list[int]:
    parts = sorted(folder.glob("part-*.parquet"))
    return [row for part in parts for row in pyarrow.parquet.read_table(part)["row"].to_pylist()]


@settings(max_examples=5)
@given(st.randoms(use_true_random=False), st.integers(1, 30), st.integers(1, 9))
def test_rows_in_any_order_and_twice_come_out_once_and_in_order(
    tmp_path_factory: pytest.TempPathFactory, order: random.Random, rows: int, size: int
) -> None:
    folder = tmp_path_factory.mktemp("parts")
    parts = PartFiles(folder, rows, size)
    given_rows = [*range(rows), *(order.randrange(rows) for _ in range(5))]
    order.shuffle(given_rows)
    written = []
    for start in range(0, len(given_rows), 4):
        written += list(parts.add(batch(given_rows[start : start + 4])))
    assert sorted(written) == list(range(-(-rows // size)))
    assert parts.missing() == []
    assert rows_in(folder) == list(range(rows))
    failed = len(range(0, rows, 3))
    counted = {"images": rows, "failed": failed, "hands": rows - failed}
    assert parts.summary().items() >= counted.items()
    assert parts.summary()["doubtful"] == rows - failed


def test_a_killed_command_leaves_whole_parts_alone(tmp_path: Path) -> None:
    parts = PartFiles(tmp_path, 10, 4)
    assert list(parts.add(batch([4, 5, 6, 7, 0, 1]))) == [1]
    (tmp_path / ".part-00000.parquet.unfinished").write_bytes(b"PAR1 half")
    again = PartFiles(tmp_path, 10, 4)
    assert again.missing() == [0, 2]
    assert not list(tmp_path.glob(".*"))
    assert list(again.add(batch([0, 1, 2, 5, 3, 9]))) == [0]
    again.forget()
    assert list(again.add(batch([8]))) == []
    assert list(again.add(batch([9]))) == [2]
    assert rows_in(tmp_path) == list(range(10))


def test_a_file_of_another_command_is_neither_counted_nor_overwritten(tmp_path: Path) -> None:
    pyarrow.parquet.write_table(batch([0, 1, 2]), tmp_path / "part-00000.parquet")
    with pytest.raises(
        ValueError, match="has 3 rows that are not those of this part; expected rows 0 to 3"
    ):
        PartFiles(tmp_path, 10, 4)
    late = PartFiles(tmp_path / "new", 2, 2)
    (tmp_path / "new").mkdir()
    (tmp_path / "new" / "part-00000.parquet").write_bytes(b"mine")
    with pytest.raises(FileExistsError, match="is not overwritten"):
        list(late.add(batch([0, 1])))
    assert (tmp_path / "new" / "part-00000.parquet").read_bytes() == b"mine"
