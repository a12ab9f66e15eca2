"""Writing of `hands.json`, a JSON list with one object to a line, part by part."""

import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TextIO

from hand_recon.fitting.hands_lines import line_of


@contextmanager
def writing_entries(
    path: Path, done: Iterable[dict[str, Any]] | None = None
) -> Iterator[Callable[[Iterable[dict[str, Any]]], None]]:
    """Write a file of hands part by part; the file gets its name when the list is complete.

    After an error, the parts written before it are kept as valid JSON under the file's name with `.part`;
    after a kill, `finished_entries` reads the hands whose lines are whole.

    Args:
        path: The file.
        done: Objects of hands of an interrupted run, which the list begins with.

    Raises:
        FileExistsError: An unfinished file of this name exists.
        ValueError: A number that must be finite is not.
    """
    unfinished = path.with_name(f"{path.name}.part")
    # What an interrupted run wrote is replaced only by a file that holds all of it.
    beginning = unfinished if done is None else path.with_name(f"{path.name}.part.new")
    with (
        beginning.open("x" if done is None else "w", encoding="utf-8") as stream,
        writing_list(stream) as write,
    ):
        if done is not None:
            write(done)
            os.fsync(stream.fileno())
            os.replace(beginning, unfinished)
        yield write
    unfinished.rename(path)


@contextmanager
def writing_list(stream: TextIO) -> Iterator[Callable[[Iterable[dict[str, Any]]], None]]:
    """Write objects as a JSON list, one to a line; the list is complete after an error, too.

    Args:
        stream: Text to write to; flushed with every call of the function that is yielded.

    Raises:
        ValueError: A number that must be finite is not.
    """
    separator = "[\n"

    def write(entries: Iterable[dict[str, Any]]) -> None:
        nonlocal separator
        for entry in entries:
            stream.write(separator + line_of(entry))
            separator = ",\n"
        stream.flush()

    try:
        yield write
    finally:
        stream.write("\n]\n" if separator.startswith(",") else "[]\n")
