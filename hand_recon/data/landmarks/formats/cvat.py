"""CVAT's XML 1.1, for images and for video: skeletons of named points, and points shapes.

A skeleton is one hand, and so is a `points` shape of 21 points, which is in FreiHAND's order. Single points
are told apart by their `group_id`. Points marked as `outside` are missing.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import Element, ParseError, fromstring

import numpy as np
from jaxtyping import Float

from hand_recon.data.landmarks.formats.found import FoundHand, Reading
from hand_recon.data.landmarks.formats.labels import LabelledImage, LabelledPoint, add_labelled
from hand_recon.data.landmarks.formats.names import side_in
from hand_recon.data.landmarks.parsed import ParsedHands

TITLE: Final = "CVAT's XML"

_CURE: Final = "Group the points of each hand (key G in CVAT), or draw each hand as a skeleton."


def parse_cvat(path: Path, text: str) -> ParsedHands:
    """The hands of all images or frames.

    Raises:
        ValueError: It is no such XML, there are no hands, or labels name no landmarks.
    """
    reading = Reading(path, TITLE)
    root = _root(path, text)
    images = [_of_image(reading, image) for image in root.iter("image")]
    images += [
        image
        for number, track in enumerate(root.iter("track"))
        for image in _of_track(reading, track, number)
    ]
    labelled = [image for image in images if image.points]
    if labelled:
        add_labelled(reading, labelled, _CURE)
    return reading.parsed()


def _root(path: Path, text: str) -> Element:
    # CVAT declares no entities, and those of others could be made to fill the memory.
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ValueError(f"{path} is XML with declarations of its own, which CVAT does not write.")
    try:
        root = fromstring(text)  # noqa: S314
    except (ParseError, RecursionError, ValueError) as error:
        raise ValueError(f"{path} is not complete XML ({error}); export it again.") from error
    if root.tag != "annotations":
        raise ValueError(
            f"{path} is XML of <{root.tag:.40}>; expected CVAT's <annotations> (export as `CVAT for images`)."
        )
    return root


def _of_image(reading: Reading, image: Element) -> LabelledImage:
    """The labelled points of an image; shapes that are a whole hand are added at once."""
    name = image.get("name")
    size = _pair(
        reading, f"{image.get('width') or 0},{image.get('height') or 0}", "the image's size"
    )
    about = LabelledImage([], name or "image", name, size if min(size) > 0 else None)
    points: list[LabelledPoint] = []
    for number, skeleton in enumerate(image.iter("skeleton")):
        points += _of_skeleton(reading, skeleton, f"skeleton {number}")
    for shape in image.findall("points"):
        points += _of_shape(reading, shape, about)
    for kind in ("box", "polygon", "polyline", "mask", "cuboid", "ellipse"):
        reading.left_out["shapes that are no points"] += len(image.findall(kind))
    return LabelledImage(points, about.name, about.image, about.image_size)


def _of_track(reading: Reading, track: Element, number: int) -> Iterator[LabelledImage]:
    """The labelled points of each frame of a track."""
    called = f"track {track.get('id', number)}"
    label = track.get("label") or ""
    for shape in track:
        frame = f"frame {shape.get('frame', '0')}, {called}"
        if shape.get("outside") == "1":
            continue
        if shape.tag == "skeleton":
            shape.set("label", label)
            yield LabelledImage(_of_skeleton(reading, shape, ""), frame)
        elif shape.tag == "points":
            shape.set("label", label)
            yield LabelledImage(_of_shape(reading, shape, LabelledImage([], frame)), frame)


def _of_skeleton(reading: Reading, skeleton: Element, hand: str) -> list[LabelledPoint]:
    label = skeleton.get("label") or ""
    side = side_in(label) or _side_of_attributes(skeleton)
    return [
        LabelledPoint(
            point.get("label") or "",
            _pair(reading, point.get("points") or "", f"a point of {label or 'a skeleton'}"),
            hand,
            side,
            point.get("occluded") == "1",
        )
        for point in skeleton.findall("points")
        if point.get("outside") != "1"
    ]


def _of_shape(reading: Reading, shape: Element, about: LabelledImage) -> list[LabelledPoint]:
    """A single labelled point; a shape of 21 points is added as a hand."""
    label = shape.get("label") or ""
    numbers = _numbers(reading, shape.get("points") or "", f"the points of {about.name}")
    side = side_in(label) or _side_of_attributes(shape)
    if len(numbers) == 1:
        group = f"group {shape.get('group_id')}" if shape.get("group_id") else ""
        u, v = numbers[0].tolist()
        return [LabelledPoint(label, (u, v), group, side, shape.get("occluded") == "1")]
    if len(numbers) != 21:
        raise ValueError(
            f"{reading.path} is read as {TITLE}, and a points shape {label!r} of {about.name} has "
            f"{len(numbers)} points; expected 21 in FreiHAND's order, or one with a landmark's name."
        )
    reading.add(FoundHand(numbers, side, about.name, about.image, image_size=about.image_size))
    return []


def _side_of_attributes(shape: Element) -> str | None:
    """Side by an attribute that is called so; others, such as a camera's, may have the words, too."""
    told = [
        entry.text or ""
        for entry in shape.findall("attribute")
        if (entry.get("name") or "").lower() in {"side", "hand", "handedness"}
    ]
    return side_in(" ".join(told))


def _pair(reading: Reading, text: str, where: str) -> tuple[float, float]:
    numbers = _numbers(reading, text, where)
    if len(numbers) != 1:
        raise reading.error(where, text, "two numbers, `u,v`")
    u, v = numbers[0].tolist()
    return u, v


def _numbers(reading: Reading, text: str, where: str) -> Float[np.ndarray, "point 2"]:
    rows = [pair.split(",") for pair in text.split(";") if pair.strip()]
    numbers = reading.numbers(rows or [[]], where, -1, -1)
    if numbers.shape[1] != 2:
        raise reading.error(where, text, "pairs `u,v` with semicolons between them")
    return numbers
