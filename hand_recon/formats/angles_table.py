"""Joint angles of the hands of a clip as a table for spreadsheets and statistics."""

import csv
import io
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from hand_recon.fitting.hands_file import DECIMALS
from hand_recon.fitting.hands_tables import ANGLES
from hand_recon.formats.joint_motion import check_motions
from hand_recon.formats.new_file import write_new
from hand_recon.motion.trajectory import Trajectory

COLUMNS: Final = ("hand", "side", "frame", "time_s", "observed", *ANGLES)
"""Columns of `angles.csv`; the angles' names are those of `hands.csv`."""

_TIME_DECIMALS: Final = 6


def write_angles(path: str | Path, trajectories: Sequence[Trajectory]) -> Path:
    """Write a CSV file with a row per hand and frame, hand by hand; folders are made.

    Angles are in degrees from the anatomical neutral: positive bend is flexion, positive splay of a finger
    is towards the thumb, and both mean the same for left and right hands. `observed` is 1 where the hand
    was seen and 0 where a gap was bridged.

    Args:
        path: File to write.
        trajectories: Hands of one clip.

    Raises:
        FileExistsError: The file exists.
        ValueError: There is no hand, a hand has no frame, numbers are not finite, or a time is negative.
    """
    check_motions(trajectories)
    stream = io.StringIO(newline="")
    writer = csv.writer(stream)
    writer.writerow(COLUMNS)
    for trajectory in trajectories:
        writer.writerows(_rows(trajectory))
    return write_new(path, stream.getvalue().encode("utf-8"))


def _rows(trajectory: Trajectory) -> Iterator[list[object]]:
    degrees = np.degrees(trajectory.joint_angles.astype(np.float64)).reshape(len(trajectory), -1)
    # Adding zero turns −0 into 0.
    rounded = degrees.round(DECIMALS["joint_angles_degrees"]) + 0.0
    for frame, time, observed, angles in zip(
        trajectory.frames.tolist(), trajectory.times.round(_TIME_DECIMALS).tolist(),
        trajectory.observed.astype(int).tolist(), rounded.tolist(), strict=True,
    ):  # fmt: skip
        yield [trajectory.hand, trajectory.side, frame, time, observed, *angles]
