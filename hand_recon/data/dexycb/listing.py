"""Digests of the files of DexYCB frames, to detect changes, with one scan of each folder."""

import itertools
import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from hand_recon.data.cache import digest, file_identity
from hand_recon.data.dexycb.files import SERIALS, image_name, label_path
from hand_recon.data.dexycb.splits import Frames

_SCAN_THREADS: Final = 8
"""Number of threads that query the sizes and times of files."""

Task = tuple[Path, tuple[int, ...]]
"""The folder of a camera, and the numbers of the frames to read in it."""


@dataclass(frozen=True)
class FrameFiles:
    """Digests that change when the size or modification time of a file of some frames changes."""

    labels: str
    """Digest of the labels and of each `meta.yml`."""
    images: str
    """Digest of the images."""


def digest_files(frames: Frames) -> FrameFiles:
    """Digests of the size and modification time of every label and image of some frames.

    Raises:
        FileNotFoundError: A camera's folder is missing.
    """
    metas = [file_identity(grasp.folder / "meta.yml") for grasp in frames.grasps]
    # Latency of a network disk dominates, so several threads scan at once.
    with ThreadPoolExecutor(_SCAN_THREADS) as pool:
        seen = list(pool.map(_digest_folder, tasks_of(frames)))
    wanted = (frames.grasp, frames.camera, frames.number)
    return FrameFiles(
        labels=digest(metas, [labels for labels, _ in seen], *wanted),
        images=digest([images for _, images in seen]),
    )


def tasks_of(frames: Frames) -> Iterator[Task]:
    """Frames grouped by folder, in their order.

    Raises:
        FileNotFoundError: A camera's folder is missing.
    """
    key = frames.grasp * len(SERIALS) + frames.camera
    starts = np.flatnonzero(np.diff(key, prepend=-1))
    for start, stop in itertools.pairwise([*starts.tolist(), len(frames)]):
        grasp = frames.grasps[int(frames.grasp[start])]
        folder = grasp.folder / SERIALS[int(frames.camera[start])]
        if not folder.is_dir():
            raise FileNotFoundError(
                f"No folder {folder}: every sequence has the images of eight cameras. Unpack the archive "
                "of its subject again."
            )
        yield folder, tuple(frames.number[start:stop].tolist())


def _digest_folder(task: Task) -> tuple[str, str]:
    """Digests of a folder's labels and images; missing files are skipped."""
    folder, numbers = task
    with os.scandir(folder) as entries:
        there = {entry.name: entry for entry in entries}
    kinds = (
        [label_path(folder, number).name for number in numbers],
        [image_name(number) for number in numbers],
    )
    labels, images = (
        digest(
            str(folder), [(name, *_size_and_time(there[name])) for name in names if name in there]
        )
        for names in kinds
    )
    return labels, images


def _size_and_time(entry: "os.DirEntry[str]") -> tuple[int, int]:
    status = entry.stat()
    return status.st_size, status.st_mtime_ns
