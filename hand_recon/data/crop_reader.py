"""From image files to crops: decoded at every step, or once into a map of bytes on the disk.

The map makes reading some ten times faster than decoding. It holds crops, not images, so that
small crops make a small map: 130,240 crops take 3.6 GB at 96 pixels and 19.6 GB at 224.
"""

import json
import logging
import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, UInt8

from hand_recon.data.cache import MappedArray, digest, ensure_built
from hand_recon.data.crop import CropPolicy, crop_image
from hand_recon.data.freihand.files import FreiHandPart
from hand_recon.data.images import CorruptImages, read_image
from hand_recon.data.progress import with_progress

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class ReadingPolicy:
    """Where what was read is kept, and what happens to pictures that cannot be read."""

    cache_dir: Path | str | None = None
    """Folder of caches, never the dataset's own; none keeps nothing."""
    decode_cache: bool = True
    """Whether to decode every picture once into a map, if there is a folder and room for it."""
    max_corrupt: int = 20
    """How many damaged pictures each loading process may skip before the run stops."""
    workers: int = 2
    """Threads that fill the map."""

    @property
    def folder(self) -> Path | None:
        """Where parsed JSON lists and decoded crops are kept."""
        return None if self.cache_dir is None else Path(self.cache_dir).expanduser() / "freihand"


@dataclass(frozen=True)
class Crop:
    """What was cut out of an image, and where."""

    pixels: UInt8[np.ndarray, "3 height width"]
    """RGB."""
    matrix: Float[np.ndarray, "3 3"]
    """Pixels of the image → pixels of the crop."""


class CropReader:
    """Gives the crop of an image by the image's number, or None if it cannot be read."""

    def __init__(
        self,
        part: FreiHandPart,
        labels: Float[np.ndarray, "hand landmark=21 2"],
        images: Int[np.ndarray, " image"],
        crop: CropPolicy,
        policy: ReadingPolicy,
    ) -> None:
        """Open the map of crops, or make it if there is a folder for it.

        Args:
            part: The dataset's files.
            labels: 2D landmarks of each hand, pixels of the image.
            images: Numbers of all images that may be asked for by any split.
            crop: How to cut.
            policy: Caches and limits.

        Raises:
            RuntimeError: More pictures are damaged than allowed.
        """
        self.part = part
        self.labels = labels
        self.crop = crop
        self.corrupt = CorruptImages(policy.max_corrupt)
        self.row_of_image = np.full(len(part) * len(part.versions), -1)
        self.row_of_image[images] = np.arange(len(images))
        self._map: _CropMap | None = None
        if policy.folder is not None and policy.decode_cache:
            self._map = self._open_map(policy.folder, images, policy.workers)

    def read(self, image: int) -> Crop | None:
        """The crop of an image; a warning and None if it cannot be read.

        Raises:
            RuntimeError: It is one damaged picture too many.
        """
        crop = (
            self._decode(image)
            if self._map is None
            else self._map.read(int(self.row_of_image[image]))
        )
        if crop is None:
            self.corrupt.add(str(self.part.image(image)))
        return crop

    def _decode(self, image: int) -> Crop | None:
        pixels = read_image(self.part.image(image))
        if pixels is None:
            return None
        height, width = pixels.shape[:2]
        matrix = self.crop.matrix((height, width), self.labels[image % len(self.part)])
        crop = crop_image(pixels, matrix, self.crop.size)
        return Crop(pixels=np.ascontiguousarray(crop.transpose(2, 0, 1)), matrix=matrix)

    def _open_map(
        self, folder: Path, images: Int[np.ndarray, " image"], workers: int
    ) -> "_CropMap | None":
        recipe = (self.part.fingerprint, vars(self.crop), images.tobytes())
        target = folder / f"{self.part.name}-{self.crop.around}-{self.crop.size}-{digest(*recipe)}"
        needed = len(images) * 3 * self.crop.size**2
        folder.mkdir(parents=True, exist_ok=True)
        if not target.is_dir() and shutil.disk_usage(folder).free < 1.1 * needed:
            logger.warning(
                "No room in %s for %.1f GB of decoded crops: decoding at every step instead, "
                "which is slower. Set paths.cache to a larger disk.", folder, needed / 1e9,
            )  # fmt: skip
            return None

        def build(partial: Path) -> None:
            logger.info(
                "Decoding %d images once into %s (%.1f GB)", len(images), target, needed / 1e9
            )
            self._fill(partial, images, workers)

        ensure_built(target, build)
        return _CropMap(target)

    def _fill(self, folder: Path, images: Int[np.ndarray, " image"], workers: int) -> None:
        """Decode everything; a damaged picture is a row that is marked as unreadable."""
        shape = (len(images), 3, self.crop.size, self.crop.size)
        crops = np.lib.format.open_memmap(folder / "crops.npy", "w+", np.uint8, shape)
        matrices = np.full((len(images), 3, 3), np.nan)

        def decode(row: int) -> bool:
            crop = self._decode(int(images[row]))
            if crop is not None:
                crops[row], matrices[row] = crop.pixels, crop.matrix
            return crop is not None

        # OpenCV decodes outside the interpreter's lock, so threads are enough.
        with ThreadPoolExecutor(max(1, workers)) as pool:
            rows = pool.map(decode, range(len(images)))
            for row, readable in enumerate(with_progress(rows, len(images), "Decoding")):
                if not readable:
                    self.corrupt.add(str(self.part.image(int(images[row]))))
        crops.flush()
        np.save(folder / "matrices.npy", matrices)
        manifest = {"images": str(self.part.rgb), "crop": vars(self.crop), "count": len(images)}
        (folder / "manifest.json").write_text(json.dumps(manifest, indent=2))


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
