"""Camera of OpenCV's XML.

It is parsed by Python's own parser: OpenCV's recurses, and 100,000 levels end the process.
"""

from pathlib import Path
from xml.etree.ElementTree import Element, ParseError, fromstring

from hand_recon.data.landmarks.camera_formats import (
    DISTORTION_KEYS,
    MATRIX_KEYS,
    CameraEntry,
    entries_of,
)


def entries_of_xml(path: Path, text: str) -> list[CameraEntry]:
    """Camera of OpenCV's XML.

    Args:
        path: Its file, for messages.
        text: The text.

    Raises:
        ValueError: It is not complete, or has no camera matrix.
    """
    # OpenCV declares no entities, and those of others could be made to fill the memory.
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ValueError(
            f"{path} is XML with declarations of its own, which OpenCV does not write."
        )
    try:
        root = fromstring(text)  # noqa: S314  # without entities
    except (ParseError, ValueError) as error:
        raise ValueError(f"{path} is not complete XML of OpenCV ({error}).") from error
    found: dict[str, object] = {}
    for node in root:
        if node.tag in (*MATRIX_KEYS, *DISTORTION_KEYS) and node.find("data") is not None:
            found[node.tag] = _matrix(path, node)
        elif node.tag in ("image_width", "image_height"):
            found[node.tag] = _numbers(path, node.text)[0]
    return entries_of(path, found)


def _matrix(path: Path, node: Element) -> list[list[float]]:
    """Rows of a node of the type `opencv-matrix`."""
    numbers = _numbers(path, node.findtext("data"))
    rows, columns = (int(_numbers(path, node.findtext(key))[0]) for key in ("rows", "cols"))
    if min(rows, columns) < 1 or rows * columns != len(numbers):
        raise ValueError(
            f"{path}: <{node.tag}> has {len(numbers)} numbers and is said to be {rows} × {columns}; it is "
            "not complete XML of OpenCV."
        )
    return [numbers[row * columns : (row + 1) * columns] for row in range(rows)]


def _numbers(path: Path, text: str | None) -> list[float]:
    try:
        numbers = [float(word) for word in (text or "").split()]
    except ValueError as error:
        raise ValueError(f"{path} is not complete XML of OpenCV ({error}).") from error
    if not numbers:
        raise ValueError(f"{path} is not complete XML of OpenCV (a number is missing).")
    return numbers
