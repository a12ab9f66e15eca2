"""FreiHAND: real right hands with camera matrices; 2D labels are projected 3D ones (Sec. 4.1).

Any folder in FreiHAND's layout can be read. Training reads images, `training_K.json` and
`training_xyz.json`; vertices are used where present, for evaluation.
"""

import logging
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from hand_recon.data.annotated_dataset import AnnotatedImages, Benchmark, ImageRecipe
from hand_recon.data.annotations import AnnotatedHands
from hand_recon.data.freihand.splits import FreiHandRecipe, choose_hands
from hand_recon.data.images import read_image
from hand_recon.hand.mano.hand import follows_mano
from hand_recon.hand.skeleton import ROOT_LANDMARK

logger = logging.getLogger(__name__)


class FreiHand(AnnotatedImages):
    """One split of FreiHAND: training hands in all their colourings, other hands in one."""

    def __init__(
        self, split: str, recipe: FreiHandRecipe, with_vertices: bool | None = None
    ) -> None:
        """Read the annotations; images are read on request, or once into the cache.

        Args:
            split: `train`, `val` or `test`.
            recipe: All other settings.
            with_vertices: Load the surfaces; by default only for test hands, as those of the training
                part take long to read and validation does not need them.

        Raises:
            FileNotFoundError: A file is missing.
            ValueError: The files contradict each other, or there is no such split.
            RuntimeError: More images are damaged than allowed.
        """
        if split not in ("train", "val", "test"):
            raise ValueError(f"Unknown split {split!r}; choose train, val or test.")
        self.split = split
        self.recipe = recipe
        self.part, self.chosen = choose_hands(split, recipe)
        if self.part.name == "evaluation":
            self.benchmark = Benchmark("freihand")
        self._check_projections()
        versions = self._wanted_versions()
        table = self._annotated(split == "test" if with_vertices is None else with_vertices)
        crop = recipe.test_crop if split == "test" and recipe.test_crop is not None else recipe.crop
        super().__init__(
            table,
            # The benchmark has each hand once; four colourings of it would only cost time.
            self._images_of(self.chosen, versions if split == "train" else versions[:1]),
            ImageRecipe(crop, recipe.reading),
            cached_rows=self._images_of(np.arange(len(self.part)), versions),
        )

    def _annotated(self, with_vertices: bool) -> AnnotatedHands:
        """The whole part, one row per image: image i + N·v is version v of hand i."""
        part = self.part
        versions = len(part.versions)
        vertices = self._choose_vertices(with_vertices)
        return AnnotatedHands(
            name=f"freihand-{part.name}",
            root=part.rgb.parents[1],
            images=part.images,
            fingerprint=part.fingerprint,
            landmarks_2d=np.tile(part.projections(), (versions, 1, 1)),
            intrinsics=np.tile(part.intrinsics, (versions, 1, 1)),
            landmarks_3d=np.tile(part.landmarks, (versions, 1, 1)),
            masks=_Repeated(part.masks, len(part)) if part.name == "training" else None,
            surfaces=None if vertices is None else _Repeated(vertices, len(part)).__getitem__,
        )

    def _wanted_versions(self) -> tuple[str, ...]:
        """Colourings that any split of this recipe reads."""
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
        """Surfaces; None if there are none, or they are not comparable with the hand model's."""
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
        if self.recipe.topology != "mano" and follows_mano(
            vertices, self.part.landmarks, "freihand"
        ):
            logger.warning(
                "%s has MANO's surfaces, which cannot be compared vertex by vertex with hand=%s: "
                "vertex metrics are left out; hand=mano has them.",
                self.part.root, self.recipe.topology,
            )  # fmt: skip
            return None
        return vertices

    def _check_projections(self) -> None:
        """Refuse labels most of which lie far outside the images: K belongs to another image size."""
        image = read_image(self.part.images[int(self.chosen[0])]) if len(self.chosen) else None
        if image is None:
            return
        height, width = image.shape[:2]
        size = np.array([width, height])
        middle = self.part.projections()[:, ROOT_LANDMARK]
        outside = np.any(np.abs(middle - size / 2) > size, axis=-1)
        if outside.mean() > 0.5:
            raise ValueError(
                f"{self.part.root / f'{self.part.name}_K.json'}: {int(outside.sum())} of "
                f"{outside.size} hands project far outside their images of {width} × {height} "
                "pixels. The camera matrices must be those of the images as they are on the disk."
            )


class _Repeated:
    """Values per hand, indexed by image."""

    def __init__(self, of_hand: Any, hands: int) -> None:  # noqa: ANN401  # an array, or images
        self.of_hand = of_hand
        self.hands = hands

    def __len__(self) -> int:
        return len(self.of_hand)

    def __getitem__(self, row: int) -> Any:  # noqa: ANN401  # what the array or the images hold
        return self.of_hand[row % self.hands]
