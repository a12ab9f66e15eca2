"""Hands in tables (CSV): 3D landmarks in a row per hand, or in a row per landmark."""

import csv
import math
import re
from pathlib import Path
from typing import Final

import numpy as np
import torch
from jaxtyping import Float

from hand_recon.plausibility.given_hands import GivenHands, of_points
from hand_recon.plausibility.joint_orders import COUNTS, to_landmarks
from hand_recon.reading.text import read_text

_MISSING: Final = frozenset({"", "nan", "na", "null", "none"})
_LEADING: Final = 8
_AXES: Final = "xyz"

Table = Float[np.ndarray, "row column"]


def read_table(path: Path) -> GivenHands:
    """Landmarks of a table: a row per hand with 63, 75 or 78 numbers, or a row per landmark with x, y and z.

    Columns are found by the names of the first row where it has them, such as `x_m` or `thumb_tip_z`. Without
    such names the coordinates are the last columns; those before them, such as a number, are left out.

    Args:
        path: The CSV file, with commas, semicolons or tabs between its cells.

    Raises:
        ValueError: The table has neither, or no hands.
    """
    rows = _rows(path)
    # Numbers in order are the names that a table without names gets when it is saved.
    header = rows[0] if rows and _is_header(rows[0]) else []
    body = rows[1:] if header else rows
    if not body:
        raise ValueError(
            f"{path} has no rows of numbers; expected one or more hands. Check that the quotes of its cells "
            "are closed, or write the table again."
        )
    width = len(body[0])
    for number, row in enumerate(body, start=2 if header else 1):
        if len(row) != width:
            raise ValueError(
                f"{path}, row {number} has {len(row)} cells and the first one {width}; expected as many in "
                "every row. Complete the row, with nan for what is missing."
            )
    table = np.array([[_number(cell) for cell in row] for row in body]).reshape(len(body), width)
    columns = _columns(header)
    if columns is not None and max(columns) >= width:
        raise ValueError(
            f"{path} has {width} cells in its rows and {len(header)} names of columns; expected as many. "
            "Complete the rows, with nan for what is missing."
        )
    if columns is None:
        kept = [i for i in range(width) if not _is_text([row[i] for row in body])]
        _refuse_trailing(path, kept, width)
        table = table[:, kept]
    else:
        table = table[:, columns]
    return of_points(to_landmarks(torch.from_numpy(_as_points(path, table, width))), str(path))


def _rows(path: Path) -> list[list[str]]:
    try:
        text = read_text(path)
    except ValueError as error:
        if not isinstance(error.__cause__, UnicodeDecodeError):
            raise
        # Names in another code page; numbers are the same in all of these.
        text = read_text(path, "latin-1")
    first = next((line for line in text.splitlines() if line.strip()), "")
    # Numbers may have decimal commas where semicolons or tabs are between them.
    separator = next((one for one in ";\t" if one in first), ",")
    rows = list(csv.reader(text.splitlines(), delimiter=separator))
    if separator != ",":
        rows = [[cell.replace(",", ".") for cell in row] for row in rows]
    return [row for row in rows if any(cell.strip() for cell in row)]


def _is_header(row: list[str]) -> bool:
    values = [_number(cell) for cell in row]
    finite = [value for value in values if math.isfinite(value)]
    if not finite:
        return any(_names(cell) for cell in row)
    return len(finite) >= 3 and finite == [float(i) for i in range(len(finite))]


def _names(cell: str) -> bool:
    """True for text, which is neither a number nor a word for a missing one."""
    return cell.strip().lower() not in _MISSING and not math.isfinite(_number(cell))


def _is_text(cells: list[str]) -> bool:
    return any(_names(cell) for cell in cells)


def _columns(header: list[str]) -> list[int] | None:
    """Columns of the coordinates by their names, point by point; None if the names do not tell them.

    Names are alike but for their axis, as `x_m`, `y_m` and `z_m` or `tip_x`, `tip_y` and `tip_z`. Of several
    sets of one point, such as pixels and metres, the one that has a z is taken.
    """
    places: dict[str, dict[str, int]] = {}
    for column, name in enumerate(header):
        found = re.fullmatch(r"(?:(.*[^a-z]))?([xyz])(?:([^a-z].*))?", name.strip().lower())
        if found:
            rest = f"{found[1] or ''}|{found[3] or ''}"
            places.setdefault(rest, {}).setdefault(found[2], column)
    whole = [place for place in places.values() if len(place) == len(_AXES)]
    if len(whole) not in (1, *COUNTS):
        return None
    return [place[axis] for place in whole for axis in _AXES]


def _refuse_trailing(path: Path, kept: list[int], width: int) -> None:
    """Refuse text between or behind the coordinates: the numbers before it may be another thing's."""
    if kept and len(kept) > 3 and kept[-1] != width - 1 and len(kept) not in _widths():
        raise ValueError(
            f"{path} has text behind its numbers and {len(kept)} columns of numbers; expected 63, 75 or 78. "
            "Remove the other columns, or name the coordinates x0, y0, z0 to x20, y20, z20."
        )


def _widths() -> list[int]:
    return [3 * count for count in COUNTS]


def _as_points(path: Path, table: Table, width: int) -> Float[np.ndarray, "hand point 3"]:
    numbers = table.shape[1]
    if numbers == 3 and len(table) and len(table) % 21 == 0:
        return table.reshape(-1, 21, 3)
    for count in sorted(COUNTS, reverse=True):
        if 3 * count <= numbers <= 3 * count + _LEADING:
            return np.asarray(table[:, -3 * count :].reshape(-1, count, 3))
    raise ValueError(
        f"{path} has {width} columns in {len(table)} rows; expected a row per hand with 63 numbers (21 × x, "
        "y, z), 75 or 78, or 21 rows per hand with columns x, y and z."
    )


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return math.nan
