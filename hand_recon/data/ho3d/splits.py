"""Splits HO3D's training frames by recording, so that no grasp is in two splits."""

import re
from collections.abc import Sequence
from typing import Final

import numpy as np
from jaxtyping import Int

HELD_OUT_PARTS: Final = ("val", "test")


def recording_of(frame: str) -> str:
    """The recording of a frame.

    Five cameras saw one grasp: sequences ABF10 to ABF14 are recording ABF1 (shreyashampali/ho3d,
    `vis_pcl_all_cameras.py`), and a name with one digit is a recording of its own.
    """
    sequence = frame.split("/")[0]
    several = re.fullmatch(r"(.*\d)\d", sequence)
    return several.group(1) if several else sequence


def split_frames(
    frames: Sequence[str], fraction: float, seed: int, *, with_test: bool
) -> dict[str, Int[np.ndarray, " row"]]:
    """Rows of each split, in order.

    Args:
        frames: Names of the frames, `SEQ/0000`.
        fraction: Smallest share of the frames for validation; recordings stay whole.
        seed: Seed of the split.
        with_test: Hold out as many frames again for testing.

    Raises:
        ValueError: There are too few recordings.
    """
    of_frame = np.array([recording_of(frame) for frame in frames])
    recordings, counts = np.unique(of_frame, return_counts=True)
    order = list(np.random.default_rng(seed).permutation(len(recordings)))
    parts = HELD_OUT_PARTS if with_test else HELD_OUT_PARTS[:1]
    if len(recordings) <= len(parts):
        raise ValueError(
            f"{len(recordings)} recordings ({', '.join(recordings[:5])}) cannot be split into train, "
            f"{' and '.join(parts)} without showing the same grasp in two of them. Add sequences to the list"
            f"{', or test on the evaluation part: data.test_source=evaluation' if with_test else ''}."
        )
    rows = {}
    for position, part in enumerate(parts):
        chosen: list[int] = []
        # At least one recording, and at least one is left for every further part.
        left = len(parts) - position
        while not chosen or (counts[chosen].sum() < fraction * len(frames) and len(order) > left):
            chosen.append(order.pop(0))
        rows[part] = np.flatnonzero(np.isin(of_frame, recordings[chosen]))
    rows["train"] = np.flatnonzero(np.isin(of_frame, recordings[order]))
    return rows
