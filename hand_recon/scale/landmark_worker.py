"""Hands fitted to a column of 2D landmarks: what `hand-recon fit` does, with errors as values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from omegaconf import OmegaConf

from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.fitting.in_parts import fit_part
from hand_recon.fitting.records_of_fits import to_records
from hand_recon.runs.configuration import build_hand, configure_process
from hand_recon.runs.fit_landmarks import image_landmarks
from hand_recon.runs.fit_run import file_origins, source_of
from hand_recon.runs.fitters import build_fitter
from hand_recon.scale.isolation import rows_or_errors
from hand_recon.scale.schema import hand_structs


@dataclass(frozen=True)
class LandmarkTask:
    """Landmarks of one hand."""

    points: object
    """21 × 2, pixels; null or NaN where one is missing."""
    side: object
    """`left` or `right`."""
    confidence: object = None
    """Detector confidence of each landmark, 0 to 1; None if unknown."""
    intrinsics: object = None
    """Camera matrix, 3 × 3, pixels; None for an assumed one."""


class LandmarkWorker:
    """Fit of one process."""

    def __init__(self, settings: Mapping[str, Any]) -> None:
        """Build the fit.

        Args:
            settings: `conf/fit.yaml` composed, as `worker_settings` gives it.

        Raises:
            ValueError: A setting is out of its range.
        """
        configure_process(1)
        config = OmegaConf.create(dict(settings))
        hand = build_hand(config)
        self.fitter = build_fitter(config, hand)
        self.origin = source_of(config, hand)

    def __call__(self, tasks: Sequence[LandmarkTask]) -> list[dict[str, Any]]:
        """Fit hands.

        Args:
            tasks: Landmarks of each hand.

        Returns:
            One row per hand, as `schema.fit_type` describes it, in order.
        """
        # What is no hand is told apart first, so that it does not change the batch of the others.
        rows: list[dict[str, Any]] = [
            row
            for task in tasks
            for row in rows_or_errors([task], lambda one: [self._checked(one[0])], _failed)
        ]
        # Hands with and without a camera are two batches.
        for with_camera in (False, True):
            which = [
                place
                for place, task in enumerate(tasks)
                if not rows[place]["error"] and (task.intrinsics is not None) is with_camera
            ]
            found = rows_or_errors([tasks[place] for place in which], self._fitted, _failed)
            for place, row in zip(which, found, strict=True):
                rows[place] = row
        return rows

    def _checked(self, task: LandmarkTask) -> dict[str, Any]:
        _landmarks([task])
        return {"hand": None, "error": None}

    def _fitted(self, tasks: Sequence[LandmarkTask]) -> list[dict[str, Any]]:
        landmarks = _landmarks(tasks)
        part = fit_part(landmarks, self.fitter, file_origins(landmarks, self.origin))
        return [{"hand": hand, "error": None} for hand in hand_structs(to_records(part))]


def _landmarks(tasks: Sequence[LandmarkTask]) -> ImageLandmarks:
    """Landmarks of hands that all have a camera, or all have none.

    Raises:
        ValueError: A shape, a side, a camera or a confidence is not as it should be.
    """
    given = [task.confidence for task in tasks]
    cameras = [task.intrinsics for task in tasks]
    return image_landmarks(
        np.stack([points_of(task.points, 2) for task in tasks]),
        [str(task.side) for task in tasks],
        None if cameras[0] is None else np.stack([_matrix(one) for one in cameras]),
        None
        if all(one is None for one in given)
        else np.stack([_confidences(one) for one in given]),
    )


def points_of(value: Any, axes: int) -> Float[np.ndarray, "landmark=21 axis"]:  # noqa: ANN401
    """Landmarks of a column's value: lists of points, or a flat list of 21 × `axes` numbers.

    Args:
        value: The value; None, a point of None or NaN where missing.
        axes: Numbers of a point.

    Raises:
        ValueError: It has another shape.
    """
    if value is None:
        raise ValueError(
            f"The landmarks are null; expected 21 × {axes} numbers. Filter such rows, or leave them as they "
            "are."
        )
    rows = [[np.nan] * axes if row is None else row for row in value]
    try:
        array = np.array(rows, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(
            f"The landmarks are no array of numbers; expected 21 × {axes}, null where a point is missing."
        ) from None
    # Others with as many numbers, such as all u before all v, would become scrambled hands.
    if array.shape not in ((21, axes), (21 * axes,)):
        raise ValueError(
            f"The landmarks have the shape {array.shape}; expected (21, {axes}) or ({21 * axes},), point "
            "after point. Transpose them."
            if array.shape == (axes, 21)
            else f"The landmarks have the shape {array.shape}; expected (21, {axes}) or ({21 * axes},)."
        )
    return array.reshape(21, axes)


def _matrix(value: Any) -> Float[np.ndarray, "3 3"]:  # noqa: ANN401  # any nested lists
    array = np.array(value, dtype=np.float64)
    if array.size != 9:
        raise ValueError(f"intrinsics has the shape {array.shape}; expected (3, 3).")
    return array.reshape(3, 3)


def _confidences(value: Any) -> Float[np.ndarray, "landmark=21"]:  # noqa: ANN401  # a list or None
    array = np.full(21, np.nan) if value is None else np.array(value, dtype=np.float64)
    if array.shape != (21,):
        raise ValueError(f"confidence has the shape {array.shape}; expected (21,).")
    return array


def _failed(task: LandmarkTask, error: str) -> dict[str, Any]:
    del task
    return {"hand": None, "error": error}
