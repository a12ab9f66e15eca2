import logging

import pytest

from hand_recon.command_line.messages import MOST_OF_A_KIND, FewOfAKind, PlainFormatter


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


def test_a_kind_of_message_is_shown_a_few_times_and_errors_always() -> None:
    few = FewOfAKind()

    def record(level: int, line: int, number: int) -> logging.LogRecord:
        return logging.LogRecord("any", level, "file.py", line, "hand %d", (number,), None)

    notes = [record(logging.INFO, 1, number) for number in range(MOST_OF_A_KIND + 3)]
    shown = [note.getMessage() for note in notes if few.filter(note)]
    assert len(shown) == MOST_OF_A_KIND
    assert shown[0] == "hand 0"
    assert shown[-1] == f"hand {MOST_OF_A_KIND - 1} (Further messages of this kind are not shown.)"
    assert few.filter(record(logging.WARNING, 2, 0))
    assert all(few.filter(record(logging.ERROR, 1, number)) for number in range(20))
