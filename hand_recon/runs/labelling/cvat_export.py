"""Labels for CVAT: annotations in its XML 1.1 for images, and the task's labels to paste when it is made.

A hand is a skeleton called `hand` of 21 named points. Its side is an attribute, because CVAT does not change
the label of a skeleton. `hand_recon.data.landmarks.formats.cvat` reads CVAT's export of such a task.
"""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final
from xml.etree.ElementTree import Element, ElementTree, SubElement, indent

from hand_recon.hand.skeleton import FINGERS, LANDMARK_PARENTS, LANDMARKS
from hand_recon.runs.labelling.label_records import LabelledHand, LabelledImage

SKELETON: Final = "hand"
"""Name of the skeleton."""

ANNOTATIONS: Final = "cvat_annotations.xml"
"""File to upload as annotations in the format CVAT 1.1."""

TASK: Final = "cvat_labels.json"
"""Text for the tab Raw of the labels of a new task."""

_COLOURS: Final = ("#222222", "#d4a800", "#2e8b3d", "#2a5bd7", "#cd32a0")


def write_cvat(folder: Path, images: Sequence[LabelledImage]) -> list[Path]:
    """Write `ANNOTATIONS` and `TASK`; images without hands are left out.

    Args:
        folder: Their folder.
        images: The images, in this order.

    Returns:
        The files.
    """
    root = Element("annotations")
    SubElement(root, "version").text = "1.1"
    _add_labels(root)
    for number, image in enumerate(one for one in images if one.hands):
        _add_image(root, number, image)
    indent(root)
    annotations, task = folder / ANNOTATIONS, folder / TASK
    ElementTree(root).write(annotations, encoding="utf-8", xml_declaration=True)
    task.write_text(json.dumps(task_labels(), indent=1), encoding="utf-8")
    return [annotations, task]


def _add_labels(root: Element) -> None:
    """The labels in the words of CVAT's own exports; a point of a skeleton names it as its parent."""
    task = SubElement(SubElement(root, "meta"), "task")
    SubElement(task, "mode").text = "annotation"
    labels = SubElement(task, "labels")
    for skeleton in task_labels():
        _add_label(labels, skeleton, {"svg": skeleton["svg"]})
        for point in skeleton["sublabels"]:
            _add_label(labels, point, {"parent": skeleton["name"]})


def _add_label(labels: Element, label: Mapping[str, Any], further: Mapping[str, str]) -> None:
    inside = SubElement(labels, "label")
    SubElement(inside, "name").text = label["name"]
    SubElement(inside, "type").text = label["type"]
    attributes = SubElement(inside, "attributes")
    for given in label["attributes"]:
        attribute = SubElement(attributes, "attribute")
        values = {**given, "values": "\n".join(given["values"])}
        for key in ("name", "mutable", "input_type", "default_value", "values"):
            SubElement(attribute, key).text = str(values[key])
    for key, text in further.items():
        SubElement(inside, key).text = text


def _add_image(root: Element, number: int, image: LabelledImage) -> None:
    width, height = image.size or (0, 0)
    about = {"id": str(number), "name": image.name, "width": str(width), "height": str(height)}
    inside = SubElement(root, "image", about)
    for hand in image.hands:
        _add_hand(inside, hand)


def _add_hand(image: Element, hand: LabelledHand) -> None:
    skeleton = SubElement(image, "skeleton", {"label": SKELETON, "source": "auto", "z_order": "0"})
    for name, (u, v) in zip(LANDMARKS, hand.landmarks_2d.tolist(), strict=True):
        # A skeleton has all of its points; those that are missing are outside.
        there = math.isfinite(u)
        place = f"{u:.2f},{v:.2f}" if there else "0.00,0.00"
        point = {"label": name, "source": "auto", "outside": str(int(not there)), "occluded": "0"}
        SubElement(skeleton, "points", {**point, "points": place})
    for name, value in (("side", hand.side), ("doubt", "; ".join(hand.reasons))):
        SubElement(skeleton, "attribute", {"name": name}).text = value


def task_labels() -> list[dict[str, Any]]:
    """The labels of a task: the skeleton with its points, its drawing and its attributes."""
    return [
        {
            "name": SKELETON,
            "type": "skeleton",
            "attributes": [
                _attribute("side", "select", ["right", "left"]),
                _attribute("doubt", "text", [""]),
            ],
            "sublabels": [
                {"name": name, "type": "points", "color": _colour(landmark), "attributes": []}
                for landmark, name in enumerate(LANDMARKS)
            ],
            "svg": _drawing(),
        }
    ]


def _attribute(name: str, kind: str, values: list[str]) -> dict[str, Any]:
    return {
        "name": name, "input_type": kind, "mutable": False, "values": values, "default_value": values[0],
    }  # fmt: skip


def _colour(landmark: int) -> str:
    return _COLOURS[max(landmark - 1, 0) // 4]


def _places() -> list[tuple[float, float]]:
    """Places of the landmarks of an upright right hand, the palm to the viewer, in a square of 100."""
    places = [(50.0, 92.0)]
    for finger in range(len(FINGERS)):
        # The thumb leaves the palm lower and further to the side.
        x, y = (30.0, 78.0) if finger == 0 else (24.0 + 11.0 * finger, 52.0)
        right, up = (-6.0, 9.0) if finger == 0 else (3.0 * (finger - 2.5), 11.0)
        places += [(x + part * right, y - part * up) for part in range(4)]
    return places


def _drawing() -> str:
    """The skeleton as CVAT's editor stores it: lines between nodes that are counted from 1, and circles."""
    places = _places()
    lines = [
        f'<line x1="{places[parent][0]}" y1="{places[parent][1]}" x2="{places[child][0]}" '
        f'y2="{places[child][1]}" stroke="black" stroke-width="0.5" data-type="edge" '
        f'data-node-from="{parent + 1}" data-node-to="{child + 1}"></line>'
        for child, parent in enumerate(LANDMARK_PARENTS)
        if parent >= 0
    ]
    circles = [
        f'<circle r="1.5" cx="{x}" cy="{y}" stroke="black" stroke-width="0.1" fill="{_colour(landmark)}" '
        f'data-type="element node" data-element-id="{landmark + 1}" data-node-id="{landmark + 1}" '
        f'data-label-name="{LANDMARKS[landmark]}"></circle>'
        for landmark, (x, y) in enumerate(places)
    ]
    return "".join(lines + circles)
