"""The binary files of the library pose-format (`.pose`), versions 0.1 and 0.2.

Layout by the specifications of the library (docs/specs/v0.1.md and v0.2.md), little-endian: version (float),
width, height, depth and number of components (uint16 each); for every component its name and its format
(strings: uint16 length, UTF-8), its numbers of points, limbs and colours (uint16), the names of its points,
two uint16 per limb and three per colour. Then fps, frames and people (uint16 each; in 0.2 float, uint32,
uint16); coordinates (frame × person × point × dimension, float32) and confidences (frame × person × point).

Hands are the components with `HAND` and a side in their names, such as MediaPipe's `LEFT_HAND_LANDMARKS`.
"""

import math
import struct
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from hand_recon.data.landmarks.formats.found import FoundHand, Reading
from hand_recon.data.landmarks.formats.names import side_in
from hand_recon.data.landmarks.formats.whole_body import layout_of, pick
from hand_recon.data.landmarks.parsed import ParsedHands

TITLE: Final = "a .pose file"

VERSIONS: Final = {struct.pack("<f", 0.1): 0.1, struct.pack("<f", 0.2): 0.2}
"""First bytes of a file → its version."""


@dataclass(frozen=True)
class _Component:
    """Points of a body part."""

    name: str
    dimensions: int
    points: list[str]


class _Bytes:
    """Values of a binary file, one after the other."""

    def __init__(self, path: Path, content: bytes) -> None:
        self.path = path
        self.content = content
        self.position = 0

    def read(self, form: str) -> tuple[float, ...]:
        """Values of a `struct` format without its byte order.

        Raises:
            ValueError: The file ends before.
        """
        size = struct.calcsize(f"<{form}")
        return struct.unpack(f"<{form}", self.bytes(size))

    def count(self) -> int:
        return int(self.read("H")[0])

    def string(self) -> str:
        return self.bytes(self.count()).decode("utf-8", errors="replace")

    def floats(self, *shape: int) -> Float[np.ndarray, "..."]:
        numbers = np.frombuffer(self.bytes(4 * math.prod(shape)), dtype="<f4")
        return numbers.reshape(shape).astype(np.float64)

    def bytes(self, size: int) -> bytes:
        taken = self.content[self.position : self.position + size]
        if len(taken) < size:
            raise ValueError(
                f"{self.path} is cut off: {size} bytes are announced at byte {self.position} of "
                f"{len(self.content)}. Write or copy it again."
            )
        self.position += size
        return taken


def is_pose_file(content: bytes) -> bool:
    """True for the first bytes of a `.pose` file of a known version."""
    return content[:4] in VERSIONS


def parse_pose_file(path: Path, content: bytes) -> ParsedHands:
    """The hands of all frames and people.

    Raises:
        ValueError: The file is cut off, or has no components of hands.
    """
    reading = Reading(path, TITLE)
    source = _Bytes(path, content)
    version = VERSIONS[source.bytes(4)]
    width, height, _ = source.read("HHH")
    components = [_component(source) for _ in range(source.count())]
    points, confidence = _body(source, version, components)
    size = (width, height) if width > 1 and height > 1 else None
    hands = [
        (side, _at(points, places), _at(confidence, places)) for side, places in _places(components)
    ]
    for frame, person in np.ndindex(points.shape[:2]):
        called = f"frame {frame} " + (f"person {person} " if points.shape[1] > 1 else "")
        for side, of_hand, scores in hands:
            found = _hand(of_hand[frame, person], scores[frame, person])
            reading.add(replace(found, side=side, name=called + side, image_size=size))
    if not hands:
        raise ValueError(
            f"{path} is read as {TITLE}, and none of its components is a hand: "
            f"{[component.name for component in components][:10]}. Expected names such as "
            "LEFT_HAND_LANDMARKS, with 21 points."
        )
    return reading.parsed()


def _component(source: _Bytes) -> _Component:
    name, form = source.string(), source.string()
    points, limbs, colours = (int(count) for count in source.read("HHH"))
    names = [source.string() for _ in range(points)]
    source.bytes(4 * limbs + 6 * colours)
    return _Component(name, max(0, len(form) - 1), names)


def _body(
    source: _Bytes, version: float, components: list[_Component]
) -> tuple[Float[np.ndarray, "frame person point 2"], Float[np.ndarray, "frame person point"]]:
    """Coordinates u and v and confidences of all points."""
    _, frames, people = source.read("HHH" if version == 0.1 else "fIH")
    points = sum(len(component.points) for component in components)
    dimensions = max((component.dimensions for component in components), default=0)
    if dimensions < 2 or not people:
        raise ValueError(
            f"{source.path} is read as {TITLE} and holds {int(people)} people of {points} points in "
            f"{dimensions} dimensions; expected 1 or more, in 2 or 3."
        )
    if version == 0.1:
        # More frames than the header's 16 bits can count are told by the size of the file.
        left = len(source.content) - source.position
        frames = left // max(1, 4 * int(people) * points * (dimensions + 1))
    shape = int(frames), int(people), points
    coordinates = source.floats(*shape, dimensions)
    return coordinates[..., :2].copy(), source.floats(*shape)


def _places(components: list[_Component]) -> list[tuple[str, Int[np.ndarray, " landmark=21"]]]:
    """Sides of the components that are hands, and the columns of their landmarks; −1 for a missing one."""
    hands = []
    start = 0
    for component in components:
        side = side_in(component.name)
        layout = layout_of(len(component.points), component.points)
        if side and "hand" in component.name.lower() and layout and len(layout.hands) == 1:
            (places,) = layout.hands.values()
            hands.append((side, np.where(places < 0, -1, places + start)))
        start += len(component.points)
    return hands


def _at(
    values: Float[np.ndarray, "..."], places: Int[np.ndarray, " landmark=21"]
) -> Float[np.ndarray, "..."]:
    return np.moveaxis(pick(np.moveaxis(values, 2, 0), places), 0, 2)


def _hand(
    points: Float[np.ndarray, "landmark=21 2"], score: Float[np.ndarray, " landmark=21"]
) -> FoundHand:
    """A hand without the landmarks that were not found."""
    points = np.where(score[:, None] > 0, points, np.nan)
    # MediaPipe has no confidence of a hand's landmark: all found ones have 1.
    are_scores = not np.isin(score[~np.isnan(score)], (0, 1)).all()
    return FoundHand(points, confidence=score if are_scores else None)
