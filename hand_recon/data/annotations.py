"""Images of hands with what is known of each: what the files of every dataset amount to (Sec. 4.1).

A dataset's own module turns its files into one such table; cutting, mirroring, caching and skipping what
cannot be read are then the same for all (`hand_recon.data.annotated_dataset`).
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float


@runtime_checkable
class ImageFiles(Protocol):
    """Files by row; a list of paths, or something that makes them when asked."""

    def __len__(self) -> int: ...

    def __getitem__(self, row: int, /) -> Path: ...


Surfaces = Callable[[int], "np.ndarray | None"]
"""Row → ground truth vertices (vertex, 3), camera's frame, metres, of the hand as it is: not mirrored."""


@dataclass(frozen=True)
class AnnotatedHands:
    """One row per hand in an image. Pixels are those of the whole image; what is unknown is NaN.

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
    """Changes whenever an image or a label does."""
    landmarks_2d: Float[np.ndarray, "row landmark=21 2"]
    """Labels in FreiHAND's order; NaN where there is none."""
    left: Bool[np.ndarray, " row"] | None = None
    """Which hands are left ones; none if all are right."""
    intrinsics: Float[np.ndarray, "row 3 3"] | None = None
    """Camera matrices; none if the cameras are unknown."""
    landmarks_3d: Float[np.ndarray, "row landmark=21 3"] | None = None
    """Ground truth in the camera's frame, metres."""
    boxes: Float[np.ndarray, "row 4"] | None = None
    """Left, top, right and bottom of each hand."""
    occluded: Bool[np.ndarray, "row landmark=21"] | None = None
    """Which landmarks cannot be seen."""
    confidence: Float[np.ndarray, "row landmark=21"] | None = None
    """How sure of each landmark whoever placed it was, from 0 to 1."""
    label_noise: Float[np.ndarray, "row landmark=21"] | None = None
    """Standard deviation of each label, pixels of the image."""
    masks: ImageFiles | None = None
    """Where each hand is white in an image of the same size."""
    surfaces: Surfaces | None = None
    """Ground truth surfaces, made or read when asked for."""

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
        """What a sample is called: its image's path inside the dataset."""
        path = self.images[row]
        return (path.relative_to(self.root) if path.is_relative_to(self.root) else path).as_posix()

    def is_left(self, row: int) -> bool:
        """Whether a row's hand is a left one."""
        return self.left is not None and bool(self.left[row])
