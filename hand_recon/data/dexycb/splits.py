"""DexYCB's setups s0 to s3: members of each split and ids of the frames (Sec. 4.1).

A frame's number in a split is its id in results files: subjects in the split's order, their sequences,
then cameras, then frames, counted before any label is looked at (NVlabs/dex-ycb-toolkit, `dex_ycb.py`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Int

from hand_recon.data.dexycb.files import SEQUENCES, SERIALS, SUBJECTS, Grasp

SETUPS: Final = {
    "s0": "all of them seen",
    "s1": "unseen subjects",
    "s2": "unseen views",
    "s3": "unseen objects",
}
"""Novelty of each setup's test frames."""

PARTS: Final = ("train", "val", "test")

_EVERY_SUBJECT: Final = tuple(range(len(SUBJECTS)))
_EVERY_CAMERA: Final = tuple(range(len(SERIALS)))
_EVERY_SEQUENCE: Final = tuple(range(SEQUENCES))
_LAST_OF_FIVE: Final = tuple(index for index in _EVERY_SEQUENCE if index % 5 == 4)
_HELD_OUT_OBJECTS: Final = (3, 7, 11, 15, 19)


@dataclass(frozen=True)
class Split:
    """A part of a setup."""

    subjects: tuple[int, ...] = _EVERY_SUBJECT
    """Indices in `SUBJECTS`, in the split's order."""
    sequences: tuple[int, ...] = _EVERY_SEQUENCE
    """Indices among a subject's sorted sequences."""
    cameras: tuple[int, ...] = _EVERY_CAMERA
    """Indices in `SERIALS`."""


@dataclass(frozen=True)
class Frames:
    """Every frame of a split, in the order of their ids: entry i belongs to id i."""

    grasps: tuple[Grasp, ...]
    """The sequences of the split."""
    grasp: Int[np.ndarray, " frame"]
    """Index of each frame's sequence in `grasps`."""
    camera: Int[np.ndarray, " frame"]
    """Index of the camera in `SERIALS`."""
    number: Int[np.ndarray, " frame"]
    """Number of the frame in its sequence."""

    def __len__(self) -> int:
        return len(self.grasp)

    def select(self, rows: Int[np.ndarray, " row"]) -> "Frames":
        """Some of the frames."""
        return Frames(self.grasps, self.grasp[rows], self.camera[rows], self.number[rows])


def split_named(setup: str, part: str) -> Split:
    """Subjects, sequences and cameras of a part of a setup.

    Raises:
        ValueError: There is no such setup or part.
    """
    if setup not in SETUPS or part not in PARTS:
        raise ValueError(
            f"Unknown split {setup!r} {part!r}; the setups are {list(SETUPS)} and their parts {list(PARTS)}."
        )
    return _SPLITS[setup][PARTS.index(part)]


def enumerate_frames(split: Split, grasps: Sequence[Grasp]) -> Frames:
    """List the frames of a split in the order of their ids, from the frame counts of the sequences.

    Args:
        split: Subjects, sequences and cameras of the split.
        grasps: All sequences of the split's subjects, in the split's order of subjects.
    """
    chosen = tuple(grasp for grasp in grasps if grasp.index in split.sequences)
    counts = np.array([grasp.frames for grasp in chosen], dtype=np.int64)
    cameras = np.array(split.cameras, dtype=np.int64)
    # One run of frames per sequence and camera; cameras vary in the outer loop, frames in the inner one.
    lengths = np.repeat(counts, len(cameras))
    starts = np.cumsum(lengths) - lengths
    return Frames(
        grasps=chosen,
        grasp=np.repeat(np.arange(len(chosen)), counts * len(cameras)),
        camera=np.repeat(np.tile(cameras, len(chosen)), lengths),
        number=np.arange(lengths.sum()) - np.repeat(starts, lengths),
    )


def _without(sequences: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(index for index in _EVERY_SEQUENCE if index not in sequences)


def _of_objects(objects: tuple[int, ...]) -> tuple[int, ...]:
    """Sequences that show some objects; five consecutive ones show one object."""
    return tuple(index for index in _EVERY_SEQUENCE if index // 5 in objects)


_SPLITS: Final[dict[str, tuple[Split, Split, Split]]] = {
    "s0": (
        Split(sequences=_without(_LAST_OF_FIVE)),
        Split(subjects=(0, 1), sequences=_LAST_OF_FIVE),
        Split(subjects=tuple(range(2, 10)), sequences=_LAST_OF_FIVE),
    ),
    "s1": (
        Split(subjects=(0, 1, 2, 3, 4, 5, 9)),
        Split(subjects=(6,)),
        Split(subjects=(7, 8)),
    ),
    "s2": (Split(cameras=(0, 1, 2, 3, 4, 5)), Split(cameras=(6,)), Split(cameras=(7,))),
    "s3": (
        Split(sequences=_without(_of_objects(_HELD_OUT_OBJECTS))),
        Split(sequences=_of_objects((3, 19))),
        Split(sequences=_of_objects((7, 11, 15))),
    ),
}
