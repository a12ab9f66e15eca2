"""Finds the hands of images and marks those whose labels may be wrong (decision 70)."""

import logging
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from omegaconf import DictConfig

from hand_recon.data.images import read_image
from hand_recon.data.landmarks.image_landmarks import FEWEST
from hand_recon.detection.boxes import BoxDetector, WholeImageDetector
from hand_recon.detection.copy_votes import CopyVotes
from hand_recon.detection.detector import Detector
from hand_recon.detection.mediapipe import MediaPipeDetector
from hand_recon.fitting.in_parts import Fitter, fit_part
from hand_recon.fitting.origin import Origin
from hand_recon.fitting.photo_camera import parse_camera
from hand_recon.runs.configuration import build_hand
from hand_recon.runs.fitters import build_fitter
from hand_recon.runs.labelling.label_records import LabelledImage, labelled_hand
from hand_recon.runs.labelling.marks import Limits, marks_of_detection, marks_of_fit
from hand_recon.runs.looking import LookedAt, build_detector, look_at_file, to_landmarks

logger = logging.getLogger(__name__)


def build_label_detector(config: DictConfig) -> Detector:
    """Build the detector of a configuration; with copies, their means are the side and the score, too.

    Args:
        config: `conf/prepare_labels.yaml` composed.
    """
    detector = build_detector(config)
    if isinstance(detector, MediaPipeDetector | BoxDetector | WholeImageDetector):
        detector.noise = CopyVotes(config.copies)
    return detector


class Labeller:
    """The detector, the fit and the limits of a command."""

    def __init__(self, config: DictConfig, root: Path) -> None:
        """Build them; nothing is loaded yet.

        Args:
            config: `conf/prepare_labels.yaml` composed.
            root: Folder of the images.

        Raises:
            ValueError: An option is wrong.
        """
        self.root = root
        self.limits = Limits(**{str(key): float(value) for key, value in config.limits.items()})
        self.detector = build_label_detector(config)
        self.camera = parse_camera("assumed", 1)
        self.fitter: Fitter | None = None
        if config.fit:
            self.fitter = build_fitter(config, build_hand(config))

    def name_of(self, path: Path) -> str:
        """Path of an image from the folder of the images; bytes that are not UTF-8 are spelt out.

        Args:
            path: The image.
        """
        name = path.relative_to(self.root).as_posix()
        return os.fsencode(name).decode("utf-8", "backslashreplace")

    def look(self, number: int, path: Path) -> LookedAt:
        """Find the hands of an image; one that training cannot read has an error.

        Args:
            number: Index among all images.
            path: The image.
        """
        name = self.name_of(path)
        if name != path.relative_to(self.root).as_posix():
            return _failed(number, name, "its name is not UTF-8; rename it")
        seen = look_at_file(number, name, path, self.detector, self.camera)
        if seen.error is not None or seen.size is None:
            return seen
        image = read_image(path)
        if image is None or image.shape[1::-1] != seen.size:
            return _failed(number, name, "training cannot read it upright; save it as JPEG or PNG")
        return _with_enough_landmarks(seen)

    def label(self, batch: Sequence[LookedAt]) -> list[LabelledImage]:
        """Mark the hands of some images.

        Args:
            batch: The images with their hands.
        """
        marks = [
            mark
            for one in batch
            if one.hands and one.size is not None
            for mark in marks_of_detection(one.hands, one.size, self.limits)
        ]
        if self.fitter is not None and marks:
            landmarks, origins = to_landmarks(batch, Origin())
            fitted = marks_of_fit(fit_part(landmarks, self.fitter, origins))
            marks = [{**first, **second} for first, second in zip(marks, fitted, strict=True)]
        rest = iter(marks)
        return [
            LabelledImage(
                one.name, one.size, tuple(labelled_hand(hand, next(rest)) for hand in one.hands),
                one.error,
            )
            for one in batch
        ]  # fmt: skip


def _with_enough_landmarks(seen: LookedAt) -> LookedAt:
    """The image without hands of which a file has too few landmarks."""
    kept = tuple(
        hand for hand in seen.hands if np.isfinite(hand.landmarks_2d).all(axis=1).sum() >= FEWEST
    )
    if len(kept) < len(seen.hands):
        logger.info(
            "%s: %d hands have fewer than %d landmarks and are left out.",
            seen.name, len(seen.hands) - len(kept), FEWEST,
        )  # fmt: skip
    return replace(seen, hands=kept)


def _failed(number: int, name: str, reason: str) -> LookedAt:
    logger.error("%s: %s.", name, reason)
    return LookedAt(number, name, error=reason)
