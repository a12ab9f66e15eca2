"""The suites of training images and of the start measure what they name."""

import subprocess
from pathlib import Path

import numpy as np
import pytest

from hand_recon.speed.measurement import Settings
from hand_recon.speed.rows import Row
from hand_recon.speed.suites import data, startup

QUICK = Settings(seconds=0.0, quick=True)


def test_the_data_suite_renders_each_level_and_reads_equal_crops(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(data, "BATCH", 3)
    rows = list(data.measure(QUICK))
    assert [row.work for row in rows] == [
        "rendering, easy", "rendering, medium", "rendering, hard",
        "crops from the map, 224 × 224 photograph", "crops from the map, 640 × 480 photograph",
        "batches from memory, 224 × 224 photograph",
    ]  # fmt: skip
    assert all(row.size == "64 px" for row in rows[:3])
    for row in rows[3:]:
        assert row.difference == "0 pixels"
        assert row.items == 3
        assert row.ratio is not None


def test_the_crops_show_the_hand_wherever_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(data, "BATCH", 2)
    hands = data.photographs(tmp_path, (640, 480))
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"{i:04d}.jpg" for i in range(4)]
    offsets = hands.landmarks_2d[1:] - hands.landmarks_2d[0]
    assert np.ptp(offsets, axis=1).max() < 1e-9
    assert (np.abs(offsets).max(axis=(1, 2)) > 1).all()


def test_the_first_step_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(startup, "FIRST_STEP", "import sys, time; time.sleep(0.5); print(sys.argv)")
    assert startup.seconds_to_first_step("seed=1") >= 0.5
    monkeypatch.setattr(startup, "FIRST_STEP", "raise SystemExit('no step')")
    with pytest.raises(subprocess.CalledProcessError):
        startup.seconds_to_first_step()


def test_a_quick_start_leaves_the_training_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(startup, "COMMANDS", {"nothing": ("-c", "")})
    row, left_out = startup.measure(QUICK)
    assert isinstance(row, Row)
    assert left_out.work == "train to the first step"


@pytest.mark.slow
def test_the_default_training_takes_a_step(tmp_path: Path) -> None:
    small = ("synthetic.train=64", "synthetic.val=8", "data.batch_size=8", "threads=1")
    assert startup.seconds_to_first_step(*small) > 1
