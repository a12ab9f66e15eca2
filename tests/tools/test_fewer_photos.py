"""Curves of the error over the number of photographs."""

from pathlib import Path

import pytest

from draw_fewer_photos import curves_of, draw
from hand_recon.tables.runs import FinishedRun, read_run
from tests.support.runs_on_disk import write_run


def finished(folder: Path, size: int | None, weights: str, **scores: float) -> FinishedRun:
    config = {
        "name": "photos_table1", "seed": 0, "photos": {"train_size": size},
        "model": {"encoder": {"weights": weights}},
    }  # fmt: skip
    run = read_run(write_run(folder, config, scores))
    assert isinstance(run, FinishedRun)
    return run


def test_runs_are_sorted_into_curves_by_their_first_weights(tmp_path: Path) -> None:
    runs = [
        finished(tmp_path / "0", None, "imagenet", E_2D=8.0),
        finished(tmp_path / "1", 700, "imagenet", E_2D=12.0),
        finished(tmp_path / "2", 700, "none", E_2D=30.0),
    ]
    curves = curves_of(runs, every=11860)
    assert curves == {"imagenet": [(700, 12.0), (11860, 8.0)], "none": [(700, 30.0)]}
    axes = draw(curves).axes[0]
    assert sorted(text.get_text() for text in axes.texts) == ["12.0", "30.0", "8.0"]
    assert [label.get_text() for label in axes.get_xticklabels()] == ["700", "11,860"]


def test_a_run_that_was_not_tested_on_photographs_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"has no E_2D; expected runs tested on photographs"):
        curves_of([finished(tmp_path / "0", 700, "none", E_J=9.0)], every=11860)
