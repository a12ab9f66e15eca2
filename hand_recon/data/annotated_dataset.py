"""Crops of annotated images as a dataset: one way from any files to samples (Sec. 4.1)."""

from dataclasses import dataclass, field

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.utils.data import Dataset

from hand_recon.data.annotations import AnnotatedHands
from hand_recon.data.crop import CropPolicy, crop_intrinsics, crop_points
from hand_recon.data.crop_reader import Crop, CropReader, ReadingPolicy
from hand_recon.schema import HandSample


@dataclass(frozen=True)
class ImageRecipe:
    """How a dataset's crops are cut out and read."""

    crop: CropPolicy = field(default_factory=CropPolicy)
    """Size and position of the crops."""
    reading: ReadingPolicy = field(default_factory=ReadingPolicy)
    """Caches, and how many damaged images are too many."""


@dataclass(frozen=True)
class Benchmark:
    """What a benchmark needs to know of its test hands."""

    protocol: str
    """A key of `hand_recon.protocols.benchmarks.PROTOCOLS`."""
    ids: Int[np.ndarray, " sample"] | None = None
    """What each hand is called in a file of results; none where its place says it."""
    wrists: Float[np.ndarray, "sample 3"] | None = None
    """Where each wrist is told to be, camera frame, metres."""
    left_out: int = 0
    """Test hands of the benchmark that are not among these."""


class AnnotatedImages(Dataset[HandSample]):
    """Some rows of a table of annotated images. Left hands come mirrored, as right ones.

    An image that cannot be read is skipped with a warning, and the next one takes its place.
    """

    benchmark: Benchmark | None = None
    """Whose test hands these are; none for training hands, and for hands that were held out of them."""

    def __init__(
        self,
        hands: AnnotatedHands,
        rows: Int[np.ndarray, " row"] | None = None,
        recipe: ImageRecipe | None = None,
        *,
        cached_rows: Int[np.ndarray, " cached"] | None = None,
    ) -> None:
        """Open, or make, the cache of crops if there is a folder for it.

        Args:
            hands: The whole table.
            rows: Those of this split, in its order; none for all.
            recipe: How to cut and read.
            cached_rows: Those that some split may ask for, so that all share one cache; by default this
                split's own.

        Raises:
            RuntimeError: More images are damaged than allowed.
        """
        recipe = recipe or ImageRecipe()
        self.hands = hands
        self.rows = np.arange(len(hands)) if rows is None else rows
        kept = self.rows if cached_rows is None else cached_rows
        self.reader = CropReader(hands, kept, recipe.crop, recipe.reading)

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, index: int) -> HandSample:
        """The sample at a position, or the next one whose image can be read.

        Raises:
            IndexError: There is no such position.
            RuntimeError: Too many images cannot be read.
        """
        if not 0 <= index < len(self):
            raise IndexError(f"Sample {index} of {len(self)}.")
        for step in range(len(self)):
            position = (index + step) % len(self)
            crop = self.reader.read(int(self.rows[position]))
            if crop is not None:
                return self._sample(position, crop)
        raise RuntimeError(
            f"No image of {self.hands.name} in {self.hands.root} can be read; unpack the archive again."
        )

    def _sample(self, position: int, crop: Crop) -> HandSample:
        hands, row = self.hands, int(self.rows[position])
        left = hands.is_left(row)
        labels = crop_points(hands.landmarks_2d[row], crop.matrix)
        intrinsics = _row(hands.intrinsics, row)
        if intrinsics is not None:
            # The mirror turns the camera's x round too, so that a right hand stands before a real camera.
            intrinsics = crop_intrinsics(intrinsics, crop.matrix) * _mirror(left)
        surface = None if hands.surfaces is None else hands.surfaces(row)
        return HandSample(
            image=torch.from_numpy(crop.pixels),
            landmarks_2d=torch.from_numpy(labels).float(),
            labelled=torch.from_numpy(np.isfinite(labels).all(axis=-1)),
            index=position,
            source=hands.source(row),
            intrinsics=None if intrinsics is None else torch.from_numpy(intrinsics).float(),
            landmarks_3d=_points(_row(hands.landmarks_3d, row), left),
            vertices=_points(surface, left),
            occluded=None
            if hands.occluded is None
            else torch.from_numpy(hands.occluded[row].copy()),
            confidence=None
            if hands.confidence is None
            else torch.from_numpy(hands.confidence[row]).float(),
            label_noise=_scaled(_row(hands.label_noise, row), crop.matrix),
            mirrored=left,
        )


def _mirror(left: bool) -> Float[np.ndarray, " 3"]:
    """Negates x for left hands."""
    return np.array([-1.0, 1.0, 1.0]) if left else np.ones(3)


def _row(column: np.ndarray | None, row: int) -> np.ndarray | None:
    """An entry of a column; none where it is not known."""
    if column is None or np.isnan(column[row]).all():
        return None
    return np.asarray(column[row])


def _scaled(
    lengths: Float[np.ndarray, " landmark"] | None, matrix: Float[np.ndarray, "3 3"]
) -> Float[Tensor, " landmark"] | None:
    """Lengths of the image in the crop, which may be mirrored."""
    scale = np.sqrt(abs(np.linalg.det(matrix[:2, :2])))
    return None if lengths is None else torch.from_numpy(lengths * scale).float()


def _points(
    points: Float[np.ndarray, "point 3"] | None, left: bool
) -> Float[Tensor, "point 3"] | None:
    return None if points is None else torch.from_numpy(points * _mirror(left)).float()
