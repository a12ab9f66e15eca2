"""Tables of reconstructed hands for spreadsheets: `hands.csv`, a row per hand, and `landmarks.csv`."""

import csv
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from hand_recon.fitting.hand_records import HandRecords
from hand_recon.fitting.hands_file import DECIMALS
from hand_recon.hand.skeleton import ARTICULATED, AXES, LANDMARKS

ANGLES: Final = tuple(
    f"{joint} {axis} degrees".replace(" ", "_") for joint in ARTICULATED for axis in AXES
)
"""Columns of the joint angles in `hands.csv`, such as `index_MCP_bend_degrees`."""

HAND_COLUMNS: Final = (
    "hand", "image", "name", "side", "score", "verdict", "reasons", "residual_px", "x_m", "y_m", "z_m",
    "camera", "focal_px", *ANGLES, *(f"shape_{number}" for number in range(10)), "source",
)  # fmt: skip
"""Columns of `hands.csv`; x, y and z are the wrist's in the camera's frame."""

LANDMARK_COLUMNS: Final = (
    "hand", "image", "side", "landmark", "observed_u_px", "observed_v_px", "u_px", "v_px", "sigma_u_px",
    "sigma_v_px", "x_m", "y_m", "z_m",
)  # fmt: skip
"""Columns of `landmarks.csv`, 21 rows per hand."""


def write_tables(folder: Path, hands: HandRecords) -> None:
    """Write `hands.csv` and `landmarks.csv`; numbers that are missing are empty cells.

    Args:
        folder: Folder of the tables.
        hands: The hands.
    """
    _write(folder / "hands.csv", HAND_COLUMNS, _hand_rows(hands))
    _write(folder / "landmarks.csv", LANDMARK_COLUMNS, _landmark_rows(hands))


def _write(path: Path, columns: tuple[str, ...], rows: Iterable[list[object]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(columns)
        writer.writerows(rows)


def _hand_rows(hands: HandRecords) -> Iterator[list[object]]:
    for hand in range(len(hands)):
        yield [
            hand, hands.images[hand] or "", hands.names[hand], hands.sides[hand],
            *_cells(hands.score[hand], "score"), hands.verdicts[hand], " ".join(hands.reasons[hand]),
            *_cells(hands.residual[hand], "residual"),
            *_cells(hands.landmarks_3d[hand, 0], "landmarks_3d"),
            hands.cameras[hand] or "", *_cells(hands.intrinsics[hand, 0, 0], "intrinsics"),
            *_cells(hands.joint_angles_degrees[hand], "joint_angles_degrees"),
            *_cells(hands.shape[hand], "shape"), hands.sources[hand],
        ]  # fmt: skip


def _landmark_rows(hands: HandRecords) -> Iterator[list[object]]:
    for hand in range(len(hands)):
        for landmark, name in enumerate(LANDMARKS):
            yield [
                hand, hands.images[hand] or "", hands.sides[hand], name,
                *(
                    cell
                    for key in ("observed_2d", "landmarks_2d", "sigma_2d", "landmarks_3d")
                    for cell in _cells(getattr(hands, key)[hand, landmark], key)
                ),
            ]  # fmt: skip


def _cells(values: Float[np.ndarray, "..."] | float, key: str) -> list[object]:
    rounded = np.asarray(values, dtype=float).round(DECIMALS[key]).ravel().tolist()
    return ["" if np.isnan(value) else value for value in rounded]
