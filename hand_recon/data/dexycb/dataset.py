"""DexYCB: right and left hands with cameras, 2D and 3D labels; left ones are mirrored (Sec. 4.1).

Crops are cut around the labelled joints. Frames without a labelled hand are dropped, and their number is
logged; the others keep their official ids, so that a results file can be written.
"""

import logging
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from hand_recon.data.annotated_dataset import AnnotatedImages, Benchmark, ImageRecipe
from hand_recon.data.annotations import AnnotatedHands
from hand_recon.data.cache import digest
from hand_recon.data.crop import CropPolicy
from hand_recon.data.crop_reader import ReadingPolicy
from hand_recon.data.dexycb.files import (
    SIZE,
    SUBJECTS,
    find_root,
    image_path,
    present,
    read_betas,
    read_grasps,
    read_intrinsics,
)
from hand_recon.data.dexycb.labels import (
    check_labels,
    labelled_rows,
    read_labels,
)
from hand_recon.data.dexycb.listing import digest_files
from hand_recon.data.dexycb.splits import PARTS, SETUPS, Frames, enumerate_frames, split_named
from hand_recon.data.dexycb.surfaces import GT_MODES, DexYcbSurfaces, load_pair
from hand_recon.data.images import read_image

logger = logging.getLogger(__name__)

AROUND_JOINTS: Final = CropPolicy(around="joints", expansion=1.5)
"""Crop policy that peers use for DexYCB."""


@dataclass(frozen=True)
class DexYcbRecipe:
    """Settings of DexYCB: setup, subjects, crops and reading.

    Raises:
        ValueError: An option has an unknown value.
    """

    root: Path | str | None
    """The folder that holds `20200709-subject-01`."""
    setup: str = "s0"
    """One of `SETUPS`."""
    crop: CropPolicy = AROUND_JOINTS
    """Size and position of the crops."""
    reading: ReadingPolicy = field(default_factory=ReadingPolicy)
    """Caches and the number of damaged images allowed."""
    label_workers: int = 2
    """Number of processes that read the labels, once."""
    partial: bool = False
    """Allow missing subjects, for training on the others; scores are then not the benchmark's."""
    train_every: int = 1
    """Use every n-th frame of the training part; consecutive frames are a thirtieth of a second apart."""
    val_every: int = 1
    """The same of the validation part."""
    test_every: int = 1
    """The same of the test part; numbers on a thinned one are not the official ones."""
    gt_mode: str = "official"
    """Construction of left hands' surfaces, one of `GT_MODES`."""
    mano: Path | str | None = None
    """Folder of MANO's hands, which the surfaces are computed with."""
    topology: str = "open"
    """The hand model's name: MANO's surfaces are compared with MANO only."""

    def __post_init__(self) -> None:
        if self.setup not in SETUPS:
            raise ValueError(f"Unknown setup {self.setup!r}; choose one of {list(SETUPS)}.")
        if self.gt_mode not in GT_MODES:
            raise ValueError(f"Unknown gt_mode {self.gt_mode!r}; choose one of {list(GT_MODES)}.")
        steps = [getattr(self, f"{part}_every") for part in PARTS]
        if min(steps) < 1:
            raise ValueError(
                f"train_every, val_every, test_every are {steps}; all must be 1 or more."
            )


class DexYcb(AnnotatedImages):
    """One part of a setup of DexYCB."""

    ids: Int[np.ndarray, " sample"]
    """The official number of each sample's frame in its part: its id in a file of results."""
    missing: str
    """Names of the subjects that are missing."""

    def __init__(self, split: str, recipe: DexYcbRecipe, with_vertices: bool | None = None) -> None:
        """Read the labels once; images are read on request, or once into the cache.

        Args:
            split: `train`, `val` or `test`.
            recipe: All other settings.
            with_vertices: Load the surfaces; by default only for test hands.

        Raises:
            FileNotFoundError: A file or a subject is missing.
            ValueError: The files contradict each other, or there is no such split.
            RuntimeError: More images are damaged than allowed.
        """
        self.split = split
        self.recipe = recipe
        self.name = f"{recipe.setup}-{split}"
        self.root = find_root(recipe.root)
        frames = self._frames()
        wanted = np.arange(0, len(frames), getattr(recipe, f"{split}_every"))
        frames = frames.select(wanted)
        self._files = digest_files(frames)
        labels = read_labels(
            frames, self.name, recipe.reading.folder, recipe.label_workers, self._files
        )
        kept = labelled_rows(labels, self.name)
        self.ids = wanted[kept]
        whole = not self.missing and recipe.test_every == 1
        if split == "test" and whole:
            self.benchmark = Benchmark(f"dexycb_{recipe.setup}", ids=self.ids)
        self.frames, self.labels = frames.select(kept), labels.select(kept)
        self.left = _of_grasps(self.frames, [grasp.left for grasp in frames.grasps])
        table = self._annotated(split == "test" if with_vertices is None else with_vertices)
        super().__init__(table, recipe=ImageRecipe(recipe.crop, recipe.reading))

    def surfaces(self) -> DexYcbSurfaces | None:
        """MANO's surfaces posed by the labels; None, with a warning, if MANO is missing."""
        pair = load_pair(self.recipe.mano, left_hands=bool(self.left.any()))
        if pair is None:
            return None
        names = [grasp.calibration for grasp in self.frames.grasps]
        betas = {name: read_betas(self.root, name) for name in sorted(set(names))}
        return DexYcbSurfaces(
            pair,
            self.labels.pose_m,
            _of_grasps(self.frames, [betas[name] for name in names]),
            self.left,
            self.recipe.gt_mode,
        )

    def _frames(self) -> Frames:
        """Every frame of the split, labelled or not."""
        split = split_named(self.recipe.setup, self.split)
        there = self._subjects(split.subjects)
        step = getattr(self.recipe, f"{self.split}_every")
        if step > 1 and self.split == "test":
            logger.warning(
                "DexYCB %s: every %d-th frame only: numbers are not the benchmark's.",
                self.name,
                step,
            )
        grasps = [grasp for subject in there for grasp in read_grasps(self.root, subject)]
        return enumerate_frames(split, grasps)

    def _subjects(self, wanted: tuple[int, ...]) -> list[int]:
        """The split's subjects that are there; an error if the missing ones are needed."""
        there = present(self.root, wanted)
        missing = ", ".join(SUBJECTS[subject] for subject in wanted if subject not in there)
        self.missing = missing
        if not missing:
            return there
        if self.recipe.partial and there:
            logger.warning(
                "DexYCB %s without %s: numbers are not the benchmark's, and neither are the ids in a file of "
                "results, which count the frames of all subjects.", self.name, missing,
            )  # fmt: skip
            return there
        cure = "or set data.partial=true to do without: numbers are then not the benchmark's"
        raise FileNotFoundError(
            f"{self.root} lacks {len(wanted) - len(there)} of the {len(wanted)} subjects of DexYCB "
            f"{self.name}: {missing}. Unpack them there, "
            f"{cure if there else 'or choose a data.setup whose parts have other subjects'}."
        )

    def _annotated(self, with_vertices: bool) -> AnnotatedHands:
        frames = self.frames
        intrinsics = read_intrinsics(self.root)[frames.camera]
        check_labels(self.labels, intrinsics, self.name)
        self._check_size()
        return AnnotatedHands(
            name=f"dexycb-{self.name}",
            root=self.root,
            images=_Images(frames),
            fingerprint=digest(vars(self._files), self.labels.joint_2d),
            landmarks_2d=self.labels.joint_2d,
            left=self.left,
            intrinsics=intrinsics,
            landmarks_3d=self.labels.joint_3d,
            surfaces=self._comparable_surfaces() if with_vertices else None,
        )

    def _comparable_surfaces(self) -> DexYcbSurfaces | None:
        """Surfaces; None if the hand model numbers its vertices differently."""
        if self.recipe.topology == "mano":
            return self.surfaces()
        logger.warning(
            "DexYCB's surfaces are MANO's, which cannot be compared vertex by vertex with hand=%s: vertex "
            "metrics are left out; hand=mano has them.", self.recipe.topology,
        )  # fmt: skip
        return None

    def _check_size(self) -> None:
        """Refuse images of a size that the camera matrices are not for."""
        path = _Images(self.frames)[0]
        image = read_image(path)
        if image is not None and image.shape[:2] != SIZE:
            height, width = image.shape[:2]
            raise ValueError(
                f"{path} has {width} × {height} pixels; labels and cameras are for {SIZE[1]} × {SIZE[0]}. "
                "Use the images as they were released; crops are cut and kept (data.reading.decode_cache)."
            )


class _Images:
    """Image files of some frames."""

    def __init__(self, frames: Frames) -> None:
        self.frames = frames

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, row: int) -> Path:
        frames = self.frames
        grasp = frames.grasps[int(frames.grasp[row])]
        return image_path(grasp, int(frames.camera[row]), int(frames.number[row]))


def _of_grasps(
    frames: Frames, values: list[bool] | list[Float[np.ndarray, " direction"]]
) -> Bool[np.ndarray, " frame"] | Float[np.ndarray, "frame direction"]:
    """Values of sequences, repeated for their frames."""
    return np.asarray(values)[frames.grasp]
