"""Records of labelled images, and their form as rows of JSON."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from hand_recon.detection.detector import DetectedHand

_ARRAYS = ("landmarks_2d", "sigma", "confidence")


@dataclass(frozen=True)
class LabelledHand:
    """A hand that the detector found, and why it may be wrong."""

    landmarks_2d: Float[np.ndarray, "landmark=21 2"]
    """Landmarks in FreiHAND's order, pixels of the upright image; NaN where one is missing."""
    side: str
    """`left` or `right`."""
    score: float | None = None
    """Presence of the hand, 0 to 1; None without one."""
    side_score: float | None = None
    """Probability of the side, 0 to 1."""
    sigma: Float[np.ndarray, " landmark=21"] | None = None
    """Standard deviation of each landmark, pixels of the image; None without an estimate."""
    confidence: Float[np.ndarray, " landmark=21"] | None = None
    """Confidence of each landmark, 0 to 1; None without one, as of MediaPipe."""
    reasons: Mapping[str, str] = field(default_factory=dict)
    """Sentence for each mark, by its name; empty for a sure hand."""

    @property
    def is_sure(self) -> bool:
        """True without a mark."""
        return not self.reasons

    @property
    def extent(self) -> float:
        """Longer side of the box of the landmarks, pixels."""
        return extent_of(self.landmarks_2d)

    @property
    def box(self) -> Float[np.ndarray, " 4"]:
        """Left, top, right and bottom of the landmarks, pixels."""
        low, high = np.nanmin(self.landmarks_2d, axis=0), np.nanmax(self.landmarks_2d, axis=0)
        return np.concatenate([low, high])


@dataclass(frozen=True)
class LabelledImage:
    """An image that was looked at."""

    name: str
    """Path from the folder of the images, with slashes."""
    size: tuple[int, int] | None = None
    """Width and height, upright, pixels; None if it could not be read."""
    hands: Sequence[LabelledHand] = ()
    """Its hands, the most certain first."""
    error: str | None = None
    """Reason why it has no labels; None if it was looked at."""

    def to_row(self) -> dict[str, Any]:
        """The record as JSON holds it: landmarks to a hundredth, σ to a thousandth of a pixel."""
        return {
            "image": self.name,
            "size": self.size,
            "error": self.error,
            "hands": [_row(hand) for hand in self.hands],
        }

    @classmethod
    def from_row(cls, row: Mapping[str, Any]) -> "LabelledImage":
        """Read `to_row` back.

        Args:
            row: One row.
        """
        size = row["size"]
        return cls(
            row["image"],
            None if size is None else (size[0], size[1]),
            tuple(_hand(entry) for entry in row["hands"]),
            row["error"],
        )


def extent_of(landmarks: Float[np.ndarray, "landmark=21 2"]) -> float:
    """Longer side of the box of a hand's landmarks, pixels.

    Args:
        landmarks: Pixels; NaN where one is missing, one or more are not.
    """
    return float((np.nanmax(landmarks, axis=0) - np.nanmin(landmarks, axis=0)).max())


def listed(values: Float[np.ndarray, "landmark=21 *coordinate"]) -> list[Any]:
    """Values of landmarks as JSON holds them: null for a landmark that is missing.

    Args:
        values: A number or a point for each landmark; NaN where it is missing.
    """
    there = np.isfinite(values.reshape(21, -1)).all(axis=1)
    return [one if known else None for one, known in zip(values.tolist(), there, strict=True)]


def labelled_hand(hand: DetectedHand, reasons: Mapping[str, str]) -> LabelledHand:
    """The record of a detected hand with its marks; numbers are rounded as the files have them.

    Args:
        hand: The hand.
        reasons: Sentence for each mark, by its name.
    """
    return LabelledHand(
        landmarks_2d=hand.landmarks_2d.astype(np.float64).round(2),
        side=hand.side,
        score=None if hand.score is None else round(float(hand.score), 4),
        side_score=round(float(hand.side_score), 4),
        sigma=_known(hand.sigma),
        confidence=_known(hand.confidence),
        reasons=dict(reasons),
    )


def _known(
    values: Float[np.ndarray, "landmark=21"] | None,
) -> Float[np.ndarray, "landmark=21"] | None:
    """Rounded values; None for a hand without any."""
    if values is None or np.isnan(values).all():
        return None
    return np.asarray(values.astype(np.float64).round(3))


def _row(hand: LabelledHand) -> dict[str, Any]:
    arrays = {key: getattr(hand, key) for key in _ARRAYS}
    return {
        **asdict(hand),
        **{key: None if array is None else listed(array) for key, array in arrays.items()},
    }


def _hand(entry: Mapping[str, Any]) -> LabelledHand:
    points = [point or [np.nan, np.nan] for point in entry["landmarks_2d"]]
    numbers = {
        key: None if entry[key] is None else np.array(entry[key], dtype=np.float64)
        for key in ("sigma", "confidence")
    }
    return LabelledHand(
        **{**entry, **numbers, "landmarks_2d": np.array(points, dtype=np.float64)},
    )
