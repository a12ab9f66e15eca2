"""Fit 3D hands to 2D landmarks with the knowledge and the likelihood of training (Sec. 3.2-3.4).

python -m hand_recon.fit landmarks=hands.json output=outputs/my_hands
python -m hand_recon.fit landmarks=hands.json intrinsics=K.json prior=biomechanics output=…
python -m hand_recon.fit data=views +experiment=ablation_row4
"""

import logging
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, Final

import hydra
import torch
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf, open_dict

from hand_recon.data.datamodule import gather
from hand_recon.data.landmarks.crops import to_crops
from hand_recon.data.landmarks.files import read_landmarks
from hand_recon.data.landmarks.landmark_set import LandmarkSet
from hand_recon.data.landmarks.parsed import Assumptions
from hand_recon.data.progress import with_progress
from hand_recon.evaluation.hand_scores import Scores
from hand_recon.fitting.descent import Descent, Fitted, Objective
from hand_recon.fitting.descent import fit as descend
from hand_recon.fitting.fitted_hands import FittedHands, fitted_hands
from hand_recon.fitting.lift import lift, lifted_start
from hand_recon.fitting.observation import observed
from hand_recon.fitting.results import claim_results_folder, write_results
from hand_recon.hand.model import HandModel
from hand_recon.knowledge.penetration.non_penetration import NonPenetration
from hand_recon.knowledge.ranges import load_ranges
from hand_recon.runs.checkpoints import load_trained
from hand_recon.runs.configuration import (
    CONF,
    SCORED_RANGES,
    build_data,
    build_hand,
    build_prior,
    instantiate,
    plain,
    settle_process,
)
from hand_recon.runs.results import environment, write_json, write_per_hand
from hand_recon.schema import HandBatch

logger = logging.getLogger(__name__)

PART: Final = 64
"""Hands that are fitted before the first of them are written."""


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
            "What is to be fitted? Give landmarks=<file> with 21 points per hand, or data=views for "
            "synthetic test hands; and not both."
        )
    threads = settle_process(config.threads)
    folder = claim_results_folder(
        config.output or HydraConfig.get().runtime.output_dir,
    )
    config = _of_the_data(config)
    OmegaConf.save(OmegaConf.create(plain(config)), folder / "config.yaml")
    hand = build_hand(config)
    fitter = _fitter(config, hand)
    logger.info("Fitting with %d thread(s) into %s", threads, folder)
    if config.landmarks is None:
        return _fit_dataset(config, folder, fitter, hand)
    landmarks = read_landmarks(
        config.landmarks,
        config.intrinsics,
        Assumptions(
            third=config.third,
            side=config.side,
            order=config.order,
            images=None if config.images is None else Path(config.images),
        ),
    )
    options = instantiate(config.results)
    return write_results(folder, _parts(landmarks, fitter), hand.faces, options)


def _of_the_data(config: DictConfig) -> DictConfig:
    """The configuration with what follows from whose hands they are."""
    config = config.copy()
    data = config.get("data")
    with open_dict(config):
        # Only where it is a choice: `mse_rescaled` is the balance that is not kept.
        if config.data_term.get("keep_balance"):
            config.data_term.keep_balance = config.keep_balance
        if data is None:
            config.hand.landmarks = config.landmark_set
        elif "data_seed" in data:
            data.data_seed = config.seed
    return config


Fitter = Callable[[HandBatch], Fitted]
"""Crops of landmarks → hands."""


def _fitter(config: DictConfig, hand: HandModel) -> Fitter:
    data_term = instantiate(config.data_term)
    if data_term.needs_correlation:
        raise ValueError(
            "A fit is told how far to trust each landmark and does not learn it, and nobody tells "
            "correlations: use data_term=mse, mse_then_nll, laplace or mse_rescaled."
        )
    objective = Objective(hand, build_prior(config.prior, hand), data_term)
    descent: Descent = instantiate(config.descent)
    further = None
    if config.lifter is not None:
        regressor = load_trained(config.lifter, config.hand.landmarks).module.regressor
        further = partial(lifted_start, regressor)
        if descent.steps == 0:
            return lambda batch: Fitted(lift(regressor, observed(batch, config.half_sure)), {})

    def run(batch: HandBatch) -> Fitted:
        return descend(
            observed(batch, config.half_sure), objective, descent=descent, further=further
        )

    return run


def _parts(landmarks: LandmarkSet, fitter: Fitter, size: int = PART) -> Iterator[FittedHands]:
    """Hands as they are fitted, in order; those without enough landmarks keep their places."""
    parts = landmarks.parts(size)
    total = -(-len(landmarks) // size)
    for part in with_progress(parts, total, f"Fitting {len(landmarks)} hands, {size} at a time"):
        crops, usable = to_crops(part), part.usable
        found = fitter(crops.batch.select(usable))
        # A fit has the σ that it was told; without a loss it is a lifter's answer, with σ of its own.
        own = not found.loss
        yield fitted_hands(part, crops, found.prediction, found.loss, has_sigma=own)


def _fit_dataset(
    config: DictConfig, folder: Path, fitter: Fitter, hand: HandModel
) -> dict[str, Any]:
    """Fit the test hands of a dataset to their 2D labels, and score them."""
    data = build_data(config)
    dataset = data.dataset("test")
    count = min(int(config.hands), len(dataset))
    batch = gather(dataset, list(range(count)))
    landmarks = LandmarkSet(
        landmarks_2d=batch.landmarks_2d.double(),
        labelled=batch.labelled,
        left=torch.zeros(count, dtype=torch.bool),
        names=tuple(f"{data.name}_{place:05d}" for place in range(count)),
        confidence=None if batch.confidence is None else batch.confidence.double(),
        intrinsics=None if batch.intrinsics is None else batch.intrinsics.double(),
    )
    scores = Scores(load_ranges(SCORED_RANGES), NonPenetration(hand), calibration=False)
    began = time.monotonic()

    def scored() -> Iterator[FittedHands]:
        done = 0
        for part in _parts(landmarks, fitter):
            whole = batch.select(slice(done, done + len(part)))
            # Not those alone that came out finite: a fit that explodes must not score better for it.
            kept = part.observed.usable
            scores.update(whole.select(kept), part.prediction.to(torch.float32).select(kept))
            done += len(part)
            yield part

    summary = write_results(folder, scored(), hand.faces, instantiate(config.results))
    test = scores.compute()
    index, columns = scores.last_per_hand
    if columns:
        write_per_hand(folder / "per_hand.csv", index, columns)
    metrics: dict[str, Any] = {
        "name": config.name,
        "seed": config.seed,
        "data": data.name,
        "landmarks": data.landmarks,
        "test_hands": count,
        "test": test,
        "mean_pose": {},
        "fit": summary,
        "fit_seconds": round(time.monotonic() - began, 1),
        "environment": environment(),
    }
    write_json(folder / "metrics.json", metrics)
    logger.info(
        "E_J %.2f mm, PR %.1f %%",
        test.get("E_J", float("nan")),
        test.get("PR", float("nan")),
    )
    return metrics


@hydra.main(version_base="1.3", config_path=CONF, config_name="fit")
def main(config: DictConfig) -> None:
    """The command line."""
    fit(config)


if __name__ == "__main__":
    main()
