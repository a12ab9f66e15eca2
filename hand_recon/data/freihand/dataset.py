"""FreiHAND: real right hands with camera matrices; 2D labels are projected 3D ones (Sec. 4.1).

Any folder in FreiHAND's layout will do. Training reads pictures, `training_K.json` and
`training_xyz.json`; vertices are used where present, for evaluation.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float, Int

from hand_recon.data.annotated import AnnotatedHands
from hand_recon.data.crop import CropPolicy
from hand_recon.data.crop_reader import ReadingPolicy
from hand_recon.data.freihand.files import (
    FreiHandPart,
    find_evaluation,
    follows_mano,
    open_part,
)
from hand_recon.data.images import read_image
from hand_recon.data.picture_hands import PictureHands, PictureRecipe
from hand_recon.hand.skeleton import ROOT_LANDMARK

logger = logging.getLogger(__name__)

TEST_SOURCES: Final = ("auto", "evaluation", "held_out")
"""Which hands test."""


@dataclass(frozen=True)
class FreiHandRecipe:
    """Which hands, and how they are cut out and read.

    Raises:
        ValueError: A choice does not exist.
    """

    root: Path | str
    """The folder that holds `training_xyz.json`."""
    crop: CropPolicy = field(default_factory=CropPolicy)
    """Size and place of the crops."""
    test_crop: CropPolicy | None = None
    """The same for test hands, where it differs: the evaluation part has no masks."""
    reading: ReadingPolicy = field(default_factory=ReadingPolicy)
    """Caches, and how many damaged pictures are too many."""
    eval_root: Path | str | None = None
    """The folder that holds `evaluation_xyz.json`, if it is not the same or `<root>_eval`."""
    versions: Sequence[str] | None = None
    """Which colourings to train on; none for all that are there. Others see the first one only."""
    val_fraction: float = 0.1
    """Share of the training hands that validate; as many again test if nothing else can."""
    split_seed: int = 0
    """Fixes who validates: the same for all seeds of a study."""
    test_source: str = "auto"
    """`evaluation`, `held_out` training hands, or `auto`: the first that there is."""
    vertices: int | None = 778
    """Vertices of the hand model; surfaces with another number are left out. None takes any."""
    topology: str = "open"
    """The hand model's name: surfaces numbered as MANO's are compared with MANO only."""

    def __post_init__(self) -> None:
        if self.test_source not in TEST_SOURCES:
            raise ValueError(
                f"Unknown test_source {self.test_source!r}; choose one of {list(TEST_SOURCES)}."
            )
        if not 0 < self.val_fraction < 0.5:
            raise ValueError(
                f"val_fraction={self.val_fraction} must lie between 0 and 0.5, so that hands are "
                "left to train on."
            )


class FreiHand(PictureHands):
    """One split: training hands in all their colourings, others in one."""

    def __init__(
        self, split: str, recipe: FreiHandRecipe, with_vertices: bool | None = None
    ) -> None:
        """Read the annotations; pictures are read when asked for, or once into the cache.

        Args:
            split: `train`, `val` or `test`.
            recipe: Everything else.
            with_vertices: Whether to give the surfaces; by default only those of the test hands: to
                read those of the training part takes long, and validation can do without.

        Raises:
            FileNotFoundError: A file is missing.
            ValueError: The files contradict each other, or there is no such split.
            RuntimeError: More pictures are damaged than allowed.
        """
        if split not in ("train", "val", "test"):
            raise ValueError(f"Unknown split {split!r}; choose train, val or test.")
        self.split = split
        self.recipe = recipe
        self.part, self.chosen = self._choose_hands()
        self._check_projections()
        versions = self._wanted_versions()
        table = self._annotated(split == "test" if with_vertices is None else with_vertices)
        crop = recipe.test_crop if split == "test" and recipe.test_crop is not None else recipe.crop
        super().__init__(
            table,
            # The benchmark shows each hand once; four colourings of it would only cost time.
            self._images_of(self.chosen, versions if split == "train" else versions[:1]),
            PictureRecipe(crop, recipe.reading),
            cached_rows=self._images_of(np.arange(len(self.part)), versions),
        )

    def _annotated(self, with_vertices: bool) -> AnnotatedHands:
        """The whole part, one row per picture: image i + N·v is version v of hand i."""
        part = self.part
        versions = len(part.versions)
        vertices = self._choose_vertices(with_vertices)
        return AnnotatedHands(
            name=f"freihand-{part.name}",
            root=part.rgb.parents[1],
            pictures=part.pictures,
            fingerprint=part.fingerprint,
            landmarks_2d=np.tile(part.projections(), (versions, 1, 1)),
            intrinsics=np.tile(part.intrinsics, (versions, 1, 1)),
            landmarks_3d=np.tile(part.landmarks, (versions, 1, 1)),
            masks=_Repeated(part.masks, len(part)) if part.name == "training" else None,
            surfaces=None if vertices is None else _Repeated(vertices, len(part)).__getitem__,
        )

    def _choose_hands(self) -> tuple[FreiHandPart, Int[np.ndarray, " chosen"]]:
        """The part that a split reads, and the hands in it; a hand keeps its colourings."""
        recipe = self.recipe
        cache = recipe.reading.folder
        root = Path(recipe.root).expanduser()
        evaluation = find_evaluation(root, recipe.eval_root)
        held_out = (
            evaluation is None if recipe.test_source == "auto" else recipe.test_source == "held_out"
        )
        if self.split == "test" and not held_out:
            if evaluation is None:
                raise FileNotFoundError(
                    f"No evaluation_xyz.json in {recipe.eval_root or recipe.root}. It is part of "
                    "FreiHAND_pub_v2_eval.zip: unpack that and set data.eval_root, or test on "
                    "held-out training hands with data.test_source=held_out."
                )
            part = open_part(evaluation[0], "evaluation", cache, evaluation[1])
            return part, np.arange(len(part))
        part = open_part(root, "training", cache)
        order = np.random.default_rng(recipe.split_seed).permutation(len(part))
        count = max(1, round(recipe.val_fraction * len(part)))
        ends = {"val": (0, count), "test": (count, 2 * count)}
        ends["train"] = (2 * count if held_out else count, len(part))
        if self.split == "test":
            logger.warning(
                "No evaluation_xyz.json: testing on %d held-out hands of %s. Numbers on them are "
                "not FreiHAND's benchmark.", count, root,
            )  # fmt: skip
        start, end = ends[self.split]
        return part, np.sort(order[start:end])

    def _wanted_versions(self) -> tuple[str, ...]:
        """The colourings that some split of this recipe reads."""
        available = self.part.versions
        if self.part.name == "evaluation":
            return available
        wanted = self.recipe.versions or available
        missing = [version for version in wanted if version not in available]
        if missing:
            raise ValueError(
                f"{self.part.rgb} has no version {missing}; it has {list(available)}: four "
                "times as many images as hands are a full set. Unpack the archive again, or set "
                f"data.versions={list(available)}."
            )
        return tuple(wanted)

    def _images_of(
        self, hands: Int[np.ndarray, " hand"], versions: tuple[str, ...]
    ) -> Int[np.ndarray, " image"]:
        """Numbers of the images of some hands: image i + N·v is version v of hand i."""
        steps = [len(self.part) * self.part.versions.index(version) for version in versions]
        return np.concatenate([hands + step for step in steps])

    def _choose_vertices(self, wanted: bool) -> Float[np.ndarray, "hand vertex 3"] | None:
        """The surfaces, if there are any and they are comparable with the hand model's."""
        vertices = self.part.vertices(self.recipe.reading.folder) if wanted else None
        if vertices is None:
            if wanted:
                logger.warning(
                    "No %s_verts.json in %s: vertex metrics are left out.",
                    self.part.name,
                    self.part.root,
                )
            return None
        expected = self.recipe.vertices
        if expected is not None and vertices.shape[1] != expected:
            logger.warning(
                "%s has surfaces of %d vertices, the hand model %d: vertex metrics are left out.",
                self.part.root, vertices.shape[1], expected,
            )  # fmt: skip
            return None
        if self.recipe.topology != "mano" and follows_mano(vertices, self.part.landmarks):
            logger.warning(
                "%s has MANO's surfaces, which cannot be compared vertex by vertex with hand=%s: "
                "vertex metrics are left out; hand=mano has them.",
                self.part.root, self.recipe.topology,
            )  # fmt: skip
            return None
        return vertices

    def _check_projections(self) -> None:
        """Refuse labels of which most are far outside the pictures: K belongs to another size."""
        picture = read_image(self.part.pictures[int(self.chosen[0])]) if len(self.chosen) else None
        if picture is None:
            return
        height, width = picture.shape[:2]
        size = np.array([width, height])
        middle = self.part.projections()[:, ROOT_LANDMARK]
        outside = np.any(np.abs(middle - size / 2) > size, axis=-1)
        if outside.mean() > 0.5:
            raise ValueError(
                f"{self.part.root / f'{self.part.name}_K.json'}: {int(outside.sum())} of "
                f"{outside.size} hands project far outside their pictures of {width} × {height} "
                "pixels. The camera matrices must be those of the pictures as they are on the disk."
            )


class _Repeated:
    """Something per hand, asked for by picture."""

    def __init__(self, of_hand: Any, hands: int) -> None:  # noqa: ANN401  # an array, or pictures
        self.of_hand = of_hand
        self.hands = hands

    def __len__(self) -> int:
        return len(self.of_hand)

    def __getitem__(self, row: int) -> Any:  # noqa: ANN401  # what the array or the pictures hold
        return self.of_hand[row % self.hands]
