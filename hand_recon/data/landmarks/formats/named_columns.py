"""Tables with a row per hand or frame whose columns are named after landmarks.

Columns are a landmark's name and a coordinate, `wrist_x`, `index_finger_mcp.y`, `left thumb tip u`, with
`confidence`, `score`, `likelihood` or `sigma` beside them if wanted. SLEAP's analysis CSV is of this form.
The columns of two sides make two hands of each row.
"""

import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from hand_recon.data.landmarks.formats.found import FoundHand, Reading
from hand_recon.data.landmarks.formats.names import landmarks_of_names, side_in
from hand_recon.data.landmarks.parsed import ParsedHands

TITLE: Final = "a table of named landmarks"

_COORDINATES: Final = {
    "x": "u", "u": "u", "y": "v", "v": "v", "confidence": "confidence", "score": "confidence",
    "likelihood": "confidence", "sigma": "sigma",
}  # fmt: skip
"""Last word of a column's title, and its meaning."""

_NAMES: Final = ("image", "name", "frame", "frame_idx")
"""Columns that name a row."""

_Hands = dict[str | None, dict[str, dict[int, int]]]


def hands_of_named_columns(
    path: Path, header: Mapping[str, int], rows: Sequence[Sequence[str]]
) -> ParsedHands | None:
    """The hands of a table by the names in its header, lower-case; None if these name no landmarks.

    Raises:
        ValueError: A cell is not a number, or no row has a hand.
    """
    columns = _columns(header)
    if not columns:
        return None
    reading = Reading(path, TITLE)
    reading.named = True
    sigmas = []
    for number, row in enumerate(rows):
        image, called, side = _about(header, row, number)
        for named_side, meanings in columns.items():
            values = {
                meaning: _spread(reading, row, places) for meaning, places in meanings.items()
            }
            points = np.stack([values["u"], values["v"]], axis=-1)
            name = f"{called} {named_side}" if len(columns) > 1 else called
            before = len(reading.hands)
            confidence = values.get("confidence")
            reading.add(FoundHand(points, named_side or side, name, image, confidence))
            if len(reading.hands) > before:
                sigmas.append(values.get("sigma", np.full(21, np.nan)))
    parsed = reading.parsed()
    has_sigma = any("sigma" in meanings for meanings in columns.values())
    return replace(parsed, sigma=np.stack(sigmas) if has_sigma else None)


def _columns(header: Mapping[str, int]) -> _Hands:
    """Columns of landmarks by side and meaning, of sides that have both coordinates."""
    parts: dict[str, tuple[str, str]] = {}
    for title in header:
        matched = re.fullmatch(r"(.+?)[\s._:-]*(?<![a-z])([a-z]+)", title)
        if matched and matched[2] in _COORDINATES:
            parts[title] = matched[1], _COORDINATES[matched[2]]
    known = landmarks_of_names(dict.fromkeys(name for name, _ in parts.values()))
    hands: _Hands = defaultdict(lambda: defaultdict(dict))
    for title, (name, meaning) in parts.items():
        if name in known:
            hands[known[name].side][meaning][known[name].landmark] = header[title]
    return {side: found for side, found in hands.items() if found["u"] and found["v"]}


def _about(
    header: Mapping[str, int], row: Sequence[str], number: int
) -> tuple[str | None, str, str | None]:
    """Image, name and side of a row."""
    cells = {title: row[column].strip() for title, column in header.items()}
    image = cells.get("image") or None
    named = next((cells[title] for title in _NAMES if cells.get(title)), str(number))
    words = " ".join(
        cells[title] for title in ("side", "handedness", "hand", "track") if title in cells
    )
    return image, named, side_in(words)


def _spread(reading: Reading, row: Sequence[str], places: Mapping[int, int]) -> np.ndarray:
    values = np.full(21, np.nan)
    for landmark, column in places.items():
        try:
            values[landmark] = float(row[column]) if row[column].strip() else np.nan
        except ValueError as error:
            raise reading.error(
                "a cell", row[column], "a number; leave missing ones empty"
            ) from error
    return values
