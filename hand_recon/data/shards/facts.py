"""Facts on images that shards carry along: person, split, source and licence."""

import csv
import io
import logging
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any, Final

from hand_recon.data.landmarks.formats.content import to_json, to_text
from hand_recon.data.shards.labels import FIELDS
from hand_recon.reading.naming import naming
from hand_recon.reading.text import read_bytes, read_text

logger = logging.getLogger(__name__)

Facts = dict[str, dict[str, str]]
"""Facts by the image's path from its folder, with slashes."""

_LONGEST: Final = 1000
"""Most characters of one fact."""


def read_facts(labels: Path, table: Path | None, everywhere: Mapping[str, str | None]) -> Facts:
    """Facts of the objects of a label file, over them those of a table.

    Args:
        labels: File of landmarks; of JSON lists of objects with `image`, the keys in `FIELDS` are taken.
        table: CSV file with a column `image` and some of `FIELDS`; None without one.
        everywhere: Facts of all images that have no others; None for unknown ones. They are under the key "".

    Raises:
        ValueError: The table has no column `image`, or a fact is too long.
    """
    facts: Facts = {"": {key: value for key, value in everywhere.items() if value is not None}}
    _add(facts, _objects(labels))
    if table is not None:
        with naming(table, "a table of facts on images"):
            _add(facts, _rows(table))
    return facts


def facts_of(facts: Facts, image: str) -> dict[str, str]:
    """Facts of one image.

    Args:
        facts: Those of all images.
        image: Path of the image from its folder.
    """
    return facts[""] | facts.get(image, {})


def _rows(table: Path) -> Iterator[dict[str, str]]:
    # Line ends inside of quotes stay as they are.
    content = io.StringIO(read_text(table), newline="")
    reader = csv.DictReader(content)
    known = reader.fieldnames or []
    if "image" not in known or not set(known) & set(FIELDS):
        found = ", ".join(known)[:300]
        raise ValueError(
            f"{table} has the columns {found!r}; expected `image` and some of {list(FIELDS)}."
        )
    yield from reader


def _objects(labels: Path) -> list[Any]:
    if not labels.is_file():
        return []
    content = read_bytes(labels)
    if content.lstrip()[:1] not in (b"[", b"{"):
        return []
    found, _ = to_json(labels, to_text(labels, content))
    entries = found.get("hands", []) if isinstance(found, dict) else found
    return entries if isinstance(entries, list) else []


def _add(facts: Facts, entries: Iterable[Any]) -> None:
    for entry in entries:
        if not isinstance(entry, dict) or not isinstance(entry.get("image"), str):
            continue
        known = {key: str(entry[key]) for key in FIELDS if entry.get(key) not in (None, "")}
        longest = max(map(len, known.values()), default=0)
        if longest > _LONGEST:
            raise ValueError(
                f"A fact of {entry['image']} has {longest} characters; expected at most {_LONGEST}."
            )
        if known:
            facts.setdefault(PurePosixPath(entry["image"]).as_posix(), {}).update(known)
