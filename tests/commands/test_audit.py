"""`hand-recon audit` from files to a report, and repaired hands."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from jsonschema import validate
from omegaconf import DictConfig, open_dict

from hand_recon.fitting.hands_file import read_hands
from hand_recon.hand.model import HandModel
from hand_recon.runs.audit.audit_run import audit
from tests.support.audited_hands import MIRROR, bent, natural_angles, points_of
from tests.support.configurations import composed

NATURAL = 5


def asked(files: object, folder: Path, *overrides: str) -> DictConfig:
    config = composed("threads=1", *overrides, name="audit")
    with open_dict(config):
        config.files = files
        config.output = str(folder)
        del config["hydra"]
    return config


@pytest.fixture(scope="module")
def points(hand: HandModel) -> torch.Tensor:
    """Natural hands, the first ones left, and one with its index finger bent backwards; millimetres."""
    found = torch.cat(
        [points_of(hand, natural_angles(NATURAL)), points_of(hand, bent(index_PIP_bend=-70))]
    )
    found[:2] *= MIRROR
    return 1000 * found


@pytest.fixture(scope="module")
def report(
    points: torch.Tensor, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, dict[str, Any]]:
    folder = tmp_path_factory.mktemp("audit")
    np.save(folder / "points.npy", points.numpy())
    config = asked(
        [str(folder / "points.npy")], folder / "out", "repair=true", "worst=2", "same_person=true"
    )
    return folder / "out", audit(config)


def test_the_report_finds_the_one_hand(report: tuple[Path, dict[str, Any]]) -> None:
    folder, summary = report
    assert (summary["hands"], summary["implausible"]) == (NATURAL + 1, 1)
    written = json.loads((folder / "audit.json").read_text())
    assert {key: value for key, value in summary.items() if key != "repair"} == pytest.approx(
        written["summary"], abs=1e-3
    )
    worst = written["hands"][-1]
    assert worst["verdict"] == "implausible"
    first = worst["range_violations"][0]
    assert (first["joint"], first["axis"]) == ("index PIP", "bend")
    assert first["beyond_degrees"] == pytest.approx(-60, abs=5)
    assert [hand["side"] for hand in written["hands"][:3]] == ["left", "left", "right"]
    assert any("millimetres" in note for note in written["notes"])
    assert written["sequences"][0]["frames"] == NATURAL + 1


def test_the_table_has_a_row_per_hand(report: tuple[Path, dict[str, Any]]) -> None:
    with (report[0] / "audit.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == NATURAL + 1
    assert rows[-1]["range_joint"] == "index PIP"
    assert float(rows[-1]["index_PIP_bend_degrees"]) == pytest.approx(-70, abs=5)
    assert float(rows[-1]["range_degrees"]) < -50


def test_the_page_shows_the_worst_hand_first(report: tuple[Path, dict[str, Any]]) -> None:
    page = (report[0] / "index.html").read_text()
    assert page.index("1. 5 (points.npy, right hand)") < page.index("2. ")
    assert "The bend of the index PIP is" in page
    assert (report[0] / "map.png").stat().st_size > 1000
    assert len(list((report[0] / "worst").glob("*.png"))) == 2


def test_repaired_hands_pass_the_same_audit(
    report: tuple[Path, dict[str, Any]], tmp_path: Path
) -> None:
    folder, summary = report
    assert summary["repair"]["violating_percent_after"] == 0.0
    hands = read_hands(folder / "repaired" / "hands.json")
    assert hands.sides[:3] == ("left", "left", "right")
    assert set(hands.verdicts) == {"plausible"}
    schema = json.loads(
        (Path(__file__).parents[2] / "hand_recon" / "fitting" / "hands.schema.json").read_text()
    )
    validate(json.loads((folder / "repaired" / "hands.json").read_text()), schema)
    again = audit(asked([str(folder / "repaired")], tmp_path / "again", "worst=0"))
    assert again["angles_given"] == NATURAL + 1
    assert again["implausible"] == 0
    assert again["worst_range_degrees_mean"] == 0.0
    assert again["worst_anatomy_degrees_mean"] == 0.0
    assert again["penetration_rate_percent"] == 0.0


def test_strict_ends_with_status_1_without_any_hand_that_was_audited(tmp_path: Path) -> None:
    np.save(tmp_path / "zeros.npy", np.zeros((2, 21, 3)))
    with pytest.raises(SystemExit) as raised:
        audit(asked([str(tmp_path / "zeros.npy")], tmp_path / "out", "strict=true", "worst=0"))
    assert raised.value.code == 1


def test_strict_ends_with_status_1_and_writes_the_report(
    points: torch.Tensor, tmp_path: Path
) -> None:
    np.save(tmp_path / "points.npy", points[-1:].numpy())
    with pytest.raises(SystemExit) as raised:
        audit(asked([str(tmp_path / "points.npy")], tmp_path / "out", "strict=true", "worst=0"))
    assert raised.value.code == 1
    assert (tmp_path / "out" / "audit.json").is_file()
    # Nothing is overwritten.
    with pytest.raises(
        FileExistsError, match=r"already holds audit\.json, audit\.csv, index\.html"
    ):
        audit(asked([str(tmp_path / "points.npy")], tmp_path / "out", "worst=0"))


def test_another_table_gives_other_findings(points: torch.Tensor, tmp_path: Path) -> None:
    """The index PIP may overstretch by 10° in the literature, and not with the constants of the paper."""
    np.save(tmp_path / "points.npy", points[-1:].numpy())
    found = [
        audit(asked([str(tmp_path)], tmp_path / table, "worst=0", f"ranges={table}"))
        for table in ("literature", "paper_release")
    ]
    least = [one["worst_range_degrees_mean"] for one in found]
    assert least[1] - least[0] == pytest.approx(10, abs=0.5)


def test_manos_hands_without_mano_are_audited_and_not_repaired(
    report: tuple[Path, dict[str, Any]], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    text = (report[0] / "repaired" / "hands.json").read_text()
    (tmp_path / "hands.json").write_text(text.replace('"open"', '"mano"'))
    found = audit(asked([str(tmp_path)], tmp_path / "out", "worst=0", "repair=true"))
    assert found["audited"] == NATURAL + 1
    assert found["penetration_rate_percent"] is None
    assert found["repair"]["hands"] == 0
    assert "Give hand=mano for these" in caplog.text
    assert set(read_hands(tmp_path / "out" / "repaired" / "hands.json").verdicts) == {"not fitted"}


def test_without_files_the_command_says_what_to_type(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"No file was given\. Type hand-recon audit"):
        audit(asked([], tmp_path))


def test_no_file_of_another_run_is_replaced(points: torch.Tensor, tmp_path: Path) -> None:
    np.save(tmp_path / "points.npy", points.numpy())
    (tmp_path / "config.yaml").write_text("mine")
    with pytest.raises(
        FileExistsError, match=r"already holds config\.yaml, and nothing is overwritten"
    ):
        audit(asked([str(tmp_path / "points.npy")], tmp_path))
    assert (tmp_path / "config.yaml").read_text() == "mine"


def test_brackets_in_names_of_files_are_no_markup(
    points: torch.Tensor, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "[bold]").mkdir()
    np.save(tmp_path / "[bold]" / "[.npy", points.numpy())
    name = str(tmp_path / "[bold]" / "[.npy")
    audit(asked([name], tmp_path / "out", "worst=0", "same_person=true"))
    assert "[bold]" in "".join(capsys.readouterr().out.split()).replace("│", "")


def test_bytes_of_file_names_that_are_no_letters_become_escapes(
    points: torch.Tensor, tmp_path: Path
) -> None:
    folder = tmp_path / "poses"
    folder.mkdir()
    np.save(folder / "b\udcff.npy", points.numpy())
    report = tmp_path / "out"
    audit(asked([str(folder)], report, "worst=1"))
    (entry, *_) = json.loads((report / "audit.json").read_text())["hands"]
    assert entry["file"].endswith("b\udcff.npy")
    assert "b\\udcff.npy" in (report / "index.html").read_text()
    assert "b\\udcff.npy" in (report / "audit.csv").read_text()
