"""Fits 3D hands to the 2D landmarks of a file or of a dataset (Sec. 3.2-3.4)."""

import logging
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf, open_dict

from hand_recon.data.landmarks.files import read_landmarks
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.data.landmarks.parsed import Assumptions
from hand_recon.fitting.hands_file import entries_so_far
from hand_recon.fitting.in_parts import fit_in_parts
from hand_recon.fitting.origin import Origin
from hand_recon.fitting.results import PRODUCTS, claim_results_folder, write_results
from hand_recon.hand.model import HandModel
from hand_recon.runs.configuration import (
    build_hand,
    configure_process,
    instantiate,
    plain,
)
from hand_recon.runs.fitters import build_fitter, fitter_of
from hand_recon.runs.lifters import lifter_path, names_lifter
from hand_recon.runs.unfinished import (
    claim_or_resume,
    file_state,
    finish,
    results_folder,
    settings_of,
)

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
    config = adapted_to_data(config)
    folder = results_folder(config)
    if config.landmarks is None:
        return _fit_dataset(config, folder)
    settings = settings_of(config, ("intrinsics", "lifter", "hand.path"))
    settings["landmarks"] = _states(config.landmarks)
    options = instantiate(config.results)
    if names_lifter(config.lifter):
        # Before the folder is claimed, so that the corrected command can have it.
        lifter_path(config.lifter)
    goes_on = claim_or_resume(folder, (*PRODUCTS, "config.yaml"), settings)
    landmarks = read_landmarks(
        config.landmarks,
        config.intrinsics,
        Assumptions(
            third_value=config.third_value,
            side=config.side,
            order=config.order,
            images=None if config.images is None else Path(config.images),
            placeholders=config.placeholders,
        ),
        None if config.image_size is None else (config.image_size[0], config.image_size[1]),
    )
    done = entries_so_far(folder / "hands.json")[: len(landmarks)] if goes_on else None
    if done:
        logger.info("%d of %d hands are there already.", len(done), len(landmarks))
    OmegaConf.save(OmegaConf.create(plain(config)), folder / "config.yaml")
    hand = build_hand(config)
    logger.info("Fitting with %d thread(s) into %s", threads, folder)
    rest = landmarks.select(slice(len(done or ()), None))
    # Of all hands, so that an interrupted fit goes on with the same shape of the person.
    fitter = fitter_of(config, hand, landmarks)
    parts = fit_in_parts(rest, fitter, origins=file_origins(rest, source_of(config, hand)))
    summary = write_results(folder, parts, hand.faces, options, done=done or [])
    finish(folder)
    check_outcome(summary, strict=config.strict)
    return summary


def _states(path: str) -> list[list[Any]]:
    """States of the file of landmarks, or of the files of a folder of them.

    Raises:
        FileNotFoundError: There is neither.
    """
    found = Path(path).expanduser()
    if not found.exists():
        raise FileNotFoundError(
            f"No landmarks at {found}. Give a JSON list of hands of 21 points [u, v], COCO keypoints or CSV."
        )
    files = [found] if found.is_file() else sorted(one for one in found.iterdir() if one.is_file())
    return [file_state(one) for one in files]


def _fit_dataset(config: DictConfig, folder: Path) -> dict[str, Any]:
    """Fit the test hands of a dataset."""
    # Datasets and their scores need Lightning and torchmetrics, which take seconds to import.
    from hand_recon.runs.fit_dataset_run import fit_dataset

    if config.same_person:
        raise ValueError(
            "same_person=true with data=: the test hands of a dataset are of several people. Leave it out, "
            "or give the landmarks of one person."
        )
    claim_results_folder(folder, "config.yaml")
    OmegaConf.save(OmegaConf.create(plain(config)), folder / "config.yaml")
    hand = build_hand(config)
    return fit_dataset(config, folder, build_fitter(config, hand), hand)


def source_of(config: DictConfig, hand: HandModel, before: str = "landmarks") -> Origin:
    """Origin of hands of a fit, without what differs from hand to hand.

    Args:
        config: Configuration of the fit.
        hand: The hand that is fitted.
        before: Steps that gave the landmarks.
    """
    steps = [before]
    if names_lifter(config.lifter):
        steps.append("lifter")
    if config.descent.steps:
        steps.append("fit")
    return Origin(source=", ".join(steps), hand_model=hand.name)


def file_origins(landmarks: ImageLandmarks, origin: Origin) -> tuple[Origin, ...]:
    """Origins of the hands of a file of landmarks."""
    camera = "assumed" if landmarks.intrinsics is None else "given"
    sizes: list[list[float]] = (
        [[math.nan] * 2] * len(landmarks)
        if landmarks.image_sizes is None
        else landmarks.image_sizes.tolist()
    )
    return tuple(
        replace(
            origin,
            image=None if file is None else file.name,
            image_size=None if math.isnan(size[0]) else (round(size[0]), round(size[1])),
            camera=camera,
        )
        for file, size in zip(landmarks.images, sizes, strict=True)
    )


def check_outcome(summary: dict[str, float], *, strict: bool) -> None:
    """Check that the results are what the command promises to have when it ends with status 0.

    Args:
        summary: Number of hands, of fitted and of doubtful ones.
        strict: True if doubtful hands and those that were not fitted count as failures.

    Raises:
        ValueError: No hand was fitted; or strict, and a hand is doubtful or not fitted.
    """
    if not summary["fitted"]:
        raise ValueError(
            f"No hand was fitted, of {summary['hands']}; hands.json has the reason of each."
        )
    if strict:
        refuse_doubts(summary)


def refuse_doubts(summary: Mapping[str, float]) -> None:
    """Check that every hand is fitted and none is doubtful.

    Args:
        summary: Number of hands, of fitted and of doubtful ones.

    Raises:
        ValueError: A hand is doubtful or not fitted.
    """
    hands, fitted, doubtful = (int(summary[key]) for key in ("hands", "fitted", "doubtful"))
    if doubtful or fitted < hands:
        raise ValueError(
            f"{doubtful} of {hands} hands are doubtful and {hands - fitted} are not fitted, which strict "
            "refuses; hands.json has the reason of each."
        )


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
