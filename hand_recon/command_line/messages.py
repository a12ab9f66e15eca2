"""Messages of a command as people read them: `note: …`, `warning: …` or `error: …`, each kind a few times."""

import logging
from collections import Counter
from typing import Final

_PREFIXES: Final = (
    (logging.ERROR, "error"),
    (logging.WARNING, "warning"),
    (logging.NOTSET, "note"),
)


class PlainFormatter(logging.Formatter):
    """Formats a log record as its text after `note: `, `warning: ` or `error: `."""

    def format(self, record: logging.LogRecord) -> str:
        """The record in a line, with a traceback after it if the record has one."""
        prefix = next(name for level, name in _PREFIXES if record.levelno >= level)
        return f"{prefix}: {super().format(record)}"


MOST_OF_A_KIND: Final = 8
"""Messages of one kind that are shown."""


class FewOfAKind(logging.Filter):
    """Leaves out notes and warnings of a kind, one place in the code, after `MOST_OF_A_KIND` of them.

    A thousand photographs can each have the same thing to say. Errors are always shown.
    """

    def __init__(self) -> None:
        super().__init__()
        self.shown: Counter[tuple[str, int]] = Counter()

    def filter(self, record: logging.LogRecord) -> bool:
        """True if the record is shown; the last one of its kind says so."""
        if record.levelno >= logging.ERROR:
            return True
        kind = (record.pathname, record.lineno)
        self.shown[kind] += 1
        if self.shown[kind] == MOST_OF_A_KIND:
            record.msg = f"{record.getMessage()} (Further messages of this kind are not shown.)"
            record.args = None
        return self.shown[kind] <= MOST_OF_A_KIND
