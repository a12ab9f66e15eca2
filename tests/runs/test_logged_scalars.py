"""Logged scalars of two runs are compared step by step, and a difference is told with its size."""

import json
import math
from pathlib import Path

import pytest

from hand_recon.runs.logged_scalars import compare_logs


def run(folder: Path, *lines: str, test: dict[str, float] | None = None) -> Path:
    """A run's folder with a table of scalars."""
    (folder / "csv").mkdir(parents=True)
    (folder / "csv" / "metrics.csv").write_text("\n".join(("step,epoch,loss,val", *lines)) + "\n")
    if test is not None:
        (folder / "metrics.json").write_text(json.dumps({"test": test}))
    return folder


def test_equal_logs_are_the_same_bit_for_bit(tmp_path: Path) -> None:
    lines = ("0,0,0.1,", "1,0,0.30000000000000004,", "1,0,,2.5")
    scores = {"E_J": 8.0, "E_V": math.nan}
    found = compare_logs(
        run(tmp_path / "a", *lines, test=scores), run(tmp_path / "b", *lines, test=scores)
    )
    assert found.same
    # Epoch and loss of two steps, the validation's score, and two test scores.
    assert (found.steps, found.values) == (3, 7)
    assert found.told() == "Same, bit for bit: 7 values of 3 steps."


def test_the_last_bit_of_a_loss_is_a_difference_and_its_step_is_told(tmp_path: Path) -> None:
    first = run(tmp_path / "a", "0,0,0.1,", "1,0,0.3,", "2,0,4.0,")
    second = run(tmp_path / "b", "0,0,0.1,", "1,0,0.30000000000000004,", "2,0,4.5,")
    found = compare_logs(first, second)
    assert not found.same
    assert [(one.step, one.name) for one in found.differences] == [(1, "loss"), (2, "loss")]
    assert found.differences[0].size == pytest.approx(5.55e-17, rel=0.01)
    assert "from step 1 on, where loss was 0.3 and is 0.30000000000000004" in found.told()
    assert "2 of 6 values differ, most loss at step 2, by 0.5." in found.told()


def test_other_test_scores_are_a_difference_after_the_last_step(tmp_path: Path) -> None:
    first = run(tmp_path / "a", "7,0,0.1,", test={"E_J": 8.0})
    second = run(tmp_path / "b", "7,0,0.1,", test={"E_J": 8.5})
    (only,) = compare_logs(first, second).differences
    assert (only.step, only.name, only.was, only.now) == (8, "test/E_J", 8.0, 8.5)


def test_an_interrupted_run_is_compared_as_far_as_it_came(tmp_path: Path) -> None:
    first = run(tmp_path / "a", "0,0,0.1,")
    second = run(tmp_path / "b", "0,0,0.1,", "1,0,0.2,", test={"E_J": 8.0})
    found = compare_logs(first, second)
    assert found.same
    assert found.told().endswith("as far as the earlier run came.")


def test_a_missing_step_and_a_run_without_a_log_are_not_the_same(tmp_path: Path) -> None:
    first = run(tmp_path / "a", "0,0,0.1,", "1,0,0.2,")
    second = run(tmp_path / "b", "0,0,0.1,")
    found = compare_logs(first, second)
    assert [one.step for one in found.differences] == [1, 1]
    assert found.differences[0].size == math.inf
    (tmp_path / "c").mkdir()
    nothing = compare_logs(tmp_path / "c", second)
    assert not nothing.same
    assert "nothing that could be compared" in nothing.told()
