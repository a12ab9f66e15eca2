"""Readers of .trc and .mot files, written from the rules of OpenSim's readers alone."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

TRC_KEYS = [
    "DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units", "OrigDataRate", "OrigDataStartFrame",
    "OrigNumFrames",
]  # fmt: skip
"""Keys of the second line, which the reader compares word by word."""


@dataclass(frozen=True)
class Markers:
    """Content of a .trc file."""

    names: list[str]
    times: Float[np.ndarray, " row"]
    points: Float[np.ndarray, "row marker 3"]
    """Metres; NaN for missing ones."""
    rate: float


def read_trc(path: Path) -> Markers:
    """Read a file of markers, and fail where OpenSim would."""
    lines = path.read_text(encoding="utf-8").split("\n")
    assert lines[0].split("\t")[:3] == ["PathFileType", "4", "(X/Y/Z)"]
    assert lines[1].split("\t") == TRC_KEYS
    values = dict(zip(TRC_KEYS, lines[2].split("\t"), strict=True))
    heads = lines[3].split("\t")
    assert heads[:2] == ["Frame#", "Time"]
    names = heads[2::3]
    assert not any(heads[3::3]) and not any(heads[4::3])  # noqa: PT018
    axes = lines[4].split("\t")
    assert axes[:2] == ["", ""]
    assert axes[2:] == [f"{axis}{marker + 1}" for marker in range(len(names)) for axis in "XYZ"]
    assert lines[5] == ""
    rows = [line.split("\t") for line in lines[6 : lines.index("", 6)]]
    # OpenSim 4.6 drops the last cell of a row if it is empty, and then refuses the row.
    assert all(len(row) == 2 + 3 * len(names) and row[-1] for row in rows)
    assert [int(row[0]) for row in rows] == list(range(1, int(values["NumFrames"]) + 1))
    assert int(values["NumMarkers"]) == len(names)
    unit = {"mm": 1e-3, "m": 1.0}[values["Units"]]
    cells = [[float(cell) if cell else np.nan for cell in row[2:]] for row in rows]
    points = unit * np.array(cells).reshape(len(rows), len(names), 3)
    times = np.array([float(row[1]) for row in rows])
    return Markers(names, times, points, float(values["DataRate"]))


def read_mot(path: Path) -> tuple[dict[str, Float[np.ndarray, " row"]], dict[str, str]]:
    """Columns of a motion file by name, and its header."""
    lines = path.read_text(encoding="utf-8").split("\n")
    end = lines.index("endheader")
    header = dict(line.split("=") for line in lines[1:end])
    names = lines[end + 1].split("\t")
    rows = np.array([[float(cell) for cell in line.split("\t")] for line in lines[end + 2 : -1]])
    assert names[0] == "time"
    assert lines[-1] == ""
    assert rows.shape == (int(header["nRows"]), int(header["nColumns"])) == (len(rows), len(names))
    return dict(zip(names, rows.T, strict=True)), header
