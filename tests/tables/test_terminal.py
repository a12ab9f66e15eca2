"""Tables on a terminal: they fit its width and keep every column."""

import pytest

from hand_recon.tables.terminal import narrowed
from hand_recon.tables.text_tables import TextTable

TABLE = TextTable(
    "t", ("row", "a", "bb", "ccc"), (("one", "1.00", "2.00", "3.00"), ("two", "4", "5", "6"))
)


@pytest.mark.parametrize("width", [1, 16, 22, 23, 200])
def test_every_column_is_kept_beside_the_rows_names(width: int) -> None:
    parts = narrowed(TABLE, width)
    assert all(part.columns[0] == "row" for part in parts)
    assert [column for part in parts for column in part.columns[1:]] == ["a", "bb", "ccc"]
    assert [[row[0] for row in part.rows] for part in parts] == [["one", "two"]] * len(parts)


def test_a_table_is_split_only_where_it_must_be() -> None:
    """Widths with margins: 6 + 7 + 7 + 7 and a last line, 28 characters for all and 21 for two columns."""
    assert len(narrowed(TABLE, 28)) == 1
    assert [len(part.columns) for part in narrowed(TABLE, 27)] == [3, 2]
    assert [len(part.columns) for part in narrowed(TABLE, 20)] == [2, 2, 2]
