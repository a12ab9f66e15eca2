"""Errors that name the hands of a file that are wrong."""

from pathlib import Path

import numpy as np
from jaxtyping import Bool


def refuse(path: Path, wrong: Bool[np.ndarray, " hand"], what: str) -> None:
    """Raise an error that names the first wrong hands, if there are any.

    Raises:
        ValueError: A hand is wrong.
    """
    if wrong.any():
        first = ", ".join(str(hand) for hand in np.flatnonzero(wrong)[:5])
        raise ValueError(
            f"{path}: {int(wrong.sum())} of {len(wrong)} hands have {what} Counted from 0: {first}."
        )
