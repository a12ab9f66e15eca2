"""Streaming reader of JSON files `[landmarks of every frame, vertices of every frame]`.

HO3D's 20,137 frames of 778 vertices are 47 million numbers: a gigabyte of text, and ten gigabytes as Python
lists. The text is read in chunks and only arrays are kept. White space is dropped while reading, and all
that is kept has a maximum size, because an archive of a megabyte can unpack to a gigabyte.
"""

import itertools
import json
import re
from dataclasses import dataclass
from io import BufferedIOBase
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hand_recon.data.json_arrays import scan_numbers, to_numbers

CHUNK: Final = 1 << 20
"""Bytes of text that are parsed at a time, few enough for the cache."""

HEAD: Final = 1 << 20
"""Bytes in which the first frame must end: 778 points take less than a tenth of it."""

MAX_BYTES: Final = 1 << 32
"""Maximum file size in bytes, white space included: three times HO3D's."""

MAX_LANDMARK_BYTES: Final = 1 << 27
"""Maximum size of the landmarks' text in bytes: four times HO3D's."""

MAX_NUMBERS: Final = 1 << 27
"""Maximum count of the vertices' numbers: three times HO3D's; half a gigabyte."""

LONGEST: Final = 1000
"""Maximum digits of one number; a double needs 25 at most."""

_SPACE: Final = b" \t\r\n"
_WORD: Final = re.compile(rb"\"[^\"]{0,20}\"?|[A-Za-z_]{2,}|[^\w\s,.+\-\[\]]+")
_NUMBERS_BY_NAME: Final = (b"NaN", b"Infinity")

FORM: Final = (
    "Expected is a JSON list of two lists, [xyz, verts]: for every frame 21 points of three numbers, "
    "then for every frame the mesh's points of three numbers."
)
"""Description of the expected file, for messages."""


class _Dense:
    """Text of a stream without its white space."""

    def __init__(self, stream: BufferedIOBase) -> None:
        self._stream = stream
        self._left = MAX_BYTES

    def read(self, size: int) -> bytes:
        """Read between `size` and twice as many bytes, fewer at the end of the text."""
        text = bytearray()
        while len(text) < size and (chunk := self.read_as_it_is(size)):
            text += chunk.translate(None, _SPACE)
        return bytes(text)

    def read_as_it_is(self, size: int) -> bytes:
        """Read up to `size` bytes with their white space."""
        chunk = self._stream.read(size)
        self._left -= len(chunk)
        if self._left < 0:
            raise ValueError(f"it is longer than the {MAX_BYTES} bytes that are read.")
        return chunk


@dataclass(frozen=True)
class PointLists:
    """Contents of a file of predictions, in its own order, axes and unit."""

    landmarks: NDArray[np.float64]
    """Frames × 21 × 3."""
    vertices: NDArray[np.float32] | None
    """Frames × any number × 3; absent where the second list is absent or empty."""
    nested: bool
    """True if the landmarks were in an outer list, as they should be."""


def read_point_lists(stream: BufferedIOBase, name: str) -> PointLists:
    """Read landmarks and, where they follow, vertices.

    Args:
        stream: The JSON text, such as an open file or a member of an archive.
        name: Name of the file in messages.

    Raises:
        ValueError: The text has another structure; the message says what was found and what to do.
    """
    try:
        text = _Dense(stream)
        head = text.read(HEAD)
        nested = _check_head(head)
        first, rest = _first_list(head, text)
        landmarks = _landmarks(first, opening=2 if nested else 1)
        if not nested:
            _expect_the_end(rest + text.read(1))
            return PointLists(landmarks, None, nested)
        return PointLists(landmarks, _vertices(rest, text, len(landmarks)), nested)
    except ValueError as error:
        raise ValueError(f"{name} is no file of predictions: {error} {FORM}") from error


def read_point_list(stream: BufferedIOBase, name: str) -> NDArray[np.float32]:
    """Read one JSON list of frames with equally many points each: frames × points × 3, single precision.

    Raises:
        ValueError: The text has another structure, or is cut off.
    """
    try:
        text = _Dense(stream)
        head = text.read(HEAD)
        if _depth(head) != 3:
            raise ValueError("it does not begin as a list of frames of points.")
        numbers, brackets = _numbers(head, text)
        return _as_frames(numbers, brackets, surplus=0)
    except ValueError as error:
        raise ValueError(
            f"{name} is no list of frames of points: {error} Expected is a JSON list that has for every "
            "frame a list of points of three numbers; unpack it again, or correct the program that wrote it."
        ) from error


def _depth(text: bytes) -> int:
    """Number of brackets before the first number."""
    return len(text) - len(text.lstrip(b"["))


def _check_head(head: bytes) -> bool:
    """Check the first frame; return whether the landmarks are in an outer list."""
    if not head:
        raise ValueError("it is empty.")
    if head.startswith(b"{"):
        raise ValueError(
            "it holds a dictionary; write its lists of landmarks and vertices as one list."
        )
    if not head.startswith(b"["):
        raise ValueError(f"it begins with {head[:12]!r}, which is no JSON list.")
    depth = _depth(head)
    if head[depth : depth + 1] == b"{":
        raise ValueError(
            "it is a list of dictionaries; write lists without names, in the frames' order."
        )
    _refuse_words(head)
    if depth not in (3, 4):
        raise ValueError(
            f"its first number is {depth} lists deep and not four; "
            "a frame must be a list of points, and a point a list of three numbers."
        )
    _check_first_frame(_lengths_of_first_frame(head[depth:]))
    return depth == 4


def _lengths_of_first_frame(text: bytes) -> list[int]:
    """Count the numbers of each point of the first frame; `text` starts after the first brackets."""
    end = text.find(b"]]")
    if end < 0:
        raise ValueError("it is cut off within the first frame, or that frame never ends.")
    frame = text[:end]
    # Deeply nested brackets would overflow the parser's stack.
    if frame.count(b"[") != frame.count(b"],["):
        raise ValueError("its first frame has something else than points of numbers.")
    return [len(point) for point in json.loads(b"[[" + frame + b"]]")]


def _check_first_frame(lengths: list[int]) -> None:
    if set(lengths) != {3}:
        raise ValueError(
            f"a point of the first frame has {max(set(lengths) - {3}, default=0)} numbers and not 3; "
            "confidences and image coordinates do not belong here."
        )
    count = len(lengths)
    if count == 21:
        return
    advice = {
        42: "those of one hand only are scored: write the 21 of the annotated hand.",
        20: "one is missing, most likely the wrist.",
        16: "MANO's joints are without fingertips: add the five tips.",
    }.get(count, "check what wrote them.")
    if count > 42:
        advice = "this seems to be the mesh: write the landmarks first and the vertices second."
    raise ValueError(f"the first frame has {count} points and not 21; {advice}")


def _refuse_words(text: bytes) -> None:
    words = (word.group() for word in _WORD.finditer(text))
    other = next((word for word in words if word not in _NUMBERS_BY_NAME), None)
    if other is None:
        return
    found = other[:24].decode("ascii", "replace")
    advice = "numbers must not be in quotes." if found.startswith('"') else "it is no number."
    raise ValueError(f"it contains {found!r}: {advice}")


def _first_list(head: bytes, stream: _Dense) -> tuple[bytes, bytes]:
    """Split the text after the first list of frames; return both parts as far as they were read."""
    text = bytearray(head)
    searched = 0
    while (end := text.find(b"]]]", searched)) < 0:
        searched = max(0, len(text) - 2)
        if searched > MAX_LANDMARK_BYTES:
            raise ValueError(f"its landmarks take more than {MAX_LANDMARK_BYTES} bytes.")
        chunk = stream.read(CHUNK)
        if not chunk:
            raise ValueError("it is cut off within the landmarks; write or copy it again.")
        text += chunk
    return bytes(text[: end + 3]), bytes(text[end + 3 :])


def _landmarks(text: bytes, opening: int) -> NDArray[np.float64]:
    numbers = _to_numbers(text.translate(None, b"[]"))
    frames, left_over = divmod(len(numbers), 63)
    # One bracket opens for each frame, and one for each of its points.
    if left_over or text.count(b"[") != opening + 22 * frames:
        raise ValueError(
            f"the landmarks are {len(numbers)} numbers, which are not 21 points of three for every frame; "
            "some frame has other points than the first."
        )
    return numbers.reshape(frames, 21, 3)


def _vertices(rest: bytes, stream: _Dense, frames: int) -> NDArray[np.float32] | None:
    rest += stream.read(HEAD)
    if rest.startswith(b"]"):
        _expect_the_end(rest[1:] + stream.read(1))
        return None
    if not rest.startswith(b","):
        raise ValueError(
            "the landmarks are not followed by the vertices; it is cut off. Write or copy it again."
        )
    numbers, brackets = _numbers(rest[1:], stream)
    if len(numbers) == 0:
        if brackets[1] != brackets[0] + 1:
            raise ValueError("it is cut off within the vertices; write or copy it again.")
        return None
    vertices = _as_frames(numbers, brackets, surplus=1)
    if len(vertices) != frames:
        raise ValueError(
            f"it has {frames} frames of landmarks and {len(vertices)} frames of vertices."
        )
    return vertices


def _expect_the_end(rest: bytes) -> None:
    if rest:
        raise ValueError(f"after its end follows {rest[:20]!r}.")


def _as_frames(
    numbers: NDArray[np.float32], brackets: tuple[int, int], surplus: int
) -> NDArray[np.float32]:
    """Reshape numbers to frames × points × 3; `surplus` lists were opened before the text began."""
    if brackets[1] != brackets[0] + surplus:
        raise ValueError("its brackets do not match: it is cut off; write or copy it again.")
    points, left_over = divmod(len(numbers), 3)
    # Opening brackets: one of the list, one of each frame and one of each point.
    frames = brackets[0] - 1 - points
    if left_over or frames < 1 or points % frames:
        raise ValueError(
            f"{len(numbers)} numbers in {brackets[0]} lists are no frames of equally many points."
        )
    return numbers.reshape(frames, points // frames, 3)


def _numbers(text: bytes, stream: _Dense) -> tuple[NDArray[np.float32], tuple[int, int]]:
    """Parse all numbers up to the end in single precision; count opening and closing brackets."""
    # Scanning drops the white space.
    chunks = itertools.chain([text], iter(lambda: stream.read_as_it_is(CHUNK), b""))
    return scan_numbers(chunks, _to_numbers, MAX_NUMBERS, LONGEST)


def _to_numbers(text: bytes) -> NDArray[np.float64]:
    # Frames without points leave commas without numbers.
    if not text.strip(b","):
        return np.empty(0)
    try:
        return to_numbers(text)
    except ValueError as error:
        _refuse_words(text)
        raise ValueError("something in it is not a number, or a comma stands alone.") from error
