"""Reads crops of image files, decoded at every step or once into a memory-mapped file.

Reading the map is 40 to 290 times faster than decoding (`hand-recon benchmark suite=data`). It holds crops,
not whole images, so that small crops make a small map: 130,240 crops take 3.6 GB at 96 pixels and 19.6 GB at
224.
"""

import json
import logging
import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, UInt8

from hand_recon.data.annotations import AnnotatedHands
from hand_recon.data.cache import MappedArray, digest, ensure_built
from hand_recon.data.crop import CropPolicy, HandRegion, crop_image, crop_mirror
from hand_recon.data.images import CorruptImages, read_image
from hand_recon.data.progress import with_progress

logger = logging.getLogger(__name__)

MASK_THRESHOLD = 150
"""Grey value above which a mask shows the hand; masks are JPEGs with artefacts at the edges."""


@dataclass(frozen=True)
class ReadingPolicy:
    """Settings for caching and for images that cannot be read."""

    cache_dir: Path | str | None = None
    """Folder of caches, never the dataset's own; None turns caching off."""
    decode_cache: bool = True
    """Decode every image once into a map, if there is a cache folder with enough room."""
    max_corrupt: int = 20
    """Number of damaged images that each loading process may skip before the run stops."""
    workers: int = 2
    """Number of threads that fill the map."""

    @property
    def folder(self) -> Path | None:
        """Folder of parsed JSON lists and decoded crops; None without a cache."""
        return None if self.cache_dir is None else Path(self.cache_dir).expanduser() / "pictures"


@dataclass(frozen=True)
class Crop:
    """A crop and its position in the image."""

    pixels: UInt8[np.ndarray, "3 height width"]
    """RGB."""
    matrix: Float[np.ndarray, "3 3"]
    """Matrix from image pixels to crop pixels."""


class CropReader:
    """Reader of the crops of annotated hands, from the map or from the image files."""

    def __init__(
        self,
        hands: AnnotatedHands,
        rows: Int[np.ndarray, " row"],
        crop: CropPolicy,
        policy: ReadingPolicy,
    ) -> None:
        """Open the map of crops, or build it, if a cache folder is set.

        Args:
            hands: The whole table.
            rows: All rows that any split may read.
            crop: Size and position of the crops.
            policy: Caches and limits.

        Raises:
            RuntimeError: More images are damaged than allowed.
        """
        self.hands = hands
        self.crop = crop
        self.corrupt = CorruptImages(policy.max_corrupt)
        self._map: _CropMap | None = None
        if policy.folder is not None and policy.decode_cache:
            # Sorted, so that the order of the rows does not change the map.
            rows = np.unique(rows)
            self.index_of_row = np.full(len(hands), -1)
            self.index_of_row[rows] = np.arange(len(rows))
            self._map = self._open_map(policy.folder, rows, policy.workers)

    def read(self, row: int) -> Crop | None:
        """The crop of a hand, left hands mirrored; None, with a warning, if the image cannot be read.

        Raises:
            KeyError: The row is not in the map.
            RuntimeError: More images are damaged than allowed.
        """
        crop = self._decode(row) if self._map is None else self._map.read(self._index_in_map(row))
        if crop is None:
            self.corrupt.add(str(self.hands.images[row]))
        return crop

    def _index_in_map(self, row: int) -> int:
        index = int(self.index_of_row[row]) if 0 <= row < len(self.index_of_row) else -1
        if index < 0:
            # Not an IndexError, which would silently end a loop over the dataset.
            raise KeyError(
                f"Row {row} of {self.hands.name} is not among the {(self.index_of_row >= 0).sum()} in its "
                "map of crops; give every row that any split reads as cached_rows."
            )
        return index

    def _decode(self, row: int) -> Crop | None:
        pixels = read_image(self.hands.images[row])
        return None if pixels is None else cut_crop(self.hands, row, pixels, self.crop)

    def _open_map(
        self, folder: Path, rows: Int[np.ndarray, " row"], workers: int
    ) -> "_CropMap | None":
        target = folder / self.map_name(rows)
        needed = len(rows) * 3 * self.crop.size**2
        folder.mkdir(parents=True, exist_ok=True)
        if not target.is_dir() and shutil.disk_usage(folder).free < 1.1 * needed:
            logger.warning(
                "No room in %s for %.1f GB of decoded crops: decoding at every step instead, "
                "which is slower. Set paths.cache to a larger disk.", folder, needed / 1e9,
            )  # fmt: skip
            return None

        def build(partial: Path) -> None:
            logger.info(
                "Decoding %d images once into %s (%.1f GB)", len(rows), target, needed / 1e9
            )
            self._fill(partial, rows, workers)

        ensure_built(target, build)
        return _CropMap(target)

    def map_name(self, rows: Int[np.ndarray, " row"]) -> str:
        """Folder name of the map of some rows; it changes with labels, images and crops."""
        recipe = (self.hands.fingerprint, sorted(vars(self.crop).items()), rows)
        return f"{self.hands.name}-{self.crop.around}-{self.crop.size}-{digest(*recipe)}"

    def _fill(self, folder: Path, rows: Int[np.ndarray, " row"], workers: int) -> None:
        """Decode all rows; damaged images are marked as unreadable."""
        shape = (len(rows), 3, self.crop.size, self.crop.size)
        crops = np.lib.format.open_memmap(folder / "crops.npy", "w+", np.uint8, shape)
        matrices = np.full((len(rows), 3, 3), np.nan)

        def decode(index: int) -> bool:
            crop = self._decode(int(rows[index]))
            if crop is not None:
                crops[index], matrices[index] = crop.pixels, crop.matrix
            return crop is not None

        # OpenCV decodes outside the interpreter's lock, so threads are enough.
        with ThreadPoolExecutor(max(1, workers)) as pool:
            results = pool.map(decode, range(len(rows)))
            for index, readable in enumerate(with_progress(results, len(rows), "Decoding")):
                if not readable:
                    self.corrupt.add(str(self.hands.images[int(rows[index])]))
        crops.flush()
        np.save(folder / "matrices.npy", matrices)
        manifest = {
            "dataset": self.hands.name,
            "root": str(self.hands.root),
            "fingerprint": self.hands.fingerprint,
            "crop": vars(self.crop),
            "count": len(rows),
            "unreadable": self.corrupt.names,
        }
        (folder / "manifest.json").write_text(json.dumps(manifest, indent=2))


def cut_crop(
    hands: AnnotatedHands, row: int, pixels: UInt8[np.ndarray, "_ _ 3"], policy: CropPolicy
) -> Crop:
    """Cut the crop of a hand out of its image; left hands are mirrored.

    Args:
        hands: The table.
        row: Row of the hand.
        pixels: The decoded image, RGB.
        policy: Size and position of the crop.
    """
    height, width = pixels.shape[:2]
    matrix = policy.matrix((height, width), _region(hands, row, policy))
    if hands.is_left(row):
        matrix = crop_mirror(policy.size) @ matrix
    crop = crop_image(pixels, matrix, policy.size)
    return Crop(pixels=np.ascontiguousarray(crop.transpose(2, 0, 1)), matrix=matrix)


def _region(hands: AnnotatedHands, row: int, policy: CropPolicy) -> HandRegion:
    mask = None
    if hands.masks is not None and policy.around == "mask":
        mask = read_image(hands.masks[row])
    return HandRegion(
        landmarks=hands.landmarks_2d[row],
        box=None if hands.boxes is None else hands.boxes[row],
        mask=None if mask is None else mask[..., 0] > MASK_THRESHOLD,
        name=hands.source(row),
    )


class _CropMap:
    """Decoded crops on the disk."""

    def __init__(self, folder: Path) -> None:
        self.crops = MappedArray(folder / "crops.npy")
        self.matrices: Float[np.ndarray, "image 3 3"] = np.load(folder / "matrices.npy")

    def read(self, row: int) -> Crop | None:
        matrix = self.matrices[row]
        if np.isnan(matrix[0, 0]):
            return None
        return Crop(pixels=self.crops[row], matrix=matrix)
