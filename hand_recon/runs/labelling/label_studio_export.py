"""Labels for Label Studio: tasks with the hands as predictions, and the labelling interface.

A hand is a rectangle with 21 keypoints inside, whose labels name side and landmark. Coordinates are in
percent of the image; points outside of it are left out, because Label Studio refuses them.
`hand_recon.data.landmarks.formats.label_studio` reads Label Studio's JSON export of such tasks.
"""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote
from xml.etree.ElementTree import Element, ElementTree, SubElement, indent

import numpy as np

from hand_recon import __version__
from hand_recon.hand.skeleton import LANDMARKS
from hand_recon.runs.labelling.label_records import LabelledHand, LabelledImage

TASKS: Final = "label_studio_tasks.json"
"""File to import."""

INTERFACE: Final = "label_studio_interface.xml"
"""Text for the code of the labelling interface."""

RECTANGLE: Final = "hand"
"""Label of the rectangle around a hand."""

MARGIN: Final = 0.1
"""Margin of the rectangle around the landmarks, extents of the hand."""


def write_label_studio(folder: Path, images: Sequence[LabelledImage], root: Path) -> list[Path]:
    """Write `TASKS` and `INTERFACE`; images without hands are left out.

    Tasks name their images as Label Studio's local storage serves them if its document root is the folder in
    which the folder of the images is.

    Args:
        folder: Folder of the files.
        images: The images, in this order.
        root: Folder of the images.

    Returns:
        The files.
    """
    tasks = [_task(image, root.name) for image in images if image.hands and image.size]
    written, interface = folder / TASKS, folder / INTERFACE
    written.write_text(json.dumps(tasks, indent=1), encoding="utf-8")
    _interface().write(interface, encoding="utf-8")
    return [written, interface]


def _task(image: LabelledImage, folder: str) -> dict[str, Any]:
    scores = [hand.score for hand in image.hands if hand.score is not None]
    doubts = dict.fromkeys(name for hand in image.hands for name in hand.reasons)
    prediction = {
        "model_version": f"hand_recon {__version__}",
        **({"score": min(scores)} if scores else {}),
        "result": [
            region
            for number, hand in enumerate(image.hands)
            for region in _regions(hand, f"hand{number}", image.size or (1, 1))
        ],
    }
    return {
        "data": {
            "image": f"/data/local-files/?d={quote(f'{folder}/{image.name}')}",
            "doubt": "; ".join(doubts),
        },
        "predictions": [prediction],
    }


def _regions(hand: LabelledHand, name: str, size: tuple[int, int]) -> Iterator[dict[str, Any]]:
    """The rectangle of a hand and its keypoints."""
    percent = 100 / np.array(size, dtype=np.float64)
    common = {
        "to_name": "image", "original_width": size[0], "original_height": size[1], "image_rotation": 0,
    }  # fmt: skip
    low = (hand.box[:2] - MARGIN * hand.extent).clip(0, size)
    high = (hand.box[2:] + MARGIN * hand.extent).clip(0, size)
    (x, y), (width, height) = (low * percent).round(4), ((high - low) * percent).round(4)
    yield {
        **common, "id": name, "from_name": "hand", "type": "rectanglelabels",
        "value": {
            "x": float(x), "y": float(y), "width": float(width), "height": float(height), "rotation": 0,
            "rectanglelabels": [RECTANGLE],
        },
    }  # fmt: skip
    for landmark, (u, v) in zip(LANDMARKS, (hand.landmarks_2d * percent).tolist(), strict=True):
        if not (0 <= u <= 100 and 0 <= v <= 100):
            continue
        yield {
            **common, "id": f"{name} {landmark}", "from_name": "landmark", "type": "keypointlabels",
            "parentID": name,
            "value": {
                "x": round(u, 4), "y": round(v, 4), "width": 0.4,
                "keypointlabels": [f"{hand.side} {landmark}"],
            },
        }  # fmt: skip


def _interface() -> "ElementTree[Element]":
    """The labelling interface: an image, rectangles, and keypoints of either side."""
    view = Element("View")
    SubElement(view, "Header", {"value": "$doubt"})
    SubElement(view, "Image", {"name": "image", "value": "$image", "zoom": "true"})
    rectangles = SubElement(view, "RectangleLabels", {"name": "hand", "toName": "image"})
    SubElement(rectangles, "Label", {"value": RECTANGLE})
    points = SubElement(view, "KeyPointLabels", {"name": "landmark", "toName": "image"})
    for side, colour in (("left", "#2a5bd7"), ("right", "#cd3232")):
        for landmark in LANDMARKS:
            SubElement(points, "Label", {"value": f"{side} {landmark}", "background": colour})
    indent(view)
    return ElementTree(view)
