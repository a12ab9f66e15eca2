"""Folders of runs are found, read or refused with a reason; hands are matched by index."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from hand_recon.tables.runs import FinishedRun, LeftOut, read_run, run_folders
from hand_recon.tables.studies import Compared, group, own_settings
from hand_recon.tables.summary import hand_means

COMPARED = Compared(method=("prior",), ignored=("name", "seed"))


def fitted(folder: Path, row: int, per_hand: str = "", seed: int = 0) -> Path:
    """A run without settings, whose metrics have its name and seed."""
    folder.mkdir(parents=True)
    metrics = {"name": f"ablation_row{row}", "seed": seed, "data": "views", "test": {"E_J": 10.0}}
    (folder / "metrics.json").write_text(json.dumps(metrics))
    if per_hand:
        (folder / "per_hand.csv").write_text(per_hand)
    return folder


def finished(folder: Path) -> FinishedRun:
    run = read_run(folder)
    assert isinstance(run, FinishedRun)
    return run


def test_neither_folders_inside_a_run_nor_hydras_copy_are_runs(tmp_path: Path) -> None:
    run = fitted(tmp_path / "a" / "b", 1)
    (run / "deeper").mkdir()
    (run / "deeper" / "metrics.json").write_text("{}")
    (tmp_path / "a" / ".hydra").mkdir()
    (tmp_path / "a" / ".hydra" / "config.yaml").write_text("seed: 1\n")
    assert run_folders([tmp_path]) == [run]
    assert run_folders([run]) == [run]
    assert run_folders([f"{tmp_path}/**/b", tmp_path]) == [run]


def test_a_run_without_settings_is_read_if_its_metrics_have_name_and_seed(tmp_path: Path) -> None:
    run = finished(fitted(tmp_path / "fit", 3, seed=7))
    assert (run.name, run.seed, run.settings) == ("ablation_row3", 7, {})
    assert run.facts["data"] == "views"


@pytest.mark.parametrize("content", ["E_J\n1\n", "index,E_J\n", "index,E_J\nx,1\n"])
def test_errors_of_hands_that_cannot_be_read_leave_the_run_out(
    tmp_path: Path, content: str
) -> None:
    run = read_run(fitted(tmp_path / "fit", 3, per_hand=content))
    assert isinstance(run, LeftOut)
    assert run.reason.startswith("unreadable")


def test_hands_are_matched_by_index_and_averaged_over_seeds(tmp_path: Path) -> None:
    """Hand 5 has no error in one run and hand 9 is in one only: 2 and 7 remain, averaged over two seeds."""
    fitted(tmp_path / "a", 1, "index,E_J\n7,30\n2,10\n5,50\n", seed=0)
    fitted(tmp_path / "b", 1, "index,E_J\n2,20\n5,60\n7,40\n9,1\n", seed=1)
    fitted(tmp_path / "c", 2, "index,E_J\n2,1\n5,\n7,2\n", seed=0)
    (study,), _ = group([finished(folder) for folder in run_folders([tmp_path])], COMPARED)
    first, second = study.row("ablation_row1"), study.row("ablation_row2")
    assert first is not None
    assert second is not None
    together = hand_means("E_J", first, second)
    assert together is not None
    np.testing.assert_allclose(together, [[15.0, 1.0], [35.0, 2.0]])
    alone = hand_means("E_J", first)
    assert alone is not None
    np.testing.assert_allclose(alone[:, 0], [15.0, 55.0, 35.0])
    assert hand_means("E_V", first) is None


def test_a_row_has_no_interval_unless_every_seed_has_errors_of_single_hands(tmp_path: Path) -> None:
    fitted(tmp_path / "a", 1, "index,E_J\n7,30\n", seed=0)
    fitted(tmp_path / "b", 1, seed=1)
    (study,), _ = group([finished(folder) for folder in run_folders([tmp_path])], COMPARED)
    row = study.row("ablation_row1")
    assert row is not None
    assert hand_means("E_J", row) is None


@pytest.mark.parametrize(
    ("name", "ignored"),
    [
        ("data.parts.freihand.seed", True),
        ("data.parts.more.reading.workers", True),
        ("data.parts.freihand.root", False),
        ("data.seeds", False),
        ("data.parts.seed", False),
        ("data", False),
    ],
)
def test_a_star_is_one_part_of_a_settings_name(tmp_path: Path, name: str, ignored: bool) -> None:
    folder = fitted(tmp_path / "run", 1)
    run = finished(folder)
    compared = Compared((), ("data.parts.*.seed", "data.parts.*.reading"))
    with_setting = dataclasses.replace(run, settings={name: "1"})
    assert ((name, "1") not in compared.study_of(with_setting)) == ignored


def test_a_part_is_one_word_in_the_name_of_a_row() -> None:
    physics = {
        ("prior.physics._target_", "package.terms.NonPenetrationTerm"),
        ("prior.physics.weight", "2.0"),
        ("prior.physics.inner._target_", "package.Inner"),
    }
    labels = ("supervision._target_", "package.Landmarks3D"), ("supervision.weight", "5.0")
    without = frozenset({("prior.physics", "None"), ("data_term", "nll"), *labels})
    tenth, whole = (
        frozenset({*physics, ("data_term", "nll"), *labels, ("supervision.fraction", share)})
        for share in ("0.1", "1.0")
    )
    plain = frozenset({*physics, ("data_term", "nll")})
    methods = [without, tenth, whole, plain]
    assert own_settings(tenth, methods) == (
        "prior.physics=NonPenetrationTerm",
        "supervision=Landmarks3D",
        "supervision.fraction=0.1",
    )
    assert own_settings(without, methods) == ("prior.physics=None", "supervision=Landmarks3D")
    assert own_settings(plain, methods) == ("prior.physics=NonPenetrationTerm",)
    assert own_settings(plain, [plain, frozenset({("data_term", "mse"), *physics})]) == (
        "data_term=nll",
    )
