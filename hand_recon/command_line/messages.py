"""Messages of a command as people read them: `note: …`, `warning: …` or `error: …`."""

import logging
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
