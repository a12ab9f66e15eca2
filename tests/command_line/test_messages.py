import logging

import pytest

from hand_recon.command_line.messages import PlainFormatter


@pytest.mark.parametrize(
    ("level", "expected"),
    [
        (logging.DEBUG, "note: a.json: 3 hands"),
        (logging.INFO, "note: a.json: 3 hands"),
        (logging.WARNING, "warning: a.json: 3 hands"),
        (logging.ERROR, "error: a.json: 3 hands"),
        (logging.CRITICAL, "error: a.json: 3 hands"),
    ],
)
def test_a_message_begins_with_its_kind(level: int, expected: str) -> None:
    record = logging.LogRecord("any", level, "file.py", 1, "%s: %d hands", ("a.json", 3), None)
    assert PlainFormatter().format(record) == expected
