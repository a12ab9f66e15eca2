"""Reads and checks HO3D's folders (Hampali et al., CVPR 2020).

One part is `train` or `evaluation`: `<part>.txt` with lines `SEQ/0000`, `<part>/SEQ/rgb/0000.jpg` (version 3)
or `.png` (version 2) and `<part>/SEQ/meta/0000.pkl`. Frames that are not in the list have no annotation.
"""

import logging
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Bool

from hand_recon.data.cache import digest

logger = logging.getLogger(__name__)

COUNTS: Final = {
    "v3": {"train": 83_325, "evaluation": 20_137},
    "v2": {"train": 66_034, "evaluation": 11_524},
}
"""Number of frames in the lists of the full datasets."""

SUFFIXES: Final = (".png", ".jpg")
"""Suffixes of image files in the order of search, as in the official reader."""


@dataclass(frozen=True)
class FrameImages:
    """Image files of some frames."""

    folder: Path
    """Folder of the part."""
    names: Sequence[str]
    """Paths inside the part, `SEQ/rgb/0000.jpg`."""

    def __len__(self) -> int:
        return len(self.names)

    def __getitem__(self, row: int) -> Path:
        return self.folder / self.names[row]


@dataclass(frozen=True)
class Ho3dPart:
    """One part of an HO3D folder: every frame of its list, in its order."""

    root: Path
    """The folder that holds the lists."""
    name: str
    """`train` or `evaluation`."""
    frames: tuple[str, ...]
    """Names of the frames, `SEQ/0000`."""
    images: FrameImages
    """Image files of the frames; where one is missing, its expected path."""
    present: Bool[np.ndarray, " frame"]
    """True for frames with an image and an annotation."""
    fingerprint: str
    """Digest that changes when an image, an annotation or the list changes."""

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def list_file(self) -> Path:
        """File that lists the frames."""
        return self.root / f"{self.name}.txt"

    def meta(self, row: int) -> Path:
        """Annotation file of a frame."""
        sequence, number = self.frames[row].split("/")
        return self.root / self.name / sequence / "meta" / f"{number}.pkl"


def open_part(root: Path, name: str, version: str) -> Ho3dPart:
    """Find one part's files and log how many there are.

    Args:
        root: The folder that holds `train.txt`.
        name: `train` or `evaluation`.
        version: `v3` or `v2`.

    Raises:
        FileNotFoundError: The list, or everything in it, is missing.
        ValueError: The list does not hold frames.
    """
    path = root / f"{name}.txt"
    if not path.is_file():
        raise FileNotFoundError(_missing(root, name, version))
    frames = _read_list(path)
    images, metas = _list_files(root / name, frames)
    names, present = [], np.zeros(len(frames), dtype=bool)
    for row, frame in enumerate(frames):
        sequence, number = frame.split("/")
        rgb = f"{sequence}/rgb/{number}"
        found = [rgb + suffix for suffix in SUFFIXES if rgb + suffix in images]
        names.append(found[0] if found else rgb + SUFFIXES[version == "v3"])
        present[row] = bool(found) and f"{sequence}/meta/{number}.pkl" in metas
    _report(path, version, frames, present)
    identity = (str(root.resolve()), frames, sorted(images.items()), sorted(metas.items()))
    return Ho3dPart(
        root, name, frames, FrameImages(root / name, tuple(names)), present, digest(*identity)
    )


def _missing(root: Path, name: str, version: str) -> str:
    """Error message for a missing list."""
    if not root.is_dir():
        return (
            f"No folder {root}. Unpack HO3D_{version}.zip and set data.root to the folder that holds "
            "train.txt (data/README.md says where to get it), or run data=synthetic, which needs no files."
        )
    nested = sorted(path.parent for path in root.glob(f"*/{name}.txt"))
    if nested:
        return (
            f"No {name}.txt in {root}, but there is one in {nested[0]}: set data.root={nested[0]}."
        )
    return (
        f"No {name}.txt in {root}. It lists the frames that have annotations and is part of "
        f"HO3D_{version}.zip: unpack that there."
    )


def _read_list(path: Path) -> tuple[str, ...]:
    """Frames in the list's order."""
    lines = path.read_text(encoding="utf-8").split()
    for line in lines:
        if not re.fullmatch(r"\w[\w.-]*/\w+", line):
            raise ValueError(
                f"{path}: {line!r} is not a frame; expected one SEQ/0000 per line. Unpack it again."
            )
    if len(set(lines)) != len(lines) or not lines:
        raise ValueError(
            f"{path} lists {len(lines)} frames, {len(set(lines))} of them different; expected at least one, "
            "and each once. Unpack it again."
        )
    return tuple(lines)


Listing = dict[str, tuple[int, int]]
"""Path inside the part → size and modification time."""


def _list_files(folder: Path, frames: tuple[str, ...]) -> tuple[Listing, Listing]:
    """Images and annotations of the sequences that occur in the list."""
    images: Listing = {}
    metas: Listing = {}
    for sequence in sorted({frame.split("/")[0] for frame in frames}):
        for kind, listing in (("rgb", images), ("meta", metas)):
            if not (folder / sequence / kind).is_dir():
                continue
            with os.scandir(folder / sequence / kind) as entries:
                for entry in entries:
                    status = entry.stat()
                    name = f"{sequence}/{kind}/{entry.name}"
                    listing[name] = (status.st_size, status.st_mtime_ns)
    return images, metas


def _report(
    path: Path, version: str, frames: tuple[str, ...], present: Bool[np.ndarray, " frame"]
) -> None:
    """Log how much of the full dataset is there; raise an error if nothing is."""
    listed, found, full = len(frames), int(present.sum()), COUNTS[version][path.stem]
    if not found:
        raise FileNotFoundError(
            f"None of the {listed} frames of {path} has an image and an annotation in "
            f"{path.with_suffix('')}, for example {frames[0].replace('/', '/rgb/')}.jpg. "
            f"Unpack HO3D_{version}.zip there."
        )
    others = [other for other, counts in COUNTS.items() if counts[path.stem] == listed != full]
    if others:
        logger.warning(
            "%s lists %d frames, as many as HO3D %s has and not %s: set data.version=%s.",
            path, listed, others[0], version, others[0],
        )  # fmt: skip
    elif listed != full:
        logger.warning("%s lists %d frames, the full HO3D %s %d.", path, listed, version, full)
    if found < listed:
        absent = [frames[row] for row in np.flatnonzero(~present)[:5]]
        logger.warning(
            "%d of the %d frames of %s have no image or no annotation and are left out; the first are %s. "
            "Unpack the archive again, or go on without them.",
            listed - found, listed, path, ", ".join(absent),
        )  # fmt: skip
    logger.info("%s: %d of %d frames are there (%d in full).", path, found, listed, full)
