"""Standard deviation σ of each of MediaPipe's landmarks, which come without a confidence (decision 68).

Two sources, alone or together: a table of where transformed copies of crops disagree, as a function of one
reading of a hand, and the disagreement of copies of the hand itself.
"""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
import yaml
from jaxtyping import Float, UInt8

from hand_recon.detection.copies import COPIES, ReadHand, read_copies, spread_of_copies
from hand_recon.detection.hands import HandReading
from hand_recon.detection.regions import INDEX_MCP, WRIST, region_of_landmarks
from hand_recon.hand.skeleton import LANDMARK_PARENTS, ROOT_LANDMARK

TABLE: Final = Path(__file__).with_name("landmark_noise.yaml")
"""The shipped table."""

SHARED: Final = (
    "doubt", "strong_doubt", "facing", "extent", "outside", "doubt_facing", "facing_extent",
)  # fmt: skip
"""Features with one coefficient for all landmarks, in the order of `features`; curl has one for each."""

LITTLE_MCP: Final = 17

SPREAD_BOUNDS: Final = (0.002, 0.15)
"""Least and greatest spread, sides of the square: few copies may agree by chance."""

SHARED_ERROR: Final = 3 / 224
"""Standard deviation of an error that all readings share, sides of the square (decision 68)."""

_OUTSIDE: Final = 0.02
"""Distance outside the image from which on a landmark counts as outside, sides."""


@dataclass(frozen=True)
class Features:
    """Features of a reading on which σ depends."""

    shared: Float[np.ndarray, "landmark=21 feature"]
    """Those named in `SHARED`."""
    curl: Float[np.ndarray, "landmark=21"]
    """Sum of the angles between bones from the finger's MCP (the thumb's CMC) to the landmark, radians."""


@dataclass(frozen=True)
class NoiseTable:
    """Spread of copies as a function of the features of one reading, and σ of a spread."""

    constant: Float[np.ndarray, "landmark=21"]
    """Logarithm of the spread where all features are 0, the spread in sides of the square."""
    curl: Float[np.ndarray, "landmark=21"]
    """Change with the curl, per radian."""
    shared: Float[np.ndarray, " feature"]
    """Changes with the features in `SHARED`."""
    gain: Float[np.ndarray, " count"]
    """Error that readings do not share, per spread, by the number of copies, from none."""

    def spread(self, features: Features) -> Float[np.ndarray, "landmark=21"]:
        """The expected spread of copies, sides of the square.

        Args:
            features: Features of a reading.
        """
        logarithm = self.constant + self.curl * features.curl + features.shared @ self.shared
        return np.exp(np.clip(logarithm, *np.log(SPREAD_BOUNDS)))

    def sigma(
        self, spread: Float[np.ndarray, "*batch"], copies: int
    ) -> Float[np.ndarray, "*batch"]:
        """σ of landmarks of some spread, both in sides of the square.

        Args:
            spread: Spread of copies.
            copies: Number of copies whose mean the landmarks are, besides the first reading.
        """
        return np.hypot(SHARED_ERROR, self.gain[copies] * spread)


@cache
def load_table(path: Path = TABLE) -> NoiseTable:
    """Read a table.

    Args:
        path: YAML file as `tools/measure_landmark_noise.py` writes it.
    """
    read = yaml.safe_load(path.read_text(encoding="utf-8"))
    return NoiseTable(
        constant=np.array(read["constant"], dtype=float),
        curl=np.array(read["curl"], dtype=float),
        shared=np.array([read["shared"][name] for name in SHARED], dtype=float),
        gain=np.array(read["gain"], dtype=float),
    )


def features(reading: HandReading, height: int, width: int) -> Features:
    """Compute the features of a reading that σ depends on.

    Args:
        reading: Landmarks, metric landmarks and presence.
        height: Height of the image, pixels.
        width: Its width, pixels.
    """
    side = _side(reading)
    doubt = float(np.log10(np.clip(1 - reading.presence, 1e-4, 1)))
    facing = _facing(reading.landmarks_3d)
    extent = reading.extent / side
    inside = np.minimum(reading.landmarks_2d, np.array([width, height]) - reading.landmarks_2d)
    outside = (-inside.min(axis=1) / side > _OUTSIDE).astype(float)
    one = np.ones(21)
    columns = [
        doubt * one, max(doubt + 2, 0.0) * one, facing * one, extent * one, outside,
        doubt * facing * one, facing * extent * one,
    ]  # fmt: skip
    return Features(np.stack(columns, axis=1), _curl(reading.landmarks_3d))


class LandmarkNoise:
    """Estimates σ of each landmark of a reading; with copies, the landmarks become their mean."""

    def __init__(self, copies: int = 0) -> None:
        """Store the number of copies.

        Args:
            copies: Number of transformed copies of the crop of each hand, 0 for the table alone.

        Raises:
            ValueError: There are not so many copies.
        """
        if not 0 <= copies <= len(COPIES):
            raise ValueError(
                f"Expected detector.copies from 0 (none) to {len(COPIES)}, found {copies}."
            )
        self.copies = copies
        self.table = load_table()

    def __call__(
        self,
        read: ReadHand,
        image: UInt8[np.ndarray, "height width 3"],
        reading: HandReading,
    ) -> HandReading:
        """Return a reading with σ.

        Args:
            read: Reads the copies.
            image: RGB, bytes.
            reading: The hand.
        """
        spread = self.table.spread(features(reading, image.shape[0], image.shape[1]))
        landmarks, side = reading.landmarks_2d, _side(reading)
        if self.copies:
            copies = read_copies(read, image, reading, self.copies)
            spread = combined_spread(spread, spread_of_copies(landmarks, copies) / side)
            landmarks = np.concatenate([landmarks[None], copies]).mean(axis=0)
        sigma = side * self.table.sigma(spread, self.copies)
        return replace(reading, landmarks_2d=landmarks, sigma=sigma)


def combined_spread(
    expected: Float[np.ndarray, "landmark=21"], measured: Float[np.ndarray, "landmark=21"]
) -> Float[np.ndarray, "landmark=21"]:
    """The geometric mean of the table's spread and the copies'.

    Args:
        expected: Spread by the table, sides of the square.
        measured: Spread of the copies, sides of the square; clipped to `SPREAD_BOUNDS`.
    """
    return np.sqrt(expected * np.clip(measured, *SPREAD_BOUNDS))


def _side(reading: HandReading) -> float:
    """Side of the square around a hand, pixels; at least one."""
    return max(region_of_landmarks(reading.landmarks_2d).side, 1.0)


def _facing(landmarks: Float[np.ndarray, "landmark=21 3"]) -> float:
    """Share of the palm's normal along the view: 1 for a palm parallel to the image, 0 seen edge-on."""
    index, little = landmarks[[INDEX_MCP, LITTLE_MCP]] - landmarks[WRIST]
    normal = np.cross(index, little)
    return float(abs(normal[2]) / max(float(np.linalg.norm(normal)), 1e-12))


def _curl(landmarks: Float[np.ndarray, "landmark=21 3"]) -> Float[np.ndarray, "landmark=21"]:
    """Sum of the angles between bones up to each landmark, radians; 0 at MCPs and the thumb's CMC."""
    parents = np.array((ROOT_LANDMARK, *LANDMARK_PARENTS[1:]))
    bones = landmarks - landmarks[parents]
    bones = bones / np.maximum(np.linalg.norm(bones, axis=1, keepdims=True), 1e-12)
    cosine = np.clip((bones * bones[parents]).sum(axis=1), -1, 1)
    curl = np.zeros(21)
    for landmark, parent in enumerate(LANDMARK_PARENTS):
        if parent > 0:
            curl[landmark] = curl[parent] + np.arccos(cosine[landmark])
    return curl
