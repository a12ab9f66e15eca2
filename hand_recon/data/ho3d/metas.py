"""Reads HO3D's `meta/*.pkl`, dictionaries of small arrays, without executing pickled code.

A pickle names functions and classes that its reader imports and calls. Arrays need five; each of them is
replaced by an inert record (`inert_pickle.py`), and any other name is refused.
The files were written by Python 2 (shreyashampali/ho3d): their strings are read as Latin-1.
"""

from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from hand_recon.hand.mano.inert_pickle import RefusedPickleError, load_inert
from hand_recon.hand.mano.pickled_arrays import (
    BUFFER_NAMES,
    NUMPY_NAMES,
    NoNumbersError,
    is_nothing,
    to_array,
)

MAX_BYTES: Final = 16 * 2**20
"""Largest file that is read, bytes; HO3D's have about 50 kB."""

MAX_OPERATIONS: Final = 2**17
"""Largest number of pickle instructions; HO3D's files have some hundreds."""

_CURE: Final = (
    "Unpack the archive again; if the error stays, remove the frame from the list of ids in the .txt "
    "file."
)


class RefusedMetaError(ValueError):
    """Error for a meta file that names unexpected functions, is damaged or lacks an entry."""


class Meta:
    """One frame's annotation."""

    def __init__(self, path: Path, content: dict[str, object]) -> None:
        """Store the content, which `read_meta` reads."""
        self.path = path
        self._content = content

    def __contains__(self, key: str) -> bool:
        return key in self._content

    def numbers(self, key: str, shape: tuple[int, ...]) -> Float[np.ndarray, "..."] | None:
        """An entry as an array of the given shape; None where the frame has no annotation.

        Raises:
            RefusedMetaError: The entry is missing, or it is not an array of that shape.
        """
        if key not in self._content:
            raise RefusedMetaError(
                f"{self.path} has no {key}; it has {_first_keys(self._content)}. {_CURE}"
            )
        if is_nothing(self._content[key]):
            return None
        try:
            found = to_array(self._content[key])
        except NoNumbersError as error:
            raise RefusedMetaError(f"{self.path}: {key}: {error}. {_CURE}") from error
        if found.shape != shape and found.squeeze().shape != shape:
            raise RefusedMetaError(
                f"{self.path}: {key} has the shape {found.shape}, expected {shape}. Training and evaluation "
                "have annotations of their own: are they in the right folders?"
            )
        return found.reshape(shape).astype(np.float64)


def read_meta(path: Path) -> Meta:
    """Read one file.

    Raises:
        RefusedMetaError: The file names more than arrays need, is damaged, or holds no dictionary.
        FileNotFoundError: The file is missing.
    """
    content = path.read_bytes()
    if len(content) > MAX_BYTES:
        raise RefusedMetaError(
            f"{path} has {len(content)} bytes, more than any annotation: not read. {_CURE}"
        )
    try:
        return Meta(path, load_inert(content, {**NUMPY_NAMES, **BUFFER_NAMES}, MAX_OPERATIONS))
    except RefusedPickleError as error:
        raise RefusedMetaError(f"{path} {error} {_CURE}") from error


def _first_keys(content: dict[str, object]) -> list[str]:
    return [key[:40] for key in sorted(content)[:30]]
