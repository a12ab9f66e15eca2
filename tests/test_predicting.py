"""Files for the benchmarks: every test hand, in order, as it is."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import nn

from hand_recon.data.crop import CropPolicy
from hand_recon.data.datamodule import HandDataModule
from hand_recon.data.picture_hands import PictureHands, PictureRecipe
from hand_recon.data.synthetic.layouts.freihand import FreiHandFolder, write_freihand_layout
from hand_recon.evaluate import evaluate
from hand_recon.predicting import predict_test
from hand_recon.schema import HandBatch
from hand_recon.train import train
from tests.data.test_picture_hands import annotated
from tests.test_main_job import SMALL, pytestmark, settings

__all__ = ["pytestmark"]


class Oracle(nn.Module):
    """Predicts the truth of the crops that it is shown."""

    def forward(self, batch: HandBatch) -> HandBatch:
        return batch


def dots(root: Path) -> HandDataModule:
    """Three hands, of which two are left ones."""
    split = partial(PictureHands, annotated(root), recipe=PictureRecipe(CropPolicy(64)))
    return HandDataModule(split, split, split, crop_size=64, batch_size=2)


def test_left_hands_are_left_again(tmp_path: Path) -> None:
    truth = annotated(tmp_path).landmarks_3d
    assert truth is not None
    found = predict_test(Oracle(), dots(tmp_path), "mano")
    np.testing.assert_allclose(found.prediction.landmarks, truth, atol=1e-6)
    assert found.prediction.vertices is not None
    np.testing.assert_allclose(found.prediction.vertices, truth[:, :5], atol=1e-6)
    assert found.truth is not None
    assert torch.equal(found.truth.landmarks, found.prediction.landmarks)


def test_vertices_of_another_hand_than_mano_are_not_for_benchmarks(tmp_path: Path) -> None:
    found = predict_test(Oracle(), dots(tmp_path), "open")
    assert found.prediction.vertices is None


def test_a_hand_that_cannot_be_read_makes_no_file(tmp_path: Path) -> None:
    data = dots(tmp_path)
    (tmp_path / "a.png").write_bytes(b"cut off")
    with pytest.raises(ValueError, match=r"1 of 3 test hands .* \[0\]"):
        predict_test(Oracle(), data, "open")


def test_the_file_scores_what_the_checkpoint_scores(tmp_path: Path) -> None:
    root = tmp_path / "FreiHAND"
    write_freihand_layout(root, FreiHandFolder(unique=12, evaluation=8))
    small = [text for text in SMALL if not text.startswith(("data.", "crop", "synthetic"))]
    data = ["data=freihand", f"data.root={root}", "data.batch_size=4", "data.reading.workers=1"]
    cache = tmp_path / "cache"
    train(
        settings(cache, tmp_path / "run", *small, *data, "trainer.max_epochs=1", "report.images=0")
    )
    metrics = evaluate(
        settings(
            cache, tmp_path / "scored", f"ckpt={tmp_path / 'run'}", "protocol=freihand", "threads=1",
            "report.images=0", name="evaluate",
        )
    )  # fmt: skip
    official = metrics["official"]
    assert 10 * official["xyz_al_mean3d"] == pytest.approx(metrics["test"]["E_J"], rel=1e-5)
    assert 10 * official["xyz_mean3d"] == pytest.approx(metrics["test"]["E_J_unaligned"], rel=1e-5)
    assert official["mesh_al_mean3d"] == -1
    again = evaluate(
        settings(
            cache, tmp_path / "file", f"predictions={tmp_path / 'scored' / 'submission' / 'pred.zip'}",
            "protocol=freihand", f"ground_truth={root}", "threads=1", name="evaluate",
        )
    )  # fmt: skip
    assert again["frames"] == 8
    assert again["xyz_al_mean3d"] == pytest.approx(official["xyz_al_mean3d"], abs=1e-3)
    assert again["xyz_auc3d"] == pytest.approx(official["xyz_auc3d"], abs=1e-3)
