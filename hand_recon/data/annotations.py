"""Table of annotated hands, the common form of every dataset with image files (Sec. 4.1).

A dataset's own module reads its files into one such table; cropping, mirroring, caching and the skipping of
unreadable images are then shared (`hand_recon.data.annotated_dataset`).
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float


@runtime_checkable
class ImageFiles(Protocol):
    """Image file of each row: a list of paths, or an object that makes paths on request."""

    def __len__(self) -> int: ...

    def __getitem__(self, row: int, /) -> Path: ...


Surfaces = Callable[[int], "np.ndarray | None"]
"""Function from a row to its ground truth vertices (vertex, 3), camera frame, metres, not mirrored."""


@dataclass(frozen=True)
class AnnotatedHands:
    """Table with one row per hand; pixels are those of the whole image, unknown values are NaN.

    Raises:
        ValueError: Columns differ in length.
    """

    name: str
    """Dataset and part, for messages and the names of caches."""
    root: Path
    """The dataset's folder: samples are named by their image's path from here."""
    images: ImageFiles
    """The image of each row; several hands may share one."""
    fingerprint: str
    """Digest that changes when an image or a label changes."""
    landmarks_2d: Float[np.ndarray, "row landmark=21 2"]
    """Labels in FreiHAND's order; NaN where there is none."""
    left: Bool[np.ndarray, " row"] | None = None
    """True for left hands; None if all are right."""
    intrinsics: Float[np.ndarray, "row 3 3"] | None = None
    """Camera matrices, pixels; None if the cameras are unknown."""
    landmarks_3d: Float[np.ndarray, "row landmark=21 3"] | None = None
    """Ground truth landmarks, camera frame, metres."""
    boxes: Float[np.ndarray, "row 4"] | None = None
    """Left, top, right and bottom of each hand, pixels."""
    occluded: Bool[np.ndarray, "row landmark=21"] | None = None
    """True for landmarks that cannot be seen."""
    confidence: Float[np.ndarray, "row landmark=21"] | None = None
    """Detector confidence, 0 to 1."""
    label_noise: Float[np.ndarray, "row landmark=21"] | None = None
    """Standard deviation of each label, pixels of the image."""
    masks: ImageFiles | None = None
    """Mask of each hand, white on black, of the image's size."""
    surfaces: Surfaces | None = None
    """Ground truth surfaces, made or read on request."""

    def __post_init__(self) -> None:
        for name, column in vars(self).items():
            counted = isinstance(column, np.ndarray) or name == "images"
            if counted and len(column) != len(self):
                raise ValueError(
                    f"{self.name}: {len(column)} {name} for {len(self)} hands; expected one per hand."
                )

    def __len__(self) -> int:
        return len(self.landmarks_2d)

    def source(self, row: int) -> str:
        """Name of a sample: its image's path inside the dataset."""
        path = self.images[row]
        return (path.relative_to(self.root) if path.is_relative_to(self.root) else path).as_posix()

    def is_left(self, row: int) -> bool:
        """True if a row's hand is a left hand."""
        return self.left is not None and bool(self.left[row])
