"""`prepare labels` that is refused, interrupted or run again, and images that it does not use."""

import csv
import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hand_recon.runs import looking
from hand_recon.runs import preparation as prepare
from hand_recon.runs.labelling import label_run, labeller
from tests.support.labels_command import asked


def test_too_many_damaged_images_end_the_command_which_goes_on_with_a_higher_limit(
    folder: Path,
) -> None:
    with pytest.raises(
        ValueError, match=r"1 images cannot be used, more than max_damaged=0: 4 cut"
    ):
        prepare.prepare(asked(folder, "max_damaged=0"))
    assert not (folder / "out" / "labels.json").exists()
    assert prepare.prepare(asked(folder, "max_damaged=1"))["hands"] == 3


def test_an_image_that_training_reads_otherwise_is_not_used(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Such as a format that OpenCV cannot read, or whose orientation it does not apply."""
    lying = np.zeros((640, 480, 3), dtype=np.uint8)
    monkeypatch.setattr(labeller, "read_image", lambda path: None if "1" in path.name else lying)
    with pytest.raises(ValueError, match=r"No hand was found in 4 images"):
        prepare.prepare(asked(folder))
    with (folder / "out" / "hands.csv").open(encoding="utf-8", newline="") as stream:
        errors = [row["error"] for row in csv.DictReader(stream)]
    assert all("training cannot read it upright" in error for error in errors[:3])


def test_results_are_not_overwritten_and_options_are_checked_first(folder: Path) -> None:
    for wrong, match in (
        ("keep=some", r"Unknown keep=some; choose one of \['sure', 'all'\]"),
        ("export=coco", "Unknown export=coco; choose cvat, label_studio"),
        ("images=null", "No folder of images is named"),
        ("limits.min_score=2", r"Expected limits\.min_score from 0 to 1"),
    ):
        with pytest.raises(ValueError, match=match):
            prepare.prepare(asked(folder, wrong))
    with pytest.raises(ValueError, match="is no folder"):
        prepare.prepare(asked(folder, f"images='{folder}/found.json'"))
    assert not (folder / "out").exists()
    prepare.prepare(asked(folder))
    before = (folder / "out" / "labels.json").read_bytes()
    with pytest.raises(
        FileExistsError, match=r"already holds labels\.json.* nothing is overwritten"
    ):
        prepare.prepare(asked(folder, "keep=all"))
    assert (folder / "out" / "labels.json").read_bytes() == before


def test_an_interrupted_command_goes_on_where_it_was(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(label_run, "IMAGES_AT_ONCE", 1)
    prepare.prepare(asked(folder, f"output='{folder}/whole'"))
    real, looks = looking.look_at_file, itertools.count()

    def interrupted(*arguments: Any) -> Any:  # noqa: ANN401
        if next(looks) in {0, 3}:
            raise KeyboardInterrupt
        return real(*arguments)

    monkeypatch.setattr(labeller, "look_at_file", interrupted)
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            prepare.prepare(asked(folder))
    out = folder / "out"
    assert len((out / "progress.jsonl").read_text(encoding="utf-8").splitlines()) == 2
    with (out / "progress.jsonl").open("a", encoding="utf-8") as stream:
        stream.write('[{"image": "3')
    with pytest.raises(FileExistsError, match="unfinished results of a command with other options"):
        prepare.prepare(asked(folder, "limits.max_sigma=0.2"))
    prepare.prepare(asked(folder))
    # 1 + 3 looks until the second interruption, and the two images that were left.
    assert next(looks) == 6
    for name in ("labels.json", "doubtful.json", "hands.csv"):
        assert (out / name).read_bytes() == (folder / "whole" / name).read_bytes()


def test_own_sheets_below_the_images_are_no_images(folder: Path) -> None:
    inside = f"output='{folder}/photos/out'"
    assert prepare.prepare(asked(folder, inside, "sheets=5"))["images"] == 4
    assert list((folder / "photos" / "out" / "sheets").iterdir())
    assert prepare.prepare(asked(folder))["images"] == 4
