"""Fits 3D hands to the 2D landmarks of a file or of a dataset (Sec. 3.2-3.4)."""

import logging
from functools import partial
from pathlib import Path
from typing import Any

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf, open_dict

from hand_recon.data.landmarks.files import read_landmarks
from hand_recon.data.landmarks.parsed import Assumptions
from hand_recon.fitting.descent import Descent, Fitted, Objective
from hand_recon.fitting.descent import fit as descend
from hand_recon.fitting.in_parts import Fitter, fit_in_parts
from hand_recon.fitting.observation import observed
from hand_recon.fitting.results import claim_results_folder, write_results
from hand_recon.hand.model import HandModel
from hand_recon.runs.configuration import (
    build_hand,
    build_prior,
    configure_process,
    instantiate,
    plain,
)
from hand_recon.schema import HandBatch

logger = logging.getLogger(__name__)


def fit(config: DictConfig) -> dict[str, Any]:
    """Fit the hands of a file, or the test hands of a dataset.

    Args:
        config: `conf/fit.yaml` composed.

    Returns:
        Number of hands and means over them; for a dataset, what `metrics.json` holds.

    Raises:
        ValueError: Neither landmarks nor data were given, or both.
    """
    if (config.landmarks is None) == (config.get("data") is None):
        raise ValueError(
            "Give either landmarks=<file> with 21 points per hand or data=views for synthetic test hands; "
            f"found {'neither' if config.landmarks is None else 'both'}."
        )
    threads = configure_process(config.threads)
    folder = claim_results_folder(
        config.output or HydraConfig.get().runtime.output_dir, "config.yaml"
    )
    config = adapted_to_data(config)
    OmegaConf.save(OmegaConf.create(plain(config)), folder / "config.yaml")
    hand = build_hand(config)
    fitter = build_fitter(config, hand)
    logger.info("Fitting with %d thread(s) into %s", threads, folder)
    if config.landmarks is None:
        # Datasets and their scores need Lightning and torchmetrics, which take seconds to import.
        from hand_recon.runs.fit_dataset_run import fit_dataset

        return fit_dataset(config, folder, fitter, hand)
    landmarks = read_landmarks(
        config.landmarks,
        config.intrinsics,
        Assumptions(
            third_value=config.third_value,
            side=config.side,
            order=config.order,
            images=None if config.images is None else Path(config.images),
        ),
    )
    options = instantiate(config.results)
    return write_results(folder, fit_in_parts(landmarks, fitter), hand.faces, options)


def adapted_to_data(config: DictConfig) -> DictConfig:
    """Copy the configuration with the landmark set of a file, or the seed of a dataset, put in."""
    config = config.copy()
    data = config.get("data")
    with open_dict(config):
        if data is None:
            config.hand.landmark_set = config.landmark_set
        elif "data_seed" in data:
            data.data_seed = config.seed
    return config


def build_fitter(config: DictConfig, hand: HandModel) -> Fitter:
    """Build the fit that a configuration describes.

    Args:
        config: `conf/fit.yaml` composed.
        hand: The hand to fit.

    Raises:
        ValueError: The data term needs correlations, which a fit cannot estimate.
    """
    data_term = instantiate(config.data_term)
    if data_term.needs_correlation:
        raise ValueError(
            "Fitting is given each landmark's σ and cannot estimate correlations, which this data "
            "term needs. Use data_term=mse, mse_then_nll, laplace or mse_rescaled."
        )
    objective = Objective(hand, build_prior(config.prior, hand), data_term)
    descent: Descent = instantiate(config.descent)
    further = None
    if config.lifter is not None:
        # Checkpoints need Lightning, which takes seconds to import.
        from hand_recon.fitting.lift import lift, lifted_start
        from hand_recon.runs.checkpoints import load_trained

        regressor = load_trained(config.lifter, config.hand.landmark_set).module.regressor
        further = partial(lifted_start, regressor)
        if descent.steps == 0:
            return lambda batch: Fitted(
                lift(regressor, observed(batch, config.sigma_at_half_confidence)), {}
            )

    def run(batch: HandBatch) -> Fitted:
        return descend(
            observed(batch, config.sigma_at_half_confidence),
            objective,
            descent=descent,
            further=further,
        )

    return run
