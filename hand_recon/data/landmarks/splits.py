"""Training, validation and test splits of images with 2D landmarks; no image is in two splits."""

import logging
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Int

from hand_recon.data.annotated_dataset import AnnotatedImages, ImageRecipe
from hand_recon.data.annotations import AnnotatedHands
from hand_recon.data.crop import CropPolicy
from hand_recon.data.crop_reader import ReadingPolicy
from hand_recon.data.landmarks.files import read_landmarks
from hand_recon.data.landmarks.hint import folders_of, read_hint
from hand_recon.data.landmarks.image_files import annotate, scene
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.data.landmarks.parsed import Assumptions

logger = logging.getLogger(__name__)

AROUND: Final = ("joints", "box", "full", "centre")
"""Choices of what a crop is made around; landmark files have no masks."""


@dataclass(frozen=True)
class LandmarkRecipe:
    """Settings of a dataset of landmark files: files, splits, crops and reading.

    Raises:
        ValueError: An option has an unknown value.
    """

    train: Path | str
    """Landmarks of the training images: a file, a folder of HInt, or HInt's whole archive."""
    val: Path | str | None = None
    """Landmarks for validation; None takes HInt's own, else a share of the training images."""
    test: Path | str | None = None
    """Landmarks for testing; None takes HInt's own, else a share of the training images."""
    images: Path | str | None = None
    """Folder of the images, if it is not that of the file."""
    side: str | None = None
    """Side of hands whose side a file does not give; None refuses such a file."""
    order: str = "freihand"
    """Order of the landmarks, a key of `hand_recon.hand.skeleton.LANDMARK_ORDERS`."""
    third_value: str = "auto"
    """Meaning of a third value that a file does not name: `auto`, `confidence`, `sigma` or `ignore`."""
    placeholders: str = "missing"
    """Treatment of exactly (0, 0) or (−1, −1) without a score: `missing` or `keep`."""
    min_side: float = 24.0
    """Smallest side of a hand's box, pixels of the image; smaller hands are left out."""
    val_fraction: float = 0.1
    """Share of the training images for validation where no file is given; as many again for testing."""
    split_seed: int = 0
    """Seed of the split, the same for all seeds of a study."""
    train_size: int | None = None
    """Number of training images, drawn by `split_seed`; None takes all that are not held out."""
    exchanged: int = 0
    """Number of further training hands with fingers of other hands (`exchanged.py`); needs a cache
    folder."""
    crop: CropPolicy = field(default_factory=lambda: CropPolicy(around="joints"))
    """Size and position of the crops."""
    reading: ReadingPolicy = field(default_factory=ReadingPolicy)
    """Caches and the number of missing or damaged images allowed."""

    def __post_init__(self) -> None:
        self.assumed()
        if self.exchanged < 0 or (self.exchanged and self.reading.folder is None):
            raise ValueError(
                f"exchanged={self.exchanged}: such hands are made once and kept in a cache; expected 0, "
                "or more and reading.cache_dir for their folder."
            )
        if self.train_size is not None and self.train_size < 1:
            raise ValueError(
                f"train_size={self.train_size}; expected the number of training images, 1 or more, or null "
                "for all."
            )
        if self.crop.around not in AROUND:
            raise ValueError(
                f"Crops around {self.crop.around!r} need what landmark files do not have; choose one of "
                f"{list(AROUND)}."
            )
        if not 0 < self.val_fraction < 0.5:
            raise ValueError(
                f"val_fraction={self.val_fraction} must lie between 0 and 0.5, so that images are left to "
                "train on."
            )

    def assumed(self) -> Assumptions:
        """Assumed values of what a file does not specify."""
        images = None if self.images is None else Path(self.images).expanduser().absolute()
        return Assumptions(self.third_value, self.side, self.order, images, self.placeholders)

    def source(self, split: str) -> Path | None:
        """Path of a split's landmarks; None if the split is a share of the training images."""
        given = {"train": self.train, "val": self.val, "test": self.test}[split]
        if given is not None:
            return Path(given).expanduser().absolute()
        train = Path(self.train).expanduser().absolute()
        return train if train.is_dir() and folders_of(train, split) else None


class LandmarkSplits:
    """The datasets of a recipe; a file that several splits share is read once."""

    def __init__(self, recipe: LandmarkRecipe) -> None:
        """Store the recipe; files are read on first use."""
        self.recipe = recipe

    def dataset(self, split: str) -> AnnotatedImages:
        """The dataset of a split, built on each call.

        Args:
            split: `train`, `val` or `test`.

        Raises:
            FileNotFoundError: A file is missing, or all images are.
            ValueError: A file cannot be parsed or used, or there are too few images to share.
            RuntimeError: More images are missing or damaged than allowed.
        """
        recipe = self.recipe
        # Crops are made around the table's boxes (`hand_frames`).
        around = "box" if recipe.crop.around == "joints" else recipe.crop.around
        cut = ImageRecipe(replace(recipe.crop, around=around), recipe.reading)
        source = recipe.source(split)
        if split == "train" or source is None:
            if split == "test":
                logger.warning(
                    "No test landmarks: testing on %d held-out hands of %s.",
                    len(self._shares["test"]), recipe.train,
                )  # fmt: skip
            every = np.arange(len(self.training_table))
            return AnnotatedImages(self.training_table, self._shares[split], cut, cached_rows=every)
        table = self._read(source, split)
        if "training_table" in vars(self):
            # Only if the training images are read already: a test alone does not need them.
            self._warn_of_shared_images(table, split)
        return AnnotatedImages(table, recipe=cut)

    @cached_property
    def training_table(self) -> AnnotatedHands:
        """All hands of the training images, before some are held out."""
        return self._read(Path(self.recipe.train).expanduser().absolute(), "train")

    @cached_property
    def _shares(self) -> dict[str, Int[np.ndarray, " row"]]:
        """Rows of the training table for each split without a file; all hands of an image stay together."""
        recipe = self.recipe
        scenes, of_row = np.unique(scenes_of(self.training_table), return_inverse=True)
        held_out = [split for split in ("val", "test") if recipe.source(split) is None]
        count = max(1, round(recipe.val_fraction * len(scenes)))
        if len(scenes) <= count * len(held_out):
            raise ValueError(
                f"{recipe.train} has {len(scenes)} images, too few to train on and to hold some out for "
                f"{' and '.join(held_out)}. Give files as data.val and data.test, or more images."
            )
        order = np.random.default_rng(recipe.split_seed).permutation(len(scenes))
        shares, start = {}, 0
        for split in held_out:
            shares[split] = np.flatnonzero(np.isin(of_row, order[start : start + count]))
            start += count
        end = None if recipe.train_size is None else start + recipe.train_size
        if end is not None and end > len(scenes):
            raise ValueError(
                f"train_size={recipe.train_size}, and {recipe.train} has {len(scenes) - start} images to "
                "train on. Ask for fewer, or null for all."
            )
        shares["train"] = np.flatnonzero(np.isin(of_row, order[start:end]))
        return shares

    def _read(self, source: Path, split: str) -> AnnotatedHands:
        recipe = self.recipe
        landmarks: ImageLandmarks
        if source.is_dir():
            landmarks = read_hint(source, split, recipe.assumed())
        else:
            landmarks = read_landmarks(source, assumed=recipe.assumed())
        root = recipe.assumed().images or (source if source.is_dir() else source.parent)
        return annotate(landmarks, root, recipe.crop.around, recipe.min_side)

    def _warn_of_shared_images(self, table: AnnotatedHands, split: str) -> None:
        shared = set(scenes_of(table)) & set(scenes_of(self.training_table))
        if shared:
            logger.warning(
                "%d of the %s images are training images too, so that its scores are too good; the "
                "first: %s.",
                len(shared), split, min(shared),
            )  # fmt: skip


def scenes_of(table: AnnotatedHands) -> list[str]:
    """Names of the images of a table's rows that must stay in one split (`scene`)."""
    return [scene(table.images[row]) for row in range(len(table))]
