"""Text, JSON and YAML from elsewhere, within limits."""

import io
import itertools
import json
import re
import stat
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Final

import yaml

from hand_recon.reading.limits import LIMITS, too_large
from hand_recon.reading.naming import naming
from hand_recon.reading.yaml_loaders import FastLoader, SafeLoader

LONGEST_NUMBER: Final = 308
"""Digits of a whole number; no double has more."""

_LONG_NUMBER: Final = re.compile(rf"(?<![\d.eE+-])-?\d{{{LONGEST_NUMBER + 1}}}")
_FLAT: Final = 2000
"""Levels that libyaml can parse: it recurses in C, and 100,000 levels end the process."""


def read_bytes(path: Path) -> bytes:
    """Read a file as a whole.

    Raises:
        OSError: It cannot be opened.
        ValueError: It is larger than `text_bytes` of `LIMITS`, or is a pipe or a device, whose size nothing
            tells.
    """
    found = path.stat()
    if not stat.S_ISREG(found.st_mode) and not stat.S_ISDIR(found.st_mode):
        raise ValueError(
            f"{path} is a pipe or a device; expected an ordinary file. Save its content in a file and give "
            "that."
        )
    if found.st_size > LIMITS.text_bytes:
        raise ValueError(too_large(path, found.st_size, "text_bytes", "bytes"))
    return path.read_bytes()


def read_text(path: Path, encoding: str = "utf-8-sig") -> str:
    """Read a file of text.

    Raises:
        OSError: It cannot be opened.
        ValueError: It is not text, no ordinary file, or larger than `text_bytes` of `LIMITS`.
    """
    content = read_bytes(path)
    with naming(path, "text in UTF-8"):
        # Ends of lines as Python's text files have them.
        return io.TextIOWrapper(io.BytesIO(content), encoding=encoding).read()


def parse_json(text: str, path: object, constant: Callable[[str], object] | None = None) -> Any:  # noqa: ANN401  # any JSON
    """Value of a JSON text.

    Args:
        text: The text.
        path: Its file, for messages.
        constant: Function that is called for NaN and infinities; they are numbers without it.

    Raises:
        ValueError: It is no JSON, nested too deeply, or has a whole number that no double can hold.
    """
    if _LONG_NUMBER.search(text):
        raise ValueError(
            f"{path} has a whole number of more than {LONGEST_NUMBER} digits; expected numbers that a double "
            "can hold. Write the file again."
        )
    with naming(path, "complete JSON"):
        return json.loads(text, parse_constant=constant)


def parse_yaml(text: str, path: object) -> Any:  # noqa: ANN401  # any YAML
    """Value of a YAML text: plain data only, each key once.

    Args:
        text: The text.
        path: Its file, for messages.

    Raises:
        ValueError: It is no YAML, has a key twice, or references or merge keys that make it larger than
            `yaml_values` of `LIMITS` or endless.
    """
    with naming(path, "complete YAML"):
        _refuse_brackets(text)
        content = yaml.load(text, Loader=partial(_loader(text), path=path))  # noqa: S506  # safe ones both
        values = _values(content, {})
    if values > LIMITS.yaml_values:
        raise ValueError(too_large(path, values, "yaml_values", "values, references included"))
    return content


def _refuse_brackets(text: str) -> None:
    """Refuse brackets within brackets beyond what PyYAML would find out slowly.

    Raises:
        RecursionError: There are more than `_FLAT` levels.
    """
    if text.count("[") + text.count("{") > _FLAT:
        steps = (1 if one in "[{" else -1 for one in re.findall(r"[\[\]{}]", text))
        if max(itertools.accumulate(steps)) > _FLAT:
            raise RecursionError


def _loader(text: str) -> Any:  # noqa: ANN401  # PyYAML has no types
    """The fast loader for text that cannot be nested deeply, else the one that raises RecursionError."""
    # Every level takes a bracket, or a column of its line.
    levels = text.count("[") + text.count("{") + max(map(len, text.splitlines()), default=0)
    return FastLoader if levels < _FLAT else SafeLoader


def _values(value: object, known: dict[int, int]) -> int:
    """Number of values in a value, each counted as often as it is referred to.

    Raises:
        ValueError: A value holds itself.
    """
    if not isinstance(value, dict | list | tuple | set):
        return 1
    if id(value) not in known:
        # Marks what is being counted.
        known[id(value)] = 0
        inside = [*value, *value.values()] if isinstance(value, dict) else list(value)
        known[id(value)] = 1 + sum(_values(one, known) for one in inside)
    elif known[id(value)] == 0:
        raise ValueError("a value in it holds itself")
    return known[id(value)]
