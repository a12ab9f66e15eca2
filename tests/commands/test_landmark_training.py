"""The main job on pictures that have 2D landmarks alone, and on such pictures beside FreiHAND's."""

import json
import logging
from pathlib import Path

import pytest

from hand_recon.rehearsal.freihand import FreiHandFolder, write_freihand_layout
from hand_recon.runs.evaluation_run import evaluate
from hand_recon.runs.training_run import train
from tests.support.configurations import settings
from tests.support.dotted_images import Dotted
from tests.support.small_runs import LIGHTNING_WARNINGS

pytestmark = LIGHTNING_WARNINGS

SMALL = (
    "model.encoder.backbone=mobilenet_v3_small", "model.width=32", "trainer.max_epochs=1",
    "trainer.accelerator=cpu", "threads=1", "report.images=2", "crop_size=48", "data.batch_size=6",
)  # fmt: skip


def test_pictures_with_2d_landmarks_alone_train_and_are_scored_in_2d(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = Dotted(tmp_path / "images", images=8).as_coco()
    data = ["data=landmarks", f"data.train={path}", "data.reading.workers=1"]
    folder = tmp_path / "run"
    metrics = train(settings(tmp_path / "cache", folder, *SMALL, *data))
    scores = metrics["test"]
    # 12 hands of 6 pictures train in two steps; 2 hands of a picture test.
    assert (metrics["data"], metrics["landmarks"], metrics["test_hands"]) == (
        "landmarks",
        "knuckle",
        2,
    )
    assert {"E_2D", "PCK@0.05", "PCK@0.10", "PCK@0.15"} <= set(scores)
    assert not [name for name in scores if name.startswith(("E_J", "E_V", "AUC", "F@", "MPJPE"))]
    assert metrics["mean_pose"] == {}
    assert json.loads((folder / "metrics.json").read_text())["test"] == scores
    assert (folder / "report.html").stat().st_size > 0
    assert len(list((folder / "overlays").glob("*.png"))) == 2
    assert "testing on 2 held-out hands" in caplog.text
    again = evaluate(
        settings(
            tmp_path / "cache", tmp_path / "again", f"ckpt={folder}", "threads=1", name="evaluate"
        )
    )
    assert again["test"] == pytest.approx(scores, rel=1e-6)


@pytest.mark.slow
def test_a_mixture_trains_on_both_and_is_scored_on_one(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    root = tmp_path / "FreiHAND"
    write_freihand_layout(root, FreiHandFolder(unique=8, evaluation=4))
    path = Dotted(tmp_path / "images", images=6).as_coco()
    data = [
        "data=mixture", f"data.parts.freihand.root={root}", f"data.parts.landmarks.train={path}",
        "data.parts.freihand.crop.around=joints", "data.epoch_size=12", "model.use_intrinsics=true",
        "data.parts.freihand.reading.workers=1", "data.parts.landmarks.reading.workers=1",
        # Needs hands with 3D in every batch, known or not.
        "supervision=landmarks_3d",
    ]  # fmt: skip
    with caplog.at_level(logging.INFO):
        metrics = train(settings(tmp_path / "cache", tmp_path / "run", *SMALL, *data))
    assert (metrics["data"], metrics["landmarks"], metrics["test_hands"]) == ("freihand", "mano", 4)
    assert {"E_J", "E_2D"} <= set(metrics["test"])
    assert "E_J" in metrics["mean_pose"]
    assert "landmarks: 6 of 12 hands of an epoch" in caplog.text
    assert "The labels of landmarks follow the landmark set knuckle" in caplog.text
