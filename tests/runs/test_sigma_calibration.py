"""Factor of σ by the validation scores that a module holds."""

from pathlib import Path
from typing import Any

import lightning
import pytest
import torch

from hand_recon.runs.building import build_module
from hand_recon.runs.sigma_calibration import SIGMA_FACTOR_KEY, SigmaInCheckpoint, factor_of
from hand_recon.training.module import HandReconstruction
from tests.support.configurations import settings

LIFTER = ("recipe=lifter", "model.width=16", "model.encoder.depth=1")


def validated(tmp_path: Path, *words: str) -> HandReconstruction:
    """A module in the last stage of its data term, residuals of 9 px, σ of 3 px and labels of 4 px."""
    module = build_module(settings(tmp_path, tmp_path, *LIFTER, *words))
    module.data_term.begin(step=99, epoch=99, total_steps=100)
    calibration = module.validation.calibration
    assert calibration is not None
    residual = torch.full((8, 21, 2), 9.0)
    labelled = torch.ones(8, 21, dtype=torch.bool)
    # Unlabelled landmarks would change the factor by ten.
    labelled[:, 4:15], residual[:, 4:15] = False, 90.0
    calibration.update(
        residual,
        torch.full((8, 21, 2), 3.0).log(),
        labelled,
        torch.full((8, 21), 4.0),
        torch.arange(8),
    )
    return module


def test_the_factor_is_that_of_the_labelled_landmarks(tmp_path: Path) -> None:
    """All residuals are 3 σ, and 80 % are to be within 1.2816 σ f."""
    module = validated(tmp_path, "data_term=nll", "label_sigma=learnt")
    assert factor_of(module) == pytest.approx(3 / 1.2815516, rel=1e-5)


def test_given_noise_of_labels_is_not_the_networks(tmp_path: Path) -> None:
    """9 px are 1.2816 √((3 f)² + 4²) px: f = √((9 / 1.2816)² − 16) / 3."""
    module = validated(tmp_path, "data_term=nll", "label_sigma=given")
    assert factor_of(module) == pytest.approx(((9 / 1.2815516) ** 2 - 16) ** 0.5 / 3, rel=1e-5)


def test_without_a_learnt_sigma_the_factor_is_one(tmp_path: Path) -> None:
    module = validated(tmp_path, "data_term=nll", "label_sigma=learnt")
    squared = build_module(settings(tmp_path, tmp_path, *LIFTER, "data_term=mse"))
    module.data_term = squared.data_term
    assert factor_of(module) == 1.0


def test_before_the_stage_that_learns_sigma_the_factor_is_one(tmp_path: Path) -> None:
    module = validated(tmp_path, "data_term=nll", "label_sigma=learnt")
    staged = build_module(settings(tmp_path, tmp_path, *LIFTER, "data_term=mse_then_nll"))
    module.data_term = staged.data_term
    assert factor_of(module) == 1.0
    module.data_term.begin(step=99, epoch=99, total_steps=100)
    assert factor_of(module) > 2


@pytest.mark.parametrize(("earlier", "expected"), [({SIGMA_FACTOR_KEY: 2.5}, 2.5), ({}, 1.0)])
def test_a_continued_run_keeps_the_factor_until_it_validates(
    tmp_path: Path, earlier: dict[str, Any], expected: float
) -> None:
    """A run with nothing left to do saves its last checkpoint again; earlier versions have no factor."""
    module = validated(tmp_path, "data_term=nll", "label_sigma=learnt")
    trainer = lightning.Trainer(logger=False, enable_checkpointing=False, accelerator="cpu")
    callback = SigmaInCheckpoint()
    callback.on_load_checkpoint(trainer, module, earlier)
    saved: dict[str, Any] = {}
    callback.on_save_checkpoint(trainer, module, saved)
    assert saved == {SIGMA_FACTOR_KEY: expected}
    callback.on_validation_epoch_end(trainer, module)
    callback.on_save_checkpoint(trainer, module, saved)
    assert saved[SIGMA_FACTOR_KEY] == pytest.approx(3 / 1.2815516, rel=1e-5)
