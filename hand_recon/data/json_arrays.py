"""Reads big JSON lists of equal arrays without ever holding them as Python objects.

FreiHAND's training vertices are 76 million numbers: some five gigabytes as lists, 0.3 as an array.
"""

import json
import logging
import math
from pathlib import Path

import numpy as np

from hand_recon.data.cache import digest, ensure_built, file_identity

logger = logging.getLogger(__name__)

CHUNK = 1 << 25
"""Bytes of text that are turned into numbers at a time."""


def load_json_array(path: Path, cache_dir: Path | None) -> np.ndarray:
    """A JSON list of equal arrays of numbers, parsed once and then mapped into memory.

    Args:
        path: The JSON file.
        cache_dir: Where the array is kept; none parses the file every time.

    Returns:
        Float32, one row per element of the list.

    Raises:
        ValueError: The file holds something else, or is cut off.
    """
    if cache_dir is None:
        return parse_json_array(path)

    def build(folder: Path) -> None:
        logger.info("Reading %s once (%.0f MB)", path, path.stat().st_size / 1e6)
        np.save(folder / "array.npy", parse_json_array(path))

    target = cache_dir / f"{path.stem}-{digest(file_identity(path))}"
    ensure_built(target, build)
    array: np.ndarray = np.load(target / "array.npy", mmap_mode="r", allow_pickle=False)
    return array


def parse_json_array(path: Path) -> np.ndarray:
    """A JSON list of equal arrays of numbers as float32, one row per element of the list.

    Raises:
        ValueError: The file holds something else, or is cut off.
    """
    try:
        with path.open("rb") as stream:
            shape = _shape_of_first(stream.read(CHUNK).decode("ascii"))
        numbers, brackets = _read_numbers(path)
        rows, left_over = divmod(len(numbers), math.prod(shape))
        # An element of shape (21, 3) opens one bracket for itself and one for each of its rows.
        per_row = sum(math.prod(shape[:depth]) for depth in range(len(shape)))
        if left_over or brackets != (1 + rows * per_row,) * 2:
            raise ValueError(f"{len(numbers)} numbers do not make a list of {shape} arrays")
    except ValueError as error:
        raise ValueError(
            f"{path} is not a complete JSON list of equal arrays of numbers ({error}). It may be "
            "cut off: unpack it again, or mend what wrote it."
        ) from error
    return numbers.reshape(rows, *shape)


def _shape_of_first(text: str) -> tuple[int, ...]:
    """The shape of a list's first element."""
    text = text.lstrip()
    if not text.startswith("["):
        raise ValueError("it does not start with a bracket")
    first = np.array(json.JSONDecoder().raw_decode(text[1:].lstrip())[0])
    if first.dtype.kind not in "iuf" or first.size == 0:
        raise ValueError("its first element holds no numbers")
    return first.shape


def _read_numbers(path: Path) -> tuple[np.ndarray, tuple[int, int]]:
    """All numbers in their order, and how many brackets open and close."""
    parts: list[np.ndarray] = []
    opened = closed = 0
    rest = b""
    with path.open("rb") as stream:
        while chunk := stream.read(CHUNK):
            opened += chunk.count(b"[")
            closed += chunk.count(b"]")
            # Only brackets, commas, space and numbers are left: the last comma ends a whole number.
            complete, _, rest = (rest + chunk).translate(None, b"[] \t\r\n").rpartition(b",")
            if complete:
                parts.append(_to_numbers(complete))
    parts.append(_to_numbers(rest))
    return np.concatenate(parts), (opened, closed)


def _to_numbers(text: bytes) -> np.ndarray:
    numbers = np.fromstring(text.decode("ascii"), sep=",", dtype=np.float64)
    if len(numbers) != text.count(b",") + 1:
        raise ValueError("something in it is not a number")
    return numbers.astype(np.float32)
