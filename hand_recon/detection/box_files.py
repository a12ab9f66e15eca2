"""Boxes of hands that a user gives, from a JSON, COCO or CSV file.

- JSON: `{"a.jpg": [[left, top, right, bottom], …]}`, or a list of `{"image": "a.jpg", "box": [left, top,
  right, bottom], "side": "left"}`, where the side may be left out.
- COCO: `images` and `annotations`, whose `bbox` is left, top, width, height. A side is taken from an
  annotation's `side`, or from a category whose name has `left` or `right` in it.
- CSV: a line of names, `image,left,top,right,bottom` and perhaps `side`, then a line for each box.

All are in pixels of the image.
"""

import csv
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Final

from hand_recon.detection.detector import Side
from hand_recon.reading.naming import naming
from hand_recon.reading.text import parse_json, read_text

COLUMNS: Final = ("left", "top", "right", "bottom")

SIDES: Final[Mapping[str, Side]] = {"left": "left", "right": "right"}


@dataclass(frozen=True)
class GivenBox:
    """One box of a hand."""

    left: float
    """Left edge, pixels."""
    top: float
    """Upper edge, pixels."""
    right: float
    """Right edge, pixels."""
    bottom: float
    """Lower edge, pixels."""
    side: Side | None = None
    """Side of the hand, if it is known."""


class BoxFile:
    """Boxes by image."""

    def __init__(self, path: str | Path) -> None:
        """Read the file.

        Raises:
            FileNotFoundError: There is no such file.
            ValueError: It is in none of the forms, or a box is none.
        """
        self.path = Path(path).expanduser()
        if not self.path.is_file():
            raise FileNotFoundError(
                f"No file of boxes at {self.path}. Name a JSON, COCO or CSV file with boxes=<file>."
            )
        self.boxes: dict[PurePosixPath, list[GivenBox]] = {}
        with naming(self.path, "boxes of hands as JSON, COCO or CSV"):
            for image, box in self._rows():
                self.boxes.setdefault(_as_path(image), []).append(box)

    def of(self, image: Path) -> list[GivenBox] | None:
        """The boxes of an image; none if the file does not name it.

        An image is the one that is named if either path ends with the other; the longest such name counts.

        Raises:
            ValueError: Several names fit equally well.
        """
        name = named_image(self.path, list(self.boxes), image)
        return None if name is None else self.boxes[name]

    def _rows(self) -> Iterator[tuple[str, GivenBox]]:
        if self.path.suffix.lower() == ".csv":
            yield from self._csv_rows()
            return
        try:
            content = parse_json(read_text(self.path), self.path)
        except ValueError as error:
            raise ValueError(
                f"{self.path} is no JSON ({error.__cause__ or error}). A table must be named .csv."
            ) from error
        if isinstance(content, dict) and {"images", "annotations"} <= content.keys():
            yield from self._coco_rows(content)
        elif isinstance(content, dict):
            yield from self._dictionary_rows(content)
        elif isinstance(content, list):
            yield from self._list_rows(content)
        else:
            raise ValueError(self._expected(f"found a single {type(content).__name__}"))

    def _csv_rows(self) -> Iterator[tuple[str, GivenBox]]:
        with self.path.open(newline="", encoding="utf-8-sig") as file:
            table = csv.DictReader(file)
            names = {name.strip().lower() for name in table.fieldnames or ()}
            if not {"image", *COLUMNS} <= names:
                raise ValueError(
                    f"{self.path}: expected the columns image, {', '.join(COLUMNS)} and perhaps side, "
                    f"found {', '.join(table.fieldnames or ()) or 'none'}."
                )
            for number, row in enumerate(table, 2):
                cells = {str(name).strip().lower(): value for name, value in row.items()}
                place = f"line {number}"
                corners = [cells[name] for name in COLUMNS]
                yield cells["image"] or "", self._box(corners, cells.get("side") or None, place)

    def _dictionary_rows(self, content: dict[str, Any]) -> Iterator[tuple[str, GivenBox]]:
        for image, boxes in content.items():
            if not isinstance(boxes, list):
                raise ValueError(self._expected(f"found {boxes!r} for {image}"))
            self.boxes.setdefault(_as_path(image), [])
            single = len(boxes) == 4 and not any(isinstance(one, list) for one in boxes)
            for box in [boxes] if single else boxes:
                yield image, self._box(box, None, image)

    def _list_rows(self, content: list[Any]) -> Iterator[tuple[str, GivenBox]]:
        for number, row in enumerate(content):
            place = f"entry {number}"
            if not isinstance(row, dict) or not {"image", "box"} <= row.keys():
                raise ValueError(self._expected(f"found {row!r} as {place}"))
            yield str(row["image"]), self._box(row["box"], row.get("side"), place)

    def _coco_rows(self, content: dict[str, Any]) -> Iterator[tuple[str, GivenBox]]:
        try:
            names = {row["id"]: str(row["file_name"]) for row in content["images"]}
            categories = {row["id"]: str(row["name"]) for row in content.get("categories", ())}
            rows = [
                (names[row["image_id"]], row["bbox"], row.get("side"), row.get("category_id"))
                for row in content["annotations"]
            ]
        except (KeyError, TypeError, AttributeError) as error:
            raise ValueError(
                f"{self.path}: a COCO file whose images need id and file_name, and whose annotations need "
                f"image_id and bbox; reading it failed at {error}."
            ) from error
        for name in names.values():
            self.boxes.setdefault(_as_path(name), [])
        for image, box, side, category in rows:
            left, top, width, height = self._numbers(box, image)
            corners = [left, top, left + width, top + height]
            yield image, self._box(corners, side or _side_in(categories.get(category, "")), image)

    def _box(self, corners: object, side: object, place: str) -> GivenBox:
        left, top, right, bottom = self._numbers(corners, place)
        if right <= left or bottom <= top:
            raise ValueError(
                f"{self.path}, {place}: expected a box as left, top, right, bottom with right > left and "
                f"bottom > top, found {corners}. Is it left, top, width, height?"
            )
        if side is not None and str(side).strip().lower() not in SIDES:
            raise ValueError(
                f"{self.path}, {place}: expected the side left or right, found {side!r}."
            )
        known = None if side is None else SIDES[str(side).strip().lower()]
        return GivenBox(left, top, right, bottom, known)

    def _numbers(self, corners: object, place: str) -> tuple[float, float, float, float]:
        try:
            a, b, c, d = (float(value) for value in corners)  # type: ignore[attr-defined]  # the user's
        except (TypeError, ValueError) as error:
            raise ValueError(
                f"{self.path}, {place}: expected four numbers, found {corners!r}."
            ) from error
        if not all(math.isfinite(value) for value in (a, b, c, d)):
            raise ValueError(f"{self.path}, {place}: expected finite numbers, found {corners!r}.")
        return a, b, c, d

    def _expected(self, found: str) -> str:
        return (
            f'{self.path}: expected {{"image": [[left, top, right, bottom], …]}}, a list of {{"image": …, '
            f'"box": […]}} or a COCO file, {found}.'
        )


def _as_path(name: str) -> PurePosixPath:
    return PurePosixPath(name.strip().replace("\\", "/"))


def named_image(file: Path, names: Sequence[PurePosixPath], image: Path) -> PurePosixPath | None:
    """The name in a file that means an image: the longest of those that are ends of its path, or the reverse.

    Args:
        file: The file, for the message.
        names: Images as the file names them.
        image: The image's path.

    Raises:
        ValueError: Several names fit equally well.
    """
    whole, given = _as_path(str(image.absolute())), _as_path(str(image))
    # Whole paths of another machine end with the path that the user gives.
    fits = {name: _fit(name, whole) or (name.is_absolute() and _fit(name, given)) for name in names}
    longest = max(fits.values(), default=0)
    best = [name for name, shared in fits.items() if shared == longest and shared]
    if len(best) > 1:
        raise ValueError(
            f"{file}: both {best[0]} and {best[1]} could be the image {image}. Name images in it with their "
            "folders."
        )
    return best[0] if best else None


def _fit(name: PurePosixPath, wanted: PurePosixPath) -> int:
    """Number of parts at the end that two paths share, if one of them is that end; otherwise zero."""
    shared = min(len(name.parts), len(wanted.parts))
    return shared if shared and name.parts[-shared:] == wanted.parts[-shared:] else 0


def _side_in(category: str) -> str | None:
    """The side in the name of a category, such as `left_hand`."""
    named = [side for side in SIDES if side in category.lower()]
    return named[0] if len(named) == 1 else None
