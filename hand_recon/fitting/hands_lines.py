"""Long files of hands, `hands.jsonl`: the objects of `hands.json`, one to a line and nothing else.

A list has to be read as a whole; lines can be read one by one, and appended to.
"""

import json
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Final, TextIO

from hand_recon.data.whole_files import replaced_when_whole
from hand_recon.reading.naming import naming
from hand_recon.reading.text import parse_json

SUFFIX: Final = ".jsonl"
"""Suffix of files of lines."""


@contextmanager
def writing_hand_lines(path: Path) -> Iterator[Callable[[Iterable[dict[str, Any]]], None]]:
    """Write objects of hands, one to a line; the file gets its name when it is complete.

    Args:
        path: The file; an existing one is replaced.

    Raises:
        ValueError: A number that must be finite is not.
    """
    with (
        replaced_when_whole(path) as unfinished,
        unfinished.open("w", encoding="utf-8") as stream,
    ):
        yield partial(write_lines, stream)


def write_lines(stream: TextIO, entries: Iterable[dict[str, Any]]) -> None:
    """Write objects of hands, one to a line.

    Args:
        stream: Text to write to.
        entries: The objects.

    Raises:
        ValueError: A number that must be finite is not.
    """
    for entry in entries:
        stream.write(line_of(entry) + "\n")


def line_of(entry: dict[str, Any]) -> str:
    """Object of a hand as one line of JSON, without its end.

    Args:
        entry: The object.

    Raises:
        ValueError: A number that must be finite is not.
    """
    # NaN is not JSON, and most readers refuse a file with it.
    return json.dumps(entry, allow_nan=False, ensure_ascii=False)


def read_lines(path: Path) -> list[Any]:
    """Read the objects of a file of lines; empty lines are passed over.

    Args:
        path: The file.

    Raises:
        ValueError: A line is not JSON.
    """
    content = []
    with naming(path, "one hand to a line"), path.open(encoding="utf-8") as stream:
        for number, line in enumerate(stream, start=1):
            if not line.strip():
                continue
            try:
                content.append(parse_json(line, path, refuse_constant))
            except ValueError as error:
                raise ValueError(
                    f"{path}, line {number}, is not JSON ({error.__cause__ or error}); expected one hand to "
                    "a line. Write the file again, or delete this line."
                ) from error
    return content


def refuse_constant(token: str) -> None:
    """Refuse NaN and infinities, which JSON does not have.

    Args:
        token: What stands in the place of a number.

    Raises:
        ValueError: Always.
    """
    raise ValueError(f"found {token}, which is not a JSON number")
