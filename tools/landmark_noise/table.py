"""Fit of the table of σ: the logarithm of the copies' spread as a linear function of a reading's features."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from hand_recon.detection.copies import COPIES
from hand_recon.detection.landmark_noise import SHARED, Features, NoiseTable
from landmark_noise.readings import CopiedHand

PENALTY: Final = 3.0
"""Weight of the squared coefficients of standardized features, in squared errors of the logarithm."""


def fit_table(hands: Sequence[CopiedHand], gain: Float[np.ndarray, " count"]) -> NoiseTable:
    """Fit a table by ridge regression.

    Args:
        hands: Hands read in copies.
        gain: σ per spread by the number of copies, which the table will have.
    """
    columns = np.concatenate([_columns(hand.features) for hand in hands])
    wanted = np.log(np.concatenate([hand.spread(len(COPIES)) for hand in hands]))
    middle, size = columns.mean(axis=0), columns.std(axis=0) + 1e-9
    scaled = (columns - middle) / size
    normal = scaled.T @ scaled + PENALTY * np.eye(scaled.shape[1])
    coefficients = np.linalg.solve(normal, scaled.T @ (wanted - wanted.mean())) / size
    constant = wanted.mean() - middle @ coefficients
    return NoiseTable(
        constant=coefficients[:21] + constant,
        curl=coefficients[21:42],
        shared=coefficients[42:],
        gain=gain,
    )


def _columns(features: Features) -> Float[np.ndarray, "landmark=21 column"]:
    each = np.eye(21)
    return np.concatenate([each, each * features.curl[:, None], features.shared], axis=1)


def write_table(table: NoiseTable, path: Path, command: str) -> None:
    """Write a table as YAML.

    Args:
        table: The table.
        path: The file.
        command: Command that made it, for the first lines.
    """
    lines = [
        "# Spread of transformed copies of a hand's crop, for σ of each landmark (decision 68). Written by",
        f"#   {command}",
        "# and calibrated by",
        "#   python -m tools.measure_landmark_noise calibrate <clip>",
        "# Logarithm of the spread in sides of the hand's square: constant of each landmark, in the order of",
        "# hand_recon.hand.skeleton.LANDMARKS, + curl × curl + Σ shared × feature.",
        f"constant: {_row(table.constant)}",
        f"curl: {_row(table.curl)}",
        "shared:",
        *(f"  {name}: {value:.3f}" for name, value in zip(SHARED, table.shared, strict=True)),
        "# Error that readings do not share, per spread, by the number of copies, from none to eight.",
        "gain: [" + ", ".join(f"{value:.2f}" for value in table.gain) + "]",
    ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _row(values: Float[np.ndarray, "landmark=21"]) -> str:
    """Values as a list of several lines."""
    groups = [values[:1], *np.split(values[1:], 5)]
    rows = [", ".join(f"{value:.3f}" for value in group) for group in groups]
    return "[\n  " + ",\n  ".join(rows) + ",\n]"
