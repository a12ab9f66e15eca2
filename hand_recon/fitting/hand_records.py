"""Reconstructed hands as arrays, one row per hand: what a file of hands holds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Final

import numpy as np
from jaxtyping import Bool, Float

from hand_recon.fitting.origin import Moment

VERDICTS: Final = ("plausible", "doubtful", "not fitted")
"""Verdicts on a hand, best first."""

CAMERAS: Final = ("given", "EXIF", "field of view", "assumed", "none")
"""Sources of a camera matrix; `none` for hands that no camera saw, with a made-up matrix."""

SHAPES: Final[Mapping[str, tuple[int, ...]]] = {
    "landmarks_3d": (21, 3),
    "landmarks_2d": (21, 2),
    "observed_2d": (21, 2),
    "sigma_2d": (21, 2),
    "covariance_3d": (21, 3, 3),
    "joint_angles_degrees": (15, 3),
    "shape": (10,),
    "root_rotation": (3, 3),
    "translation": (3,),
    "intrinsics": (3, 3),
    "residual": (),
    "score": (),
}
"""Shapes of the numbers of one hand."""


@dataclass(frozen=True)
class HandRecords:
    """Reconstructed hands; numbers of hands without a result are NaN."""

    names: tuple[str, ...]
    """Name of each hand."""
    images: tuple[str | None, ...]
    """File name of each hand's image; None without one."""
    sides: tuple[str, ...]
    """Side of each hand, `left` or `right`."""
    verdicts: tuple[str, ...]
    """Verdict on each hand, one of `VERDICTS`."""
    reasons: tuple[tuple[str, ...], ...]
    """Reasons of each verdict that is not `plausible`."""
    score: Float[np.ndarray, " hand"]
    """Detector's score of each hand, 0 to 1; NaN without one."""
    landmarks_3d: Float[np.ndarray, "hand landmark=21 3"]
    """Landmarks, metres, camera frame (x right, y down, z forward)."""
    landmarks_2d: Float[np.ndarray, "hand landmark=21 2"]
    """Projected landmarks, pixels of the image (pixel i covers [i, i + 1))."""
    observed_2d: Float[np.ndarray, "hand landmark=21 2"]
    """Landmarks that the hand was fitted to, pixels of the image; NaN where one is missing."""
    sigma_2d: Float[np.ndarray, "hand landmark=21 2"]
    """Standard deviation of each coordinate, pixels of the image; NaN without an estimate."""
    covariance_3d: Float[np.ndarray, "hand landmark=21 3 3"]
    """Covariance of each landmark from the hand's origin, axes of the camera, square metres; NaN without an
    estimate."""
    joint_angles_degrees: Float[np.ndarray, "hand joint=15 axis=3"]
    """Bend, splay and twist of each joint, degrees."""
    shape: Float[np.ndarray, "hand direction=10"]
    """Shape coefficients, standard deviations."""
    root_rotation: Float[np.ndarray, "hand 3 3"]
    """Rotation from the hand's frame to the camera's."""
    translation: Float[np.ndarray, "hand 3"]
    """Origin of the hand's frame in the camera's, metres."""
    intrinsics: Float[np.ndarray, "hand 3 3"]
    """Camera matrix, pixels of the image."""
    cameras: tuple[str | None, ...]
    """Source of each camera matrix, one of `CAMERAS`; None for hands without a result."""
    image_sizes: tuple[tuple[int, int] | None, ...]
    """Width and height of each hand's image, pixels; None if unknown."""
    residual: Float[np.ndarray, " hand"]
    """Mean distance of the projections to the observed landmarks, pixels of the image; NaN without any."""
    loss: Mapping[str, Float[np.ndarray, " hand"]]
    """Value of every term of the loss by name; NaN where it is not finite."""
    sources: tuple[str, ...]
    """Steps that made each hand, such as `mediapipe, fit`."""
    hand_models: tuple[str, ...]
    """Hand model that angles and shape belong to, `open` or `mano`."""
    versions: tuple[str, ...]
    """Version of hand_recon that made each hand."""
    moments: tuple[Moment | None, ...]
    """Place of each hand in its clip; None for photographs and for landmarks alone."""

    def __len__(self) -> int:
        return len(self.names)

    @property
    def fitted(self) -> Bool[np.ndarray, " hand"]:
        """Mask of the hands with a result, plausible or doubtful."""
        return np.array([verdict != "not fitted" for verdict in self.verdicts], dtype=bool)

    def counts(self) -> dict[str, int]:
        """Numbers of hands, of fitted and of doubtful ones."""
        return {
            "hands": len(self),
            "fitted": int(self.fitted.sum()),
            "doubtful": self.verdicts.count("doubtful"),
        }

    @property
    def intrinsics_known(self) -> Bool[np.ndarray, " hand"]:
        """Mask of the hands whose camera matrix was not assumed or made up."""
        unknown = (None, "assumed", "none")
        return np.array([source not in unknown for source in self.cameras], dtype=bool)


def joined_records(parts: Sequence[HandRecords]) -> HandRecords:
    """Records of several parts as one; a term of the loss that a part lacks is NaN there.

    Raises:
        ValueError: There is no part.
    """
    if not parts:
        raise ValueError("Found no part of hands to join; expected one or more.")
    values: dict[str, Any] = {}
    for entry in fields(HandRecords):
        columns = [getattr(part, entry.name) for part in parts]
        if entry.name == "loss":
            values["loss"] = _joined_losses(parts)
        elif isinstance(columns[0], tuple):
            values[entry.name] = tuple(value for column in columns for value in column)
        else:
            values[entry.name] = np.concatenate(columns)
    return HandRecords(**values)


def _joined_losses(parts: Sequence[HandRecords]) -> dict[str, Float[np.ndarray, " hand"]]:
    terms = dict.fromkeys(term for part in parts for term in part.loss)
    return {
        term: np.concatenate([part.loss.get(term, np.full(len(part), np.nan)) for part in parts])
        for term in terms
    }
