"""Fits the test hands of a dataset to their 2D labels and scores them: Table 1 without a network."""

import logging
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import torch
from omegaconf import DictConfig

from hand_recon.data.dataset import load_batch
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.evaluation.hand_scores import Scores
from hand_recon.fitting.fitted_hands import FittedHands
from hand_recon.fitting.in_parts import Fitter, fit_in_parts
from hand_recon.fitting.results import write_results
from hand_recon.hand.model import HandModel
from hand_recon.knowledge.penetration.non_penetration import NonPenetration
from hand_recon.knowledge.ranges import load_ranges
from hand_recon.runs.building import SCORED_RANGES, build_data
from hand_recon.runs.configuration import instantiate
from hand_recon.runs.results import environment, write_json, write_per_hand

logger = logging.getLogger(__name__)


def fit_dataset(
    config: DictConfig, folder: Path, fitter: Fitter, hand: HandModel
) -> dict[str, Any]:
    """Fit the test hands of a dataset to their 2D labels, and score them."""
    data = build_data(config)
    dataset = data.dataset("test")
    count = min(int(config.hands), len(dataset))
    batch = load_batch(dataset, list(range(count)))
    landmarks = ImageLandmarks(
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
        for part in fit_in_parts(landmarks, fitter):
            whole = batch.select(slice(done, done + len(part)))
            # Fits that are not finite are scored too, as errors: leaving them out would improve the score.
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
        "landmarks": data.landmark_set,
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
