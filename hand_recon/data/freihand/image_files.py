"""FreiHAND's image files: numbered without gaps, of one file type."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from hand_recon.data.cache import digest

ARCHIVES: Final = {"training": "FreiHAND_pub_v2.zip", "evaluation": "FreiHAND_pub_v2_eval.zip"}
"""Download that holds each part's annotations."""

SUFFIXES: Final = (".jpg", ".jpeg", ".png")
"""Suffixes of image files that are read; a folder holds one kind."""


@dataclass(frozen=True)
class NumberedImages:
    """Image files named by their number."""

    folder: Path
    """Folder of the images."""
    suffix: str
    """Suffix of the image files."""
    count: int
    """Number of images, numbered from zero."""

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, number: int) -> Path:
        return self.folder / f"{number:08d}{self.suffix}"


def list_images(rgb: Path) -> tuple[str, int, str]:
    """Suffix, number and fingerprint of the images in a folder.

    Raises:
        FileNotFoundError: The folder or an image is missing.
        ValueError: There are images of several kinds, or none.
    """
    if not rgb.is_dir():
        raise FileNotFoundError(
            f"No folder {rgb}. It holds the images 00000000.jpg, 00000001.jpg and so on: unpack "
            f"{ARCHIVES['training']} again."
        )
    found = _files(rgb)
    suffixes = {Path(name).suffix for name in found}
    if len(suffixes) != 1:
        raise ValueError(
            f"{rgb} holds images of {len(suffixes)} kinds {sorted(suffixes)}; expected one kind, "
            f"named 00000000.jpg onwards. Convert them to one of {list(SUFFIXES)}."
        )
    suffix = suffixes.pop()
    for index in range(len(found)):
        if f"{index:08d}{suffix}" not in found:
            raise FileNotFoundError(
                f"{rgb / f'{index:08d}{suffix}'} is missing: {len(found)} images must be numbered "
                f"from 00000000 to {len(found) - 1:08d} without a gap. Unpack the archive again, "
                "or rename your own images."
            )
    return suffix, len(found), digest(str(rgb.resolve()), sorted(found.items()))


def masks_fingerprint(folder: Path) -> str:
    """Digest of the masks' sizes and modification times; a missing folder has a digest too."""
    return digest(sorted(_files(folder).items()) if folder.is_dir() else None)


def _files(folder: Path) -> dict[str, tuple[int, int]]:
    """Size and modification time of each image in a folder."""
    found = {}
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.name.lower().endswith(SUFFIXES):
                status = entry.stat()
                found[entry.name] = (status.st_size, status.st_mtime_ns)
    return found
