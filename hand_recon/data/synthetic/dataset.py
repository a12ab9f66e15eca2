"""Dataset of synthetic hands, which are rendered on first use and then read from disk."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.utils.data import Dataset

from hand_recon.camera import move_points
from hand_recon.data.synthetic.image_store import COLUMNS, ensure_store
from hand_recon.data.synthetic.recipe import Recipe, level_named
from hand_recon.data.synthetic.rendered_ahead import RenderedAhead, render_ahead
from hand_recon.hand.model import HandModel
from hand_recon.hand.open_hand import open_hand
from hand_recon.hand.upright import upright_motion
from hand_recon.schema import HandBatch, HandParameters, HandSample

_NO_IMAGE: Final = torch.empty(3, 0, 0, dtype=torch.uint8)

_SAMPLE_COLUMNS: Final = (
    "landmarks_2d", "labelled", "intrinsics", "landmarks_3d", "occluded", "label_noise", "confidence",
)  # fmt: skip
"""Columns of the store that samples contain."""


class SyntheticHands(Dataset[HandSample]):
    """Images of the open hand with 2D labels, and 3D ground truth for evaluation.

    Image i does not depend on the machine or the number of workers. Training and validation share gestures;
    the test split has other gestures, shapes and backgrounds, and labels without noise. Views
    (`pictures=False`) have landmarks without images, and noisy labels in every split.
    """

    def __init__(
        self,
        split: str,
        size: int,
        crop_size: int,
        level: str,
        *,
        seed: int = 0,
        cache_dir: Path,
        workers: int = 0,
        landmark_set: str = "knuckle",
        with_vertices: bool | None = None,
        pictures: bool = True,
        without: Sequence[str] = (),
        order: Sequence[int] | None = None,
    ) -> None:
        """Open the set; it is rendered first if the cache does not have it.

        Args:
            split: `train`, `val` or `test`.
            size: Number of images.
            crop_size: Side of an image, pixels.
            level: A key of `hand_recon.data.synthetic.levels.DIFFICULTIES`.
            seed: Seed of the whole set.
            cache_dir: Folder for rendered sets.
            workers: Number of processes that render; 0 or 1 renders in this process.
            landmark_set: The hand's landmark set, `knuckle` or `mano`.
            with_vertices: True adds vertices, posed when read; by default in all splits except training.
            pictures: True renders images; views without images are a hundred times cheaper.
            without: Features that images lack, keys of `hand_recon.data.synthetic.levels.FEATURES`.
            order: Order in which images will be read first. With one, and two or more workers, `batch` waits
                only for images that it reads, while others are rendered; all else waits for the whole set.

        Raises:
            ValueError: The split, level or a feature is unknown, or a size is too small.
        """
        self.recipe = Recipe(
            split, level_named(level, without), crop_size, seed, landmark_set, pictures
        )
        self.with_vertices = split != "train" if with_vertices is None else with_vertices
        self._size = size
        self._images: np.ndarray | None = None
        self._columns: dict[str, Tensor] | None = None
        self._hand: HandModel | None = open_hand(landmark_set) if self.with_vertices else None
        self._ahead: RenderedAhead | None = None
        if order and workers > 1 and pictures:
            self._ahead = render_ahead(Path(cache_dir), self.recipe, order, workers)
        if self._ahead is None:
            self._folder = ensure_store(Path(cache_dir), self.recipe, size, workers)
            self._open()
        else:
            self._folder = self._ahead.path
        self._source = self._folder.name

    def _open(self) -> dict[str, Tensor]:
        """Labels of the complete set, once it is rendered."""
        if self._ahead is not None:
            self._ahead.wait()
            self._ahead = None
        if self._columns is None:
            with np.load(self._folder / "labels.npz") as archive:
                columns = {name: torch.from_numpy(archive[name]) for name in COLUMNS}
            if not self.recipe.pictures:
                columns = _upright(columns, self.recipe.crop_size)
            self._columns = columns
        return self._columns

    @property
    def folder(self) -> Path:
        """Folder of the set, once it is rendered."""
        self._open()
        return self._folder

    def __len__(self) -> int:
        return self._size

    def __getitem__(self, index: int) -> HandSample:
        """Read one image with its labels.

        Raises:
            IndexError: The index is out of range.
        """
        if not 0 <= index < len(self):
            raise IndexError(
                f"There is no image {index} of {len(self)} synthetic hands; indices start at 0."
            )
        labels = self._open()
        with_images = self.recipe.pictures
        return HandSample(
            image=torch.from_numpy(self.images[index].copy()) if with_images else _NO_IMAGE,
            landmarks_2d=labels["landmarks_2d"][index],
            labelled=labels["labelled"][index],
            index=index,
            source=self._source,
            intrinsics=labels["intrinsics"][index],
            landmarks_3d=labels["landmarks_3d"][index],
            vertices=self.vertices(index) if self.with_vertices else None,
            occluded=labels["occluded"][index],
            label_noise=labels["label_noise"][index],
            confidence=labels["confidence"][index],
        )

    def batch(self, indices: list[int]) -> HandBatch:
        """Read several samples at once; the result equals `collate`'s, a hundred times faster for views."""
        if self._ahead is not None and not (self._ahead.complete or self.with_vertices):
            return self._batch_ahead(self._ahead, indices)
        index, labels = torch.tensor(indices), self._open()
        rows: dict[str, Any] = {name: labels[name][index] for name in _SAMPLE_COLUMNS}
        if self.recipe.pictures:
            image = torch.from_numpy(np.stack([self.images[index] for index in indices]))
        else:
            image = _NO_IMAGE.expand(len(indices), 3, 0, 0)
        vertices = self.vertices(index) if self.with_vertices else None
        sources = (self._source,) * len(indices)
        return HandBatch(image=image, index=index, source=sources, vertices=vertices, **rows)

    def _batch_ahead(self, ahead: RenderedAhead, indices: list[int]) -> HandBatch:
        """The same batch, of images that are rendered already."""
        images, labels = ahead.read(indices)
        rows: dict[str, Any] = {name: torch.from_numpy(labels[name]) for name in _SAMPLE_COLUMNS}
        sources = (self._source,) * len(indices)
        return HandBatch(
            image=torch.from_numpy(images), index=torch.tensor(indices), source=sources, **rows
        )

    @property
    def images(self) -> np.ndarray:
        """All images (size, 3, height, width), bytes; each process maps the file into memory itself."""
        if self._images is None:
            self._images = np.load(self.folder / "images.npy", mmap_mode="r")
        return self._images

    @property
    def landmarks_3d(self) -> Float[Tensor, "size landmark=21 3"]:
        """Ground truth of the whole set, camera frame, metres."""
        return self._open()["landmarks_3d"]

    def parameters(self, index: int | slice | Tensor) -> HandParameters:
        """Ground-truth parameters of one or several hands."""
        labels = self._open()
        return HandParameters(
            joint_angles=labels["joint_angles"][index],
            shape=labels["shape"][index],
            root_rotation=labels["root_rotation"][index],
            translation=labels["translation"][index],
        )

    def vertices(self, index: int | slice | Tensor) -> Float[Tensor, "*batch vertex 3"]:
        """Vertices in the camera's frame, metres, posed from the stored parameters."""
        hand = self._hand or open_hand(self.recipe.landmark_set)
        with torch.no_grad():
            return hand.to_camera(self.parameters(index)).vertices

    def __getstate__(self) -> dict[str, Any]:
        """Leave out the memory map; pickling it would copy every pixel to each loading process."""
        self._open()
        return {**self.__dict__, "_images": None}


def _upright(labels: dict[str, Tensor], crop_size: int) -> dict[str, Tensor]:
    """Rotate views into upright crops around the landmarks, with their cameras and ground truth."""
    motion = upright_motion(labels["landmarks_2d"], labels["labelled"], crop_size)
    camera = motion.camera
    return labels | {
        "landmarks_2d": move_points(labels["landmarks_2d"], motion.pixels),
        "label_noise": labels["label_noise"] * motion.scale[:, None],
        "intrinsics": motion.pixels @ labels["intrinsics"] @ camera.mT,
        "landmarks_3d": labels["landmarks_3d"] @ camera.mT,
        "root_rotation": camera @ labels["root_rotation"],
        "translation": (camera @ labels["translation"][..., None])[..., 0],
    }
