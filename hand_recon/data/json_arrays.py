"""Reads large JSON lists of equal arrays without building Python lists of them.

FreiHAND's training vertices are 76 million numbers: some five gigabytes as lists, 0.3 as an array. Where the
package pysimdjson is installed, it parses them seven to ten times as fast as NumPy.
"""

import importlib
import importlib.util
import json
import logging
import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hand_recon.data.cache import digest, ensure_built, file_identity

logger = logging.getLogger(__name__)

CHUNK = 1 << 20
"""Bytes of text that are turned into numbers at a time, few enough for the cache."""

FIRST: Final = 1 << 25
"""Bytes of text in which the first element must end."""

LONGEST = 1000
"""Characters of one number; a double needs 25 at most."""


def load_json_array(path: Path, cache_dir: Path | None) -> np.ndarray:
    """A JSON list of equal arrays of numbers, parsed once and then mapped into memory.

    Args:
        path: The JSON file.
        cache_dir: Folder where the array is kept; None parses the file every time.

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
            shape = _shape_of_first(stream.read(FIRST).decode("ascii"))
        with path.open("rb") as stream:
            numbers, brackets = scan_numbers(iter(lambda: stream.read(CHUNK), b""), to_numbers)
        rows, left_over = divmod(len(numbers), math.prod(shape))
        # An element of shape (21, 3) opens one bracket for itself and one for each of its rows.
        per_row = sum(math.prod(shape[:depth]) for depth in range(len(shape)))
        if left_over or brackets != (1 + rows * per_row,) * 2:
            raise ValueError(f"{len(numbers)} numbers do not make a list of {shape} arrays")
    except ValueError as error:
        raise ValueError(
            f"{path} is not a complete JSON list of equal arrays of numbers ({error}). It may be "
            "cut off: unpack it again, or correct the program that wrote it."
        ) from error
    return numbers.reshape(rows, *shape)


def _shape_of_first(text: str) -> tuple[int, ...]:
    """The shape of a list's first element."""
    text = text.lstrip()
    if not text.startswith("["):
        raise ValueError("it does not start with a bracket")
    try:
        first = np.array(json.JSONDecoder().raw_decode(text[1:].lstrip())[0])
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error
    if first.dtype.kind not in "iuf" or first.size == 0:
        raise ValueError("its first element holds no numbers")
    return first.shape


def scan_numbers(
    chunks: Iterable[bytes],
    to_array: Callable[[bytes], NDArray[np.float64]],
    most: float = math.inf,
    longest: int = LONGEST,
) -> tuple[NDArray[np.float32], tuple[int, int]]:
    """All numbers of a JSON text in single precision, and how many brackets open and close.

    Args:
        chunks: The text in pieces, cut anywhere.
        to_array: Parses numbers separated by commas; raises a `ValueError` if something else is among them.
        most: Largest count of numbers.
        longest: Largest count of characters of one number.

    Raises:
        ValueError: There are more numbers, a number is longer, or something is not a number.
    """
    parts: list[NDArray[np.float32]] = []
    opened = closed = count = 0
    rest = b""
    for chunk in chunks:
        opened += _count(chunk, b"[")
        closed += _count(chunk, b"]")
        # Only commas and numbers are left: the last comma ends a whole number.
        complete, _, rest = (rest + chunk.translate(None, b"[] \t\r\n")).rpartition(b",")
        if len(rest) > longest:
            raise ValueError(f"a number in it has more than {longest} digits.")
        if complete:
            parts.append(to_array(complete).astype(np.float32))
            count += len(parts[-1])
        if count > most:
            raise ValueError(f"it has more than {most} numbers.")
    parts.append(to_array(rest).astype(np.float32))
    return np.concatenate(parts), (opened, closed)


def _count(text: bytes, character: bytes) -> int:
    # A third of the time of bytes.count, which is made for rare characters.
    return int(np.count_nonzero(np.frombuffer(text, dtype=np.uint8) == ord(character)))


def to_numbers(text: bytes) -> NDArray[np.float64]:
    """Numbers separated by commas.

    Raises:
        ValueError: Something is not a number, or there is none.
    """
    numbers = _numbers_of_json(text)
    if numbers is not None:
        return numbers
    last = text.rpartition(b",")[2]
    # Older NumPy only warns where it stops within a number, which the count shows unless it is the last one.
    if not _is_number(last):
        raise ValueError("something in it is not a number")
    numbers = np.fromstring(text.decode("ascii"), sep=",", dtype=np.float64)
    if len(numbers) != text.count(b",") + 1:
        raise ValueError("something in it is not a number")
    return numbers


def _is_number(text: bytes) -> bool:
    """True for what Python and NumPy both read as one number."""
    try:
        float(text)
    except ValueError:
        return False
    # Python alone takes an underscore between digits.
    return b"_" not in text


def _simdjson() -> Any:  # noqa: ANN401  # a module, where it is installed
    found = importlib.util.find_spec("simdjson") is not None
    return importlib.import_module("simdjson") if found else None


SIMDJSON: Final = _simdjson()
"""The package pysimdjson, where it is installed; None without it."""


def _numbers_of_json(text: bytes) -> NDArray[np.float64] | None:
    """Numbers parsed by simdjson; None without it, and where something is no number of JSON, as NaN is."""
    if SIMDJSON is None or not text:
        return None
    try:
        numbers = SIMDJSON.Parser().parse(b"[" + text + b"]").as_buffer(of_type="d")
    except (ValueError, TypeError, RuntimeError):
        return None
    return np.frombuffer(numbers, dtype=np.float64).copy()
