"""Errors that name the file: whatever a damaged file raises in a parser becomes a ValueError about it."""

import csv
import lzma
import pickle
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

import yaml

DAMAGE: Final = (
    RecursionError, MemoryError, OverflowError, EOFError, NotImplementedError, csv.Error, yaml.YAMLError,
    struct.error, zipfile.BadZipFile, zipfile.LargeZipFile, zlib.error, lzma.LZMAError,
    pickle.UnpicklingError, tokenize.TokenError, SyntaxError,
)  # fmt: skip
"""Errors of parsers and of libraries on damaged or hostile files that are no ValueError."""

OTHER_FORM: Final = (
    ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError,
)  # fmt: skip
"""Errors of code that takes what JSON holds apart, where it holds something else."""

_REASONS: Final = (
    (RecursionError, "it is nested too deeply"),
    (MemoryError, "there is not enough memory for what it announces"),
    (OverflowError, "a number in it is too large"),
    (EOFError, "it ends too early"),
)
_LONGEST: Final = 300
"""Characters of another library's message that are quoted."""


@contextmanager
def naming(path: object, expected: str) -> Iterator[None]:
    """Turn the errors of a damaged file into a ValueError that names it.

    A ValueError that names the file passes unchanged, and so does everything else that is no sign of a
    damaged file.

    Args:
        path: The file, as messages name it.
        expected: Noun phrase for the message, such as `a table of ranges of motion`: the file is not that.

    Raises:
        ValueError: The block raised one of `DAMAGE`, or a ValueError without the file's name.
    """
    try:
        yield
    except DAMAGE as error:
        raise ValueError(_message(path, expected, error)) from error
    except (ValueError, OSError) as error:
        # Errors of opening a file name it; an OSError without a file is a place that an archive points to.
        if str(path) in str(error) or getattr(error, "filename", None) is not None:
            raise
        raise ValueError(_message(path, expected, error)) from error


def _message(path: object, expected: str, error: Exception) -> str:
    found = next((text for kind, text in _REASONS if isinstance(error, kind)), str(error))
    reason = (found or type(error).__name__)[:_LONGEST].rstrip(".")
    return f"{path} is not {expected} ({reason}). Copy it again, or write it anew."
