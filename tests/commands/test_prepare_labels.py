"""`prepare labels` from a folder of images to files that train, mostly with landmarks of a file."""

import csv
import json
import logging
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from omegaconf import open_dict

from hand_recon.data.dataset import load_batch
from hand_recon.data.landmarks.files import read_landmarks
from hand_recon.data.landmarks.parsed import Assumptions
from hand_recon.data.photos.photo import read_photo
from hand_recon.detection.copy_votes import CopyVotes
from hand_recon.detection.mediapipe import MediaPipeDetector
from hand_recon.runs import preparation as prepare
from hand_recon.runs.building import build_data
from hand_recon.runs.labelling.labeller import build_label_detector
from hand_recon.runs.training_run import train
from tests.support.configurations import composed, settings
from tests.support.detector_models import published_models
from tests.support.labels_command import asked
from tests.support.small_runs import LIGHTNING_WARNINGS

EXAMPLES = Path(__file__).parents[2] / "examples"


def content(path: Path) -> dict[str, Any]:
    read: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return read


def test_sure_and_doubtful_hands_go_to_two_files_and_a_damaged_image_is_named(
    folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    summary = prepare.prepare(asked(folder, "fit=true", "sheets=5"))
    assert summary["images"] == 4
    assert summary["damaged"] == ["4 cut off.png"]
    assert summary["without_hands"] == 1
    assert (summary["hands"], summary["kept"], summary["doubtful"]) == (3, 1, 2)
    assert summary["marks"] == {"several hands": 2}
    out = folder / "out"
    sure, doubtful = content(out / "labels.json"), content(out / "doubtful.json")
    assert [hand["image"] for hand in sure["hands"]] == ["3 hånd's, [left].png"]
    assert [hand["image"] for hand in doubtful["hands"]] == ["1 two.png"] * 2
    assert [list(marks) for marks in doubtful["marks"]] == [["several hands"]] * 2
    given = json.loads((folder / "found.json").read_text(encoding="utf-8"))
    np.testing.assert_allclose(sure["hands"][0]["landmarks"], given[2]["landmarks"], atol=0.00501)
    assert sure["hands"][0]["side"] == "left"
    assert "4 cut off.png" in caplog.text
    pages = sorted(path.name for path in (out / "sheets").iterdir())
    assert pages == ["doubtful_1.png", "sure_1.png"]
    with (out / "hands.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["hand"] for row in rows] == ["1", "2", "", "1", ""]
    assert "cut off" in rows[4]["error"]
    left = {path.name for path in out.iterdir()}
    assert left == {"labels.json", "doubtful.json", "hands.csv", "config.yaml", "sheets"}


def test_keep_all_has_every_hand_and_still_names_the_doubtful_ones(folder: Path) -> None:
    summary = prepare.prepare(asked(folder, "keep=all"))
    assert (summary["kept"], summary["doubtful"]) == (3, 2)
    assert len(content(folder / "out" / "labels.json")["hands"]) == 3
    assert len(content(folder / "out" / "doubtful.json")["hands"]) == 2


def test_exchanged_fingers_are_marked_by_the_fit(folder: Path) -> None:
    entries = json.loads((folder / "found.json").read_text(encoding="utf-8"))
    points = entries[2]["landmarks"]
    points[5:9], points[17:21] = points[17:21], points[5:9]
    (folder / "found.json").write_text(json.dumps(entries[2:]), encoding="utf-8")
    with pytest.raises(ValueError, match=r"All 1 hands are doubtful.*keep=all"):
        prepare.prepare(asked(folder, "fit=true"))
    (marks,) = content(folder / "out" / "doubtful.json")["marks"]
    assert marks
    assert all(name.startswith("fit: ") for name in marks)
    assert not (folder / "out" / "labels.json").exists()
    # The result is complete: the command does not go on in it.
    assert not (folder / "out" / "unfinished.json").exists()


def test_exports_have_all_hands_the_doubtful_ones_first(folder: Path) -> None:
    summary = prepare.prepare(asked(folder, "export=[cvat,label_studio]"))
    names = [Path(path).name for path in summary["written"]]
    assert names == [
        "cvat_annotations.xml", "cvat_labels.json", "label_studio_tasks.json", "label_studio_interface.xml",
    ]  # fmt: skip
    for name in (names[0], names[2]):
        assumed = Assumptions(side=None, images=folder / "photos")
        found = read_landmarks(folder / "out" / name, assumed=assumed)
        assert [image.name for image in found.images if image] == ["1 two.png"] * 2 + [
            "3 hånd's, [left].png"
        ]
        assert found.left.tolist() == [False, False, True]


def test_the_labels_are_checked_as_they_are_and_sigma_reaches_the_batches(
    folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    entries = json.loads((folder / "found.json").read_text(encoding="utf-8"))
    for entry in entries:
        entry["sigma"] = [2.0] * 21
    (folder / "found.json").write_text(json.dumps(entries), encoding="utf-8")
    prepare.prepare(asked(folder, "keep=all"))
    config = composed(
        "task=check", "data=landmarks", f"data.train='{folder}/out/labels.json'",
        f"data.images='{folder}/photos'", "data.val_fraction=0.3", f"data.val='{folder}/out/labels.json'",
        f"data.test='{folder}/out/labels.json'", "crop_size=64", "check.samples=2",
        name="prepare",
    )  # fmt: skip
    with open_dict(config):
        config.paths = {"cache": f"{folder}/cache", "output": str(folder), "run": f"{folder}/check"}
        del config["hydra"]
    caplog.clear()
    report = prepare.prepare(config)
    assert report.troubles == ()
    assert report.numbers["samples"] == 3
    assert report.numbers["left_hands_percent"] == pytest.approx(100 / 3)
    assert "are not read" not in caplog.text
    batch = load_batch(build_data(config).dataset("train"), [0, 1, 2])
    assert batch.label_noise is not None
    for hand, entry in enumerate(entries):
        # Pixels of the crop per pixel of the image, by the length of a bone.
        both = (batch.landmarks_2d[hand].tolist(), entry["landmarks"])
        bones = [np.subtract(points[9], points[0]) for points in both]
        scale = np.linalg.norm(bones[0]) / np.linalg.norm(bones[1])
        np.testing.assert_allclose(batch.label_noise[hand].numpy(), 2 * scale, rtol=1e-3)


@LIGHTNING_WARNINGS
def test_the_labels_train_as_they_are(folder: Path) -> None:
    prepare.prepare(asked(folder, "keep=all"))
    labels = folder / "out" / "labels.json"
    options = [
        "data=landmarks", f"data.images='{folder}/photos'", "data.landmark_set=mediapipe",
        "data.batch_size=3", "data.reading.workers=1", "model.encoder.backbone=mobilenet_v3_small",
        "model.width=32", "trainer.max_epochs=1", "trainer.accelerator=cpu", "threads=1", "report.images=1",
        "crop_size=48",
        *(f"data.{split}='{labels}'" for split in ("train", "val", "test")),
    ]  # fmt: skip
    metrics = train(settings(folder / "cache", folder / "run", *options))
    assert (metrics["data"], metrics["landmarks"], metrics["test_hands"]) == (
        "landmarks",
        "mediapipe",
        3,
    )
    assert {"E_2D", "PCK@0.05"} <= set(metrics["test"])


@pytest.mark.slow
def test_the_command_line_takes_the_folder_by_position_whatever_it_is_called(folder: Path) -> None:
    # Also like another task.
    (folder / "photos").rename(folder / "mano")
    words = [
        sys.executable, "-m", "hand_recon", "prepare", "labels", "mano", "--output", "my labels", "--keep",
        "all", "detector=landmarks", "detector.landmarks=found.json", "fit=false", "sheets=0",
    ]  # fmt: skip
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)  # noqa: S603
    assert done.returncode == 0, done.stderr
    assert len(content(folder / "my labels" / "labels.json")["hands"]) == 3
    assert "several hands" in done.stderr
    assert done.stdout == ""
    assert not (folder / "outputs").exists()


def test_labels_of_photographs_are_what_the_detector_says_to_the_rounding(tmp_path: Path) -> None:
    models = published_models()
    config = composed(
        f"images='{EXAMPLES}'", f"output='{tmp_path}/out'", f"detector.models='{models}'", "copies=2",
        "sheets=0", "keep=all", name="prepare_labels",
    )  # fmt: skip
    with open_dict(config):
        del config["hydra"]
    summary = prepare.prepare(config)
    assert summary["images"] == 2
    assert summary["marks"]["several hands"] == 2
    assert not {"low score", "uncertain landmarks", "outside the image"} & set(summary["marks"])
    read = read_landmarks(
        tmp_path / "out" / "labels.json", assumed=Assumptions(side=None, images=EXAMPLES)
    )
    detector = MediaPipeDetector(copies=2, models=models)
    detector.noise = CopyVotes(2)
    expected = [
        (hand, EXAMPLES / name)
        for name in ("hand.jpg", "two_hands.jpg")
        for hand in detector(read_photo(EXAMPLES / name).pixels).hands
    ]
    assert len(read) == len(expected) == 3
    assert read.sigma is not None
    scores = content(tmp_path / "out" / "labels.json")["scores"]
    for number, (hand, image) in enumerate(expected):
        assert read.images[number] == image
        assert bool(read.left[number]) == (hand.side == "left")
        np.testing.assert_allclose(
            read.landmarks_2d[number].numpy(), hand.landmarks_2d, atol=0.00501
        )
        assert hand.sigma is not None
        np.testing.assert_allclose(read.sigma[number].numpy(), hand.sigma, atol=0.000501)
        assert scores[number] == pytest.approx(hand.score, abs=0.00006)


def test_the_detector_of_labels_votes_with_as_many_copies_as_asked_for() -> None:
    config = composed("images=/nowhere", "copies=3", name="prepare_labels")
    detector = build_label_detector(config)
    assert isinstance(detector, MediaPipeDetector)
    assert isinstance(detector.noise, CopyVotes)
    assert detector.noise.copies == 3
