"""LabelMe's file of one image: `shapes` of points with labels, hands told apart by `group_id`.

A point's label names its landmark. Shapes that are no points are left out. A polygon or a line strip of 21
points is a hand in FreiHAND's order.
"""

from pathlib import Path
from typing import Any, Final

import numpy as np

from hand_recon.data.landmarks.formats.found import (
    FoundHand,
    Reading,
    all_documents,
    documents,
    size_of,
    text_of,
)
from hand_recon.data.landmarks.formats.labels import LabelledImage, LabelledPoint, add_labelled
from hand_recon.data.landmarks.formats.names import side_in
from hand_recon.data.landmarks.parsed import ParsedHands

TITLE: Final = "LabelMe's shapes"

_CURE: Final = (
    "Give the points of each hand a group id of their own, or `left` and `right` in their labels."
)


def is_labelme(content: object) -> bool:
    """True for LabelMe's file of an image, or several of them in a list."""
    return all_documents(content, lambda document: isinstance(document.get("shapes"), list))


def parse_labelme(path: Path, content: Any) -> ParsedHands:  # noqa: ANN401  # any JSON
    """The hands of all images.

    Raises:
        ValueError: There are none, labels name no landmarks, or something else is in their place.
    """
    reading = Reading(path, TITLE)
    images = []
    for document in documents(content):
        # LabelMe of Windows writes backslashes.
        image = text_of(document.get("imagePath"))
        image = image and image.replace("\\", "/")
        about = LabelledImage([], image or path.stem, image, size_of(document))
        points = []
        for number, shape in enumerate(reading.objects(document["shapes"], "`shapes`")):
            points += _labelled(reading, shape, f"shape {number}", about)
        images.append(LabelledImage(points, about.name, about.image, about.image_size))
    add_labelled(reading, images, _CURE)
    return reading.parsed()


def _labelled(
    reading: Reading, shape: dict[str, Any], where: str, about: LabelledImage
) -> list[LabelledPoint]:
    """The point of a shape; a shape of 21 points is added as a hand, another one is left out."""
    points = reading.entries(shape.get("points"), f"`points` of {where}")
    label = str(shape.get("label") or "")
    group = shape.get("group_id")
    if len(points) == 1:
        u, v = reading.numbers(points, f"`points` of {where}", 1, 2)[0].tolist()
        hand = "" if group is None else f"group {text_of(group)}"
        return [LabelledPoint(label, (u, v), hand, _side(shape))]
    if len(points) == 21:
        hand_points = np.asarray(reading.numbers(points, f"`points` of {where}", 21, 2))
        name = f"{about.name} {where}"
        reading.add(
            FoundHand(hand_points, side_in(label), name, about.image, image_size=about.image_size)
        )
    else:
        reading.left_out["shapes that are no points"] += 1
    return []


def _side(shape: dict[str, Any]) -> str | None:
    """Side by the shape's flags or its description."""
    flags = shape.get("flags")
    marked = [name for name, on in flags.items() if on] if isinstance(flags, dict) else []
    return side_in(" ".join([*marked, str(shape.get("description") or "")]))
