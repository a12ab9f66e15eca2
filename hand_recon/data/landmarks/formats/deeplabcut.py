"""DeepLabCut's CSV: three header rows (scorer, bodyparts, coords), or four with individuals.

Body parts name the landmarks; each individual and each side is a hand in every row where it was found.
`likelihood` is the confidence. Rows are called by their frame's number or by their image.
"""

import csv
import io
import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from hand_recon.data.landmarks.formats.found import FoundHand, Reading
from hand_recon.data.landmarks.formats.names import NamedLandmark, landmarks_of_names, side_in
from hand_recon.data.landmarks.parsed import ParsedHands

TITLE: Final = "DeepLabCut's table"

_COORDS: Final = ("x", "y", "likelihood")


@dataclass(frozen=True)
class _Columns:
    """Columns of one hand: landmark and coordinate → column."""

    individual: str
    side: str | None
    columns: dict[tuple[int, str], int]


def is_deeplabcut(text: str) -> bool:
    """True for a table whose first cell is `scorer`."""
    return re.match(r'\s*"?scorer"?\s*[,;\t]', text, re.IGNORECASE) is not None


def parse_deeplabcut(path: Path, text: str) -> ParsedHands:
    """The hands of all rows.

    Raises:
        ValueError: Header rows are missing, no body part names a landmark, or a cell is not a number.
    """
    reading = Reading(path, TITLE)
    header, rows = _table(reading, text)
    first = _first_column(header["coords"])
    hands = _hands(reading, header, first)
    for row in rows:
        if len(row) != len(header["coords"]):
            raise reading.error(f"the row {row[0]!r:.40}", row, f"{len(header['coords'])} cells")
        called, image = _name(row[:first])
        for hand in hands:
            _add(reading, row, hand, called, image)
    reading.named = True
    return reading.parsed()


def _table(reading: Reading, text: str) -> tuple[dict[str, list[str]], list[list[str]]]:
    """Header rows by their first cell, and the other rows."""
    delimiter = max(",;\t", key=text.lstrip().partition("\n")[0].count)
    rows = [row for row in csv.reader(io.StringIO(text.lstrip()), delimiter=delimiter) if row]
    header = {row[0].strip().lower(): row for row in rows[:4]}
    names = ["scorer", "individuals", "bodyparts", "coords"]
    if "individuals" not in header:
        names.remove("individuals")
    wanted = {name: header[name] for name in names if name in header}
    if len(wanted) < len(names) or len({len(row) for row in wanted.values()}) != 1:
        raise ValueError(
            f"{reading.path} is read as {TITLE}, whose first rows begin with {names} and are equally long; "
            f"found {list(header)[:4]}. Write it again with DeepLabCut (save_as_csv=True)."
        )
    return wanted, rows[len(names) :]


def _first_column(coords: Sequence[str]) -> int:
    """First column of numbers; before it are the frame's number or the folders and name of its image."""
    return next(
        (column for column, cell in enumerate(coords) if cell.strip().lower() in _COORDS),
        len(coords),
    )


def _hands(reading: Reading, header: dict[str, list[str]], first: int) -> list[_Columns]:
    known = landmarks_of_names(dict.fromkeys(header["bodyparts"][first:]))
    if not known:
        raise ValueError(
            f"{reading.path} is read as {TITLE}, and none of its body parts names a landmark of a hand: "
            f"{sorted(set(header['bodyparts'][first:]))[:25]}. Name them like `wrist`, `thumb CMC`, "
            "`index MCP`, `index tip`."
        )
    hands: dict[tuple[str, str | None], dict[tuple[int, str], int]] = defaultdict(dict)
    for column, coordinate in enumerate(header["coords"]):
        part = known.get(header["bodyparts"][column])
        if column < first or part is None:
            continue
        individual = header["individuals"][column] if "individuals" in header else ""
        key = part.landmark, coordinate.strip().lower()
        taken = hands[individual, _side(part, individual)]
        if key in taken:
            raise ValueError(
                f"{reading.path} is read as {TITLE}, and two body parts are the same landmark: "
                f"{header['bodyparts'][column]!r} and {header['bodyparts'][taken[key]]!r}."
            )
        taken[key] = column
    return [_Columns(*key, columns) for key, columns in hands.items()]


def _side(part: NamedLandmark, individual: str) -> str | None:
    return part.side or side_in(individual)


def _name(index: Sequence[str]) -> tuple[str, str | None]:
    """Name of a row and its image: a frame's number, or folders and file name."""
    cells = [cell.strip() for cell in index if cell.strip()]
    if len(cells) == 1 and cells[0].isdigit():
        return f"frame {cells[0]}", None
    image = "/".join(cells)
    return image, image or None


def _add(
    reading: Reading, row: Sequence[str], hand: _Columns, called: str, image: str | None
) -> None:
    values = {name: np.full(21, np.nan) for name in _COORDS}
    for (landmark, coordinate), column in hand.columns.items():
        if coordinate in values:
            values[coordinate][landmark] = _number(reading, row[column], called)
    name = " ".join(word for word in (called, hand.individual, hand.side) if word)
    points: Float[np.ndarray, "landmark=21 2"] = np.stack([values["x"], values["y"]], axis=-1)
    points[np.isnan(points).any(axis=-1)] = np.nan
    reading.add(FoundHand(points, hand.side, name, image, confidence=values["likelihood"]))


def _number(reading: Reading, cell: str, called: str) -> float:
    try:
        return float(cell) if cell.strip() else np.nan
    except ValueError as error:
        raise reading.error(f"a cell of {called}", cell, "a number") from error
