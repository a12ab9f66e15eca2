"""Markers (.trc) and joint angles (.mot) of one hand, for OpenSim and other programs of biomechanics.

A .trc file has the 21 landmarks of the file of hands as markers, millimetres, in a world with x to the right,
y up and z towards the viewer, with the camera at its origin. A landmark of a frame without the hand is three
times `NaN`. A .mot file has the 45 joint angles in degrees, under the names and with the signs of
`clinical_angles.py`; frames without the hand are bridged by lines, because motion files hold no gaps.
OpenSim's models have coordinates of their own: rename the columns to those of the model, and check the signs.

Both have even times. They begin at the hand's first frame and have the times of the clip.
"""

from pathlib import Path
from typing import Final

import numpy as np

from hand_recon.formats.clinical_angles import CLINICAL_ANGLES, clinical_degrees
from hand_recon.formats.even_times import even_rows
from hand_recon.formats.exported_hands import ExportedHand
from hand_recon.formats.joint_motion import check_motions
from hand_recon.formats.new_file import write_new
from hand_recon.hand.skeleton import LANDMARKS
from hand_recon.rendering.mesh_files import CAMERA_TO_GLTF

MARKERS: Final = tuple(name.replace(" ", "_") for name in LANDMARKS)
"""Names of the markers, in the order of the landmarks."""


def write_trc(path: str | Path, hand: ExportedHand) -> Path:
    """Write the landmarks of a hand as markers; folders are made.

    Args:
        path: File to write.
        hand: The hand.

    Raises:
        FileExistsError: The file exists.
        ValueError: The hand has no frame, numbers are not finite, or a time is negative.
    """
    check_motions([hand.trajectory])
    rows = even_rows(hand.trajectory)
    points = 1000 * rows.sample(hand.landmarks * np.array(CAMERA_TO_GLTF))
    rate, count = f"{1 / rows.step:.6f}", len(points)
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{Path(path).name}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"{rate}\t{rate}\t{count}\t{len(MARKERS)}\tmm\t{rate}\t1\t{count}",
        "Frame#\tTime\t" + "\t\t\t".join(MARKERS) + "\t\t",
        "\t\t" + "\t".join(f"{axis}{one}" for one in range(1, len(MARKERS) + 1) for axis in "XYZ"),
        "",
    ]
    for number, (time, flat, in_gap) in enumerate(
        zip(rows.times.tolist(), points.reshape(count, -1), rows.in_gap.tolist(), strict=True)
    ):
        # Adding zero turns −0 into 0.
        # OpenSim miscounts the columns of a row whose last cell is empty, and reads NaN.
        cells = ["NaN"] * flat.size if in_gap else [f"{one + 0.0:.4f}" for one in flat.round(4)]
        lines.append("\t".join([str(number + 1), f"{time:.6f}", *cells]))
    return write_new(path, ("\n".join(lines) + "\n").encode("utf-8"))


def write_mot(path: str | Path, hand: ExportedHand) -> Path:
    """Write the joint angles of a hand as a motion file; folders are made.

    Args:
        path: File to write.
        hand: The hand.

    Raises:
        FileExistsError: The file exists.
        ValueError: The hand has no frame, numbers are not finite, or a time is negative.
    """
    check_motions([hand.trajectory])
    rows = even_rows(hand.trajectory)
    degrees = rows.sample(clinical_degrees(hand.trajectory))
    lines = [
        "Coordinates", "version=1", f"nRows={len(degrees)}", f"nColumns={1 + degrees.shape[1]}",
        "inDegrees=yes", "endheader", "\t".join(["time", *(one.name for one in CLINICAL_ANGLES)]),
    ]  # fmt: skip
    for time, angles in zip(rows.times.tolist(), (degrees.round(5) + 0.0).tolist(), strict=True):
        lines.append("\t".join([f"{time:.6f}", *(f"{angle:.5f}" for angle in angles)]))
    return write_new(path, ("\n".join(lines) + "\n").encode("utf-8"))
