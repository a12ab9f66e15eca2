"""HO3D v3 and v2: right hands with objects, camera matrices and 3D landmarks (Sec. 4.1).

HO3D's axes (OpenGL's) and landmark order are converted to the project's here. 2D labels are projected from
the 3D ones, as HO3D stores none; crops are cut around them in training and around HO3D's own boxes in its
evaluation part.
"""

import logging
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from hand_recon.camera import project_array
from hand_recon.data.annotated_dataset import AnnotatedImages, Benchmark, ImageRecipe
from hand_recon.data.annotations import AnnotatedHands, Surfaces
from hand_recon.data.cache import digest
from hand_recon.data.crop import CropPolicy
from hand_recon.data.crop_reader import ReadingPolicy
from hand_recon.data.held_out import check_held_out
from hand_recon.data.ho3d.annotations import Annotations, read_annotations
from hand_recon.data.ho3d.checks import check_landmarks, check_wrists_inside
from hand_recon.data.ho3d.files import COUNTS, FrameImages, Ho3dPart, open_part
from hand_recon.data.ho3d.ground_truth import (
    HOW_TO_GET,
    EvaluationGroundTruth,
    find_ground_truth,
    load_ground_truth,
)
from hand_recon.data.ho3d.splits import split_frames
from hand_recon.data.ho3d.surfaces import ManoHands, load_mano_if_there
from hand_recon.data.images import read_image
from hand_recon.hand.mano.hand import INSPECTED_HANDS, follows_mano

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Ho3dRecipe:
    """Settings of HO3D: files, splits, crops and reading.

    Raises:
        ValueError: An option has an unknown value.
    """

    root: Path | str
    """The folder that holds `train.txt` and `evaluation.txt`."""
    version: str = "v3"
    """`v3` or `v2`."""
    eval_root: Path | str | None = None
    """The folder that holds `evaluation_xyz.json`, if it is not the root."""
    crop: CropPolicy = field(default_factory=lambda: CropPolicy(around="joints"))
    """Size and position of the crops."""
    test_crop: CropPolicy | None = None
    """Size and position of the test crops, if different: evaluation frames have boxes and no landmarks."""
    reading: ReadingPolicy = field(default_factory=ReadingPolicy)
    """Caches and the number of damaged images allowed."""
    val_fraction: float = 0.1
    """Smallest share of the training frames for validation, in whole recordings; as many again for testing
    without ground truth of the evaluation part."""
    split_seed: int = 0
    """Seed of the split, the same for all seeds of a study."""
    test_source: str = "auto"
    """`evaluation`, `held_out` training recordings, or `auto`: the former where it has ground truth."""
    mano: Path | str | None = None
    """Folder of the user's MANO, for the surfaces of training hands; None leaves them out."""
    vertices: int | None = 778
    """Vertices of the hand model; surfaces with another number are left out. None takes any."""
    topology: str = "open"
    """The hand model's name: MANO's surfaces are compared with MANO only."""

    def __post_init__(self) -> None:
        if self.version not in COUNTS:
            raise ValueError(f"Unknown HO3D version {self.version!r}; choose one of {[*COUNTS]}.")
        check_held_out(self.test_source, self.val_fraction)

    @property
    def folder(self) -> Path:
        """The root, with `~` expanded."""
        return Path(self.root).expanduser()


class Ho3d(AnnotatedImages):
    """One split of HO3D."""

    wrists: Float[np.ndarray, "sample 3"] | None = None
    """Each sample's wrist, camera frame, metres: HO3D gives it for its evaluation frames, so that a
    submission can be placed. None for training frames."""

    def __init__(self, split: str, recipe: Ho3dRecipe, with_vertices: bool | None = None) -> None:
        """Read the annotations; images are read on request, or once into the cache.

        Args:
            split: `train`, `val` or `test`.
            recipe: All other settings.
            with_vertices: Load the surfaces; by default only for test hands. Those of training frames are
                computed by MANO, where `recipe.mano` has it.

        Raises:
            FileNotFoundError: A file is missing.
            ValueError: The files contradict each other, or there is no such split.
            RuntimeError: More images are damaged than allowed.
        """
        if split not in ("train", "val", "test"):
            raise ValueError(f"Unknown split {split!r}; choose train, val or test.")
        self.split = split
        self.recipe = recipe
        ground_truth_folder = find_ground_truth(recipe.folder, recipe.eval_root)
        held_out = recipe.test_source == "held_out" or (
            recipe.test_source == "auto" and ground_truth_folder is None
        )
        benchmark = split == "test" and not held_out
        name = "evaluation" if benchmark else "train"
        self.part = open_part(recipe.folder, name, recipe.version)
        self.annotations = read_annotations(self.part, recipe.reading)
        kept = _annotated_rows(self.part, self.annotations)
        wanted = split == "test" if with_vertices is None else with_vertices
        if benchmark:
            rows = kept
            table = self._evaluation_table(ground_truth_folder, wanted)
            self.wrists = self.annotations.points[rows, 0]
            left_out = len(self.part.frames) - len(rows)
            self.benchmark = Benchmark(
                f"ho3d_{recipe.version}", wrists=self.wrists, left_out=left_out
            )
        else:
            rows = kept[self._rows_of_split([self.part.frames[row] for row in kept], held_out)]
            table = self._training_table(wanted)
        self._check(table, kept)
        crop = recipe.test_crop if split == "test" and recipe.test_crop is not None else recipe.crop
        # Splits of the training part with the same crop policy share one map of crops.
        shared = not benchmark and crop == recipe.crop
        super().__init__(
            table, rows, ImageRecipe(crop, recipe.reading), cached_rows=kept if shared else rows
        )

    @property
    def frames(self) -> list[str]:
        """`SEQ/0000` of each sample."""
        return [self.part.frames[row] for row in self.rows]

    def _rows_of_split(self, frames: list[str], held_out: bool) -> Int[np.ndarray, " row"]:
        recipe = self.recipe
        splits = split_frames(frames, recipe.val_fraction, recipe.split_seed, with_test=held_out)
        if self.split == "test":
            logger.warning(
                "Testing on %d held-out training frames of %s; numbers on them are not HO3D's benchmark. For "
                "the benchmark, %s.", len(splits["test"]), self.part.root, HOW_TO_GET,
            )  # fmt: skip
        return splits[self.split]

    def _training_table(self, with_vertices: bool) -> AnnotatedHands:
        points = self.annotations.points
        labels = project_array(points, self.annotations.intrinsics)
        surfaces: Surfaces | None = None
        if with_vertices and self.recipe.topology == "mano":
            hands = self.mano_hands()
            surfaces = None if hands is None else hands.vertices
        elif with_vertices:
            logger.warning(
                "%s: only MANO has surfaces of the training hands, and they compare with hand=mano alone: "
                "vertex metrics are left out.", self.part.root,
            )  # fmt: skip
        return self._table(
            labels=labels,
            landmarks=points,
            boxes=np.concatenate([labels.min(axis=1), labels.max(axis=1)], axis=-1),
            surfaces=surfaces,
        )

    def _evaluation_table(self, folder: Path | None, with_vertices: bool) -> AnnotatedHands:
        annotations, count = self.annotations, len(self.part)
        if folder is None:
            logger.warning(
                "No ground truth for the evaluation frames of %s: their predictions can be written, not "
                "scored. %s; or test on held-out training frames with data.test_source=held_out.",
                self.part.root, HOW_TO_GET,
            )  # fmt: skip
            unknown = np.full((count, 21, 2), np.nan)
            return self._table(labels=unknown, landmarks=None, boxes=annotations.boxes)
        ground_truth = load_ground_truth(folder, self.part, annotations, self.recipe.reading.folder)
        comparable = with_vertices and self._comparable(ground_truth, folder)
        surfaces = ground_truth.surface if comparable else None
        return self._table(
            labels=project_array(ground_truth.landmarks, annotations.intrinsics),
            landmarks=ground_truth.landmarks,
            boxes=annotations.boxes,
            surfaces=surfaces,
        )

    def _table(
        self,
        *,
        labels: Float[np.ndarray, "frame landmark=21 2"],
        landmarks: Float[np.ndarray, "frame landmark=21 3"] | None,
        boxes: Float[np.ndarray, "frame 4"],
        surfaces: Surfaces | None = None,
    ) -> AnnotatedHands:
        return AnnotatedHands(
            name=f"ho3d-{self.part.name}",
            root=self.part.root,
            images=self.part.images,
            # The evaluation's landmarks are in files of their own, which the part's digest does not cover.
            fingerprint=digest(self.part.fingerprint, landmarks),
            landmarks_2d=labels,
            intrinsics=self.annotations.intrinsics,
            landmarks_3d=landmarks,
            boxes=boxes,
            surfaces=surfaces,
        )

    def mano_hands(self) -> ManoHands | None:
        """MANO's hands of the training part; None without MANO or for the evaluation part."""
        layer = load_mano_if_there(self.recipe.mano) if self.part.name == "train" else None
        return None if layer is None else ManoHands(layer, self.annotations, self.part.list_file)

    def _comparable(self, ground_truth: EvaluationGroundTruth, folder: Path) -> bool:
        """True if the surfaces are comparable with the hand model's, vertex by vertex."""
        vertices = ground_truth.raw_vertices
        if vertices is None:
            logger.warning("No evaluation_verts.json in %s: vertex metrics are left out.", folder)
            return False
        expected = self.recipe.vertices
        if expected is not None and vertices.shape[1] != expected:
            logger.warning(
                "%s has surfaces of %d vertices, the hand model %d: vertex metrics are left out.",
                folder, vertices.shape[1], expected,
            )  # fmt: skip
            return False
        if self.recipe.topology != "mano" and _follows_mano(ground_truth):
            logger.warning(
                "%s has MANO's surfaces, which cannot be compared vertex by vertex with hand=%s: "
                "vertex metrics are left out; hand=mano has them.", folder, self.recipe.topology,
            )  # fmt: skip
            return False
        return True

    def _check(self, table: AnnotatedHands, kept: Int[np.ndarray, " row"]) -> None:
        """Check the landmarks and cameras."""
        path, annotations = self.part.list_file, self.annotations
        names = [self.part.frames[row] for row in kept]
        if table.landmarks_3d is not None:
            check_landmarks(path, table.landmarks_3d[kept], names)
        size = _image_size(self.part.images, kept)
        if size is not None:
            wrists = project_array(annotations.points[kept, :1], annotations.intrinsics[kept])
            check_wrists_inside(path, wrists[:, 0], size)


def _annotated_rows(part: Ho3dPart, annotations: Annotations) -> Int[np.ndarray, " row"]:
    """Rows that have an annotation; the number without one is logged."""
    kept = np.flatnonzero(annotations.annotated)
    without = np.flatnonzero(part.present & ~annotations.annotated)
    if len(without):
        logger.warning(
            "%d of the %d frames of %s have no annotation in their meta and are left out; the first are %s.",
            len(without), len(part), part.list_file, ", ".join(part.frames[row] for row in without[:5]),
        )  # fmt: skip
    if not len(kept):
        raise ValueError(
            f"No frame of {part.list_file} has an annotation: unpack the archive again."
        )
    return kept


def _image_size(images: FrameImages, rows: Int[np.ndarray, " row"]) -> tuple[int, int] | None:
    """Width and height of the first of a few images that can be read."""
    for row in rows[:5]:
        image = read_image(images[int(row)])
        if image is not None:
            return image.shape[1], image.shape[0]
    return None


def _follows_mano(ground_truth: EvaluationGroundTruth) -> bool:
    """True if surfaces number their vertices as MANO does, so that MANO's tip vertices are the fingertips."""
    if ground_truth.raw_vertices is None:
        return False
    rows = range(min(INSPECTED_HANDS, len(ground_truth.landmarks)))
    surfaces = [surface for row in rows if (surface := ground_truth.surface(row)) is not None]
    return follows_mano(np.stack(surfaces), ground_truth.landmarks[: len(surfaces)], "ho3d")
