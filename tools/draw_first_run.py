"""Draw a run's overlays side by side for the README: `python tools/draw_first_run.py RUN_FOLDER`."""

import argparse
from pathlib import Path

import cv2
import numpy as np

TARGET = Path(__file__).resolve().parents[1] / "docs" / "images" / "first_run.png"
"""The image to write."""

ROWS = 4
"""Overlays in each of the two columns."""


def main() -> None:
    """Write overlays at equal steps from the run's best hand to its worst, in two columns."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path, help="folder of a run with at least eight overlays")
    paths = sorted((parser.parse_args().run / "overlays").glob("*.png"))
    if len(paths) < 2 * ROWS:
        raise SystemExit(
            f"Found {len(paths)} overlays, expected {2 * ROWS} or more. Train with report.images=12."
        )
    chosen = [paths[position * len(paths) // (2 * ROWS)] for position in range(2 * ROWS)]
    rows = [np.asarray(cv2.imread(str(path))) for path in chosen]
    left, right = np.concatenate(rows[:ROWS]), np.concatenate(rows[ROWS:])
    gap = np.full((left.shape[0], 24, 3), 255, dtype=np.uint8)
    sheet = np.concatenate([left, gap, right], axis=1)
    small = cv2.resize(sheet, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(TARGET), small, [cv2.IMWRITE_PNG_COMPRESSION, 9])


if __name__ == "__main__":
    main()
