"""Table of clinical joint angles as a CSV file, for spreadsheets and statistics."""

import csv
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from hand_recon.formats.clinical_angles import CLINICAL_ANGLES, clinical_degrees
from hand_recon.formats.exported_hands import ExportedHand, ExportedHands, Scene
from hand_recon.formats.new_file import write_new

COLUMNS: Final = (
    "scene", "image", "hand", "side", "frame", "time_s", "seen",
    *(f"{one.name}_deg" for one in CLINICAL_ANGLES),
)  # fmt: skip
"""Columns of the table."""

_ANGLE_DECIMALS: Final = 4
_TIME_DECIMALS: Final = 6


def write_clinical_table(path: str | Path, hands: ExportedHands) -> Path:
    """Write a CSV file with a row per hand and frame, hand by hand; folders are made.

    `scene` is the beginning of the names of the other files, and `image` the photograph's name as the file of
    hands has it, empty for a clip; `seen` is 0 where a gap of a clip was bridged, and 1
    elsewhere.

    Args:
        path: File to write.
        hands: The hands.

    Raises:
        FileExistsError: The file exists.
    """
    stream = io.StringIO(newline="")
    writer = csv.writer(stream)
    writer.writerow(COLUMNS)
    for scene, hand in hands:
        writer.writerows(_rows(scene, hand))
    return write_new(path, stream.getvalue().encode("utf-8", "backslashreplace"))


def _rows(scene: Scene, hand: ExportedHand) -> Iterator[list[object]]:
    motion = hand.trajectory
    # Adding zero turns −0 into 0.
    degrees = clinical_degrees(motion).round(_ANGLE_DECIMALS) + 0.0
    for frame, time, seen, angles in zip(
        motion.frames.tolist(), motion.times.round(_TIME_DECIMALS).tolist(),
        motion.observed.astype(int).tolist(), degrees.tolist(), strict=True,
    ):  # fmt: skip
        yield [scene.name, scene.image or "", motion.hand, motion.side, frame, time, seen, *angles]
