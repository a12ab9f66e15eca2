"""Points that a person has labelled one by one, collected into hands by their names."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from hand_recon.data.landmarks.formats.found import FoundHand, Reading
from hand_recon.data.landmarks.formats.names import NamedLandmark, landmarks_of_names

OTHER_LABELS: Final = "points of other labels"


@dataclass(frozen=True)
class LabelledPoint:
    """One point of an image."""

    label: str
    """Name of the landmark."""
    point: tuple[float, float]
    """Pixels of the image."""
    hand: str = ""
    """Name of the hand among those of its image; empty without one."""
    side: str | None = None
    """Side, where something else than the label tells it."""
    occluded: bool = False
    """True if it cannot be seen."""


@dataclass(frozen=True)
class LabelledImage:
    """The points of one image."""

    points: Sequence[LabelledPoint]
    """Points in the file's order."""
    name: str
    """Name for the hands, such as the image's file name."""
    image: str | None = None
    """Image as written in the file."""
    image_size: tuple[float, float] | None = None
    """Width and height as the file states them."""


def add_labelled(reading: Reading, images: Sequence[LabelledImage], cure: str) -> None:
    """Add the hands of labelled images, one for each `hand` and side among an image's points.

    Args:
        reading: The file.
        images: All of its images, because their labels are understood together.
        cure: How to tell two hands of one image apart with this tool.

    Raises:
        ValueError: No label names a landmark, or one image has two points of a landmark of one hand.
    """
    labels = [point.label for image in images for point in image.points]
    known = landmarks_of_names(dict.fromkeys(labels))
    if labels and not known:
        raise ValueError(
            f"{reading.path} is read as {reading.title}, and none of its labels names a landmark of a hand: "
            f"{sorted(set(labels))[:25]}. Name them like `wrist`, `thumb CMC`, `index MCP`, `index tip`, "
            "with `left` or `right` before it if the side is to be read, or by their numbers from 0 to 20."
        )
    reading.named = True
    for image in images:
        _add_image(reading, image, known, cure)


def _add_image(
    reading: Reading, image: LabelledImage, known: Mapping[str, NamedLandmark], cure: str
) -> None:
    groups: dict[tuple[str, str | None], dict[int, LabelledPoint]] = defaultdict(dict)
    for point in image.points:
        if point.label not in known:
            reading.left_out[OTHER_LABELS] += 1
            continue
        named = known[point.label]
        hand = groups[point.hand, named.side or point.side]
        if named.landmark in hand:
            raise ValueError(
                f"{reading.path} is read as {reading.title}, and {image.name} has two points "
                f"{point.label!r} of one hand. {cure}"
            )
        hand[named.landmark] = point
    for (called, side), points in groups.items():
        kept = " ".join(word for word in (called, side) if word) if len(groups) > 1 else ""
        name = f"{image.name} {kept}".strip()
        reading.add(_hand(points, side, name, image))


def _hand(
    labelled: Mapping[int, LabelledPoint], side: str | None, name: str, image: LabelledImage
) -> FoundHand:
    points, occluded = np.full((21, 2), np.nan), np.zeros(21, dtype=bool)
    for landmark, point in labelled.items():
        points[landmark], occluded[landmark] = point.point, point.occluded
    return FoundHand(
        points, side, name, image.image, occluded=occluded, image_size=image.image_size
    )
