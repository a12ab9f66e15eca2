"""Dataset of crops of annotated images, shared by all datasets with image files (Sec. 4.1)."""

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
    """Settings for cutting and reading a dataset's crops."""

    crop: CropPolicy = field(default_factory=CropPolicy)
    """Size and position of the crops."""
    reading: ReadingPolicy = field(default_factory=ReadingPolicy)
    """Caches and the number of damaged images allowed."""


@dataclass(frozen=True)
class Benchmark:
    """Facts about the test hands that a benchmark's protocol needs."""

    protocol: str
    """A key of `hand_recon.protocols.benchmarks.PROTOCOLS`."""
    ids: Int[np.ndarray, " sample"] | None = None
    """Id of each hand in a results file; None where the position in the file is the id."""
    wrists: Float[np.ndarray, "sample 3"] | None = None
    """Given position of each wrist, camera frame, metres."""
    left_out: int = 0
    """Number of the benchmark's test hands that are missing here."""


class AnnotatedImages(Dataset[HandSample]):
    """Dataset of some rows of a table of annotated images; left hands are mirrored to right ones.

    An image that cannot be read is skipped with a warning and replaced by the next readable one.
    """

    benchmark: Benchmark | None = None
    """Benchmark of these test hands; None for training hands and for hands held out of them."""

    def __init__(
        self,
        hands: AnnotatedHands,
        rows: Int[np.ndarray, " row"] | None = None,
        recipe: ImageRecipe | None = None,
        *,
        cached_rows: Int[np.ndarray, " cached"] | None = None,
    ) -> None:
        """Open the cache of crops, or build it, if a cache folder is set.

        Args:
            hands: The whole table.
            rows: Rows of this split, in its order; None for all.
            recipe: Settings for cutting and reading.
            cached_rows: Rows that any split may read, so that all splits share one cache; by default this
                split's rows.

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
        """The sample at a position, or the next one with a readable image.

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
                return to_sample(self.hands, int(self.rows[position]), crop, position)
        raise RuntimeError(
            f"No image of {self.hands.name} in {self.hands.root} can be read; unpack the archive again."
        )


def to_sample(hands: AnnotatedHands, row: int, crop: Crop, index: int) -> HandSample:
    """Sample of a hand whose crop was read: labels and camera in the crop, mirrored with it.

    Args:
        hands: The table.
        row: Row of the hand.
        crop: Its crop.
        index: Its position in the dataset.
    """
    left = hands.is_left(row)
    labels = crop_points(hands.landmarks_2d[row], crop.matrix)
    intrinsics = _row(hands.intrinsics, row)
    if intrinsics is not None:
        # The camera's x axis is mirrored too, so that f_x stays positive in a mirrored crop.
        intrinsics = crop_intrinsics(intrinsics, crop.matrix) * _mirror(left)
    surface = None if hands.surfaces is None else hands.surfaces(row)
    return HandSample(
        image=torch.from_numpy(crop.pixels),
        landmarks_2d=torch.from_numpy(labels).float(),
        labelled=torch.from_numpy(np.isfinite(labels).all(axis=-1)),
        index=index,
        source=hands.source(row),
        intrinsics=None if intrinsics is None else torch.from_numpy(intrinsics).float(),
        landmarks_3d=_points(_row(hands.landmarks_3d, row), left),
        vertices=_points(surface, left),
        occluded=None if hands.occluded is None else torch.from_numpy(hands.occluded[row].copy()),
        confidence=None
        if hands.confidence is None
        else torch.from_numpy(hands.confidence[row]).float(),
        label_noise=_scaled(_row(hands.label_noise, row), crop.matrix),
        mirrored=left,
    )


def _mirror(left: bool) -> Float[np.ndarray, " 3"]:
    """Factors of the axes: −1 for x of left hands, else 1."""
    return np.array([-1.0, 1.0, 1.0]) if left else np.ones(3)


def _row(column: np.ndarray | None, row: int) -> np.ndarray | None:
    """An entry of a column; None where it is unknown."""
    if column is None or np.isnan(column[row]).all():
        return None
    return np.asarray(column[row])


def _scaled(
    lengths: Float[np.ndarray, " landmark"] | None, matrix: Float[np.ndarray, "3 3"]
) -> Float[Tensor, " landmark"] | None:
    """Convert lengths from pixels of the image to pixels of the crop."""
    scale = np.sqrt(abs(np.linalg.det(matrix[:2, :2])))
    return None if lengths is None else torch.from_numpy(lengths * scale).float()


def _points(
    points: Float[np.ndarray, "point 3"] | None, left: bool
) -> Float[Tensor, "point 3"] | None:
    return None if points is None else torch.from_numpy(points * _mirror(left)).float()
