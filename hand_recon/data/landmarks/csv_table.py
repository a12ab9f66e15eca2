"""Hands in CSV: one row per hand, or one row per landmark.

One row per hand: columns `u0, v0, …, u20, v20`, and for every landmark also `c0 …` (a third value as in
JSON), `confidence0 …` or `sigma0 …`, if wanted; or columns named after landmarks, `wrist_x, wrist_y, …`
(`hand_recon.data.landmarks.formats.named_columns`). One row per landmark: `hand, landmark, u, v`, and
`confidence` or `sigma`, if wanted; the landmark by its number or by its name in
`hand_recon.hand.skeleton.LANDMARKS`, landmarks without a row are missing. With a column `image` or `frame`,
hands are told apart in each image, so that they may be numbered from 0 in every one. Either may have `side`,
`name`, `image`, and the image's `width` and `height`. `x` and `y` may stand for `u` and `v`, and so may
`u_px` and `v_px`, as in the `landmarks.csv` of a fit. An empty cell is a missing number. Columns are
separated by commas, semicolons or tabs.
"""

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Final, TypeVar

import numpy as np
from jaxtyping import Float, Int

from hand_recon.data.landmarks.formats.named_columns import hands_of_named_columns
from hand_recon.data.landmarks.formats.names import NamedLandmark, landmarks_of_names, side_in
from hand_recon.data.landmarks.parsed import ParsedHands, read_side
from hand_recon.hand.skeleton import LANDMARKS

Rows = list[list[str]]
Value = TypeVar("Value")

_EXPECTED: Final = (
    "expected one row per hand with columns u0, v0, …, u20, v20 (and c0 …, confidence0 … or sigma0 …), or "
    "one row per landmark with columns hand, landmark, u, v (and confidence or sigma)"
)

_IMAGE_COLUMNS: Final = ("image", "frame")
"""Columns that tell the images of hands apart."""


def parse_csv(path: Path, text: str) -> ParsedHands:
    """The hands of a table with a header.

    Raises:
        ValueError: Columns are missing, or a cell is not what its column holds.
    """
    header, rows = _table(path, text)
    titles, header = list(header), _with_u_and_v(header)
    if header and not rows:
        raise ValueError(f"{path} holds no hands; {_EXPECTED}.")
    if {"hand", "landmark", "u", "v"} <= header.keys():
        return _from_landmark_rows(path, header, rows)
    if "u0" in header:
        return _from_hand_rows(path, header, rows)
    named = hands_of_named_columns(path, header, rows)
    if named is not None:
        return named
    hint = " Of a fit, give hands.json or landmarks.csv." if "residual_px" in header else ""
    raise ValueError(f"{path} has the columns {titles[:12]}; {_EXPECTED}.{hint}")


def _table(path: Path, text: str) -> tuple[dict[str, int], Rows]:
    first = text.lstrip().partition("\n")[0]
    delimiter = max(",;\t", key=first.count)
    reader = csv.reader(io.StringIO(text.lstrip()), delimiter=delimiter, skipinitialspace=True)
    try:
        lines = [(reader.line_num, row) for row in reader]
    except csv.Error as error:
        raise ValueError(f"{path}, line {reader.line_num}: {error}; {_EXPECTED}.") from error
    titles = [title.strip().lower() for title in lines[0][1]] if lines else []
    header = {title: column for column, title in enumerate(titles)}
    if len(header) < len(titles):
        raise ValueError(f"{path} has two columns of one name among {titles[:12]}; {_EXPECTED}.")
    rows = []
    for line, row in lines[1:]:
        if any(cell.strip() for cell in row):
            if len(row) != len(titles):
                raise ValueError(
                    f"{path}, line {line}: {len(row)} cells for {len(titles)} columns."
                )
            rows.append(row)
    return header, rows


def _with_u_and_v(header: dict[str, int]) -> dict[str, int]:
    """Columns with `u` and `v` in place of `x` and `y`, or of `u_px` and `v_px`, if there is no `u` yet."""
    if "u" in header or "u0" in header:
        return header
    letters = {"x": "u", "y": "v"}
    own = {"u_px": "u", "v_px": "v"}

    def renamed(title: str) -> str:
        if own.keys() <= header.keys():
            return own.get(title, title)
        letter, number = title[:1], title[1:].lstrip("_")
        is_coordinate = letter in letters and (not title[1:] or number.isdigit())
        return f"{letters[letter]}{number}" if is_coordinate else title

    return {renamed(title): column for title, column in header.items()}


def _from_hand_rows(path: Path, header: dict[str, int], rows: Rows) -> ParsedHands:
    def columns(prefix: str) -> Float[np.ndarray, "hand landmark=21"]:
        wanted = [f"{prefix}{landmark}" for landmark in range(21)]
        lacking = [title for title in wanted if title not in header]
        if lacking:
            raise ValueError(f"{path} lacks the columns {lacking}; {_EXPECTED}.")
        chosen = [header[title] for title in wanted]
        return _numbers(path, [[row[column] for column in chosen] for row in rows]).reshape(-1, 21)

    further = {name: f"{name}0" in header for name in ("c", "confidence", "sigma")}
    return ParsedHands(
        points=np.stack([columns("u"), columns("v")], axis=-1),
        third_value=columns("c") if further["c"] else None,
        confidence=columns("confidence") if further["confidence"] else None,
        sigma=columns("sigma") if further["sigma"] else None,
        sides=_sides(path, _cells(header, rows, "side")),
        names=_cells(header, rows, "name"),
        images=_cells(header, rows, "image"),
        image_sizes=_sizes(path, header, rows),
    )


def _from_landmark_rows(path: Path, header: dict[str, int], rows: Rows) -> ParsedHands:
    keys = [row[header["landmark"]].strip() for row in rows]
    landmarks, named_sides = _landmarks(path, keys)
    called = _hands_called(header, rows, named_sides)
    hands = {name: number for number, name in enumerate(dict.fromkeys(called))}
    position = np.array([hands[name] for name in called], dtype=np.int64) * 21 + landmarks
    taken, counts = np.unique(position, return_counts=True)
    if (counts > 1).any():
        hand, landmark = divmod(int(taken[counts > 1][0]), 21)
        raise ValueError(
            f"{path}: hand {list(hands)[hand]!r} has the landmark {LANDMARKS[landmark]!r} (number "
            f"{landmark}) more than once; expected one row for each. Number the hands differently, or add a "
            "column `image` or `frame` if they are numbered anew in each."
        )

    def spread(title: str) -> Float[np.ndarray, "hand landmark=21"]:
        values = np.full(len(hands) * 21, np.nan)
        values[position] = _numbers(path, [[row[header[title]]] for row in rows])[:, 0]
        return values.reshape(-1, 21)

    one_each = _each(called, rows)
    return ParsedHands(
        points=np.stack([spread("u"), spread("v")], axis=-1),
        confidence=spread("confidence") if "confidence" in header else None,
        sigma=spread("sigma") if "sigma" in header else None,
        sides=_sides(path, _cells(header, one_each, "side"))
        or [
            side or side_in(row[header["hand"]])
            for row, side in zip(one_each, _each(called, named_sides), strict=True)
        ],
        names=_cells(header, one_each, "name") or list(hands),
        images=_cells(header, one_each, "image"),
        image_sizes=_sizes(path, header, one_each),
        title=None
        if called == [row[header["hand"]].strip() for row in rows]
        else "a table of landmarks whose hands are numbered anew in each image",
    )


def _each(called: Sequence[str], values: Sequence[Value]) -> list[Value]:
    """The first value of each hand, in the order in which the hands occur."""
    first = dict(zip(reversed(called), reversed(values), strict=True))
    return [first[name] for name in dict.fromkeys(called)]


def _hands_called(header: dict[str, int], rows: Rows, sides: Sequence[str | None]) -> list[str]:
    """Name of the hand of each row; with its image or frame where one number occurs in several.

    The sides that names of landmarks tell, as in `left_thumb1`, are different hands, too.
    """
    hands = [
        " ".join(word for word in (row[header["hand"]].strip(), side) if word)
        for row, side in zip(rows, sides, strict=True)
    ]
    column = next((header[title] for title in _IMAGE_COLUMNS if title in header), None)
    if column is None:
        return hands
    images = [row[column].strip() for row in rows]
    pairs = list(zip(images, hands, strict=True))
    if len(set(pairs)) == len(set(hands)):
        return hands
    return [f"{image} {hand}".strip() for image, hand in pairs]


def _numbers(path: Path, cells: Rows) -> Float[np.ndarray, "row column"]:
    try:
        values = [[float(cell) if cell.strip() else np.nan for cell in row] for row in cells]
    except ValueError as error:
        raise ValueError(
            f"{path}: a cell is not a number ({error}); leave missing ones empty."
        ) from error
    return np.array(values, dtype=np.float64).reshape(len(cells), -1)


def _landmarks(path: Path, keys: Sequence[str]) -> tuple[Int[np.ndarray, " row"], list[str | None]]:
    """Numbers of landmarks given by number or by name, and the sides that the names tell."""
    known = {str(number): NamedLandmark(number) for number in range(21)}
    known |= landmarks_of_names(key for key in dict.fromkeys(keys) if not key.isdigit())
    for key in keys:
        if key not in known:
            raise ValueError(
                f"{path}: unknown landmark {key!r}; expected 0 to 20 or one of {list(LANDMARKS)}."
            )
    found = [known[key] for key in keys]
    return np.array([one.landmark for one in found], dtype=np.int64), [one.side for one in found]


def _sizes(path: Path, header: dict[str, int], rows: Rows) -> Float[np.ndarray, "hand 2"] | None:
    if not {"width", "height"} <= header.keys():
        return None
    cells = [[row[header[title]] for title in ("width", "height")] for row in rows]
    return _numbers(path, cells)


def _cells(header: dict[str, int], rows: Rows, title: str) -> list[str | None]:
    if title not in header:
        return []
    return [row[header[title]].strip() or None for row in rows]


def _sides(path: Path, cells: Sequence[str | None]) -> list[str | None]:
    return [read_side(f"{path}: hand {hand}", cell) for hand, cell in enumerate(cells)]
