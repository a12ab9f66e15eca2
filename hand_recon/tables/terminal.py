"""Printed comparison: tables on a terminal, Markdown in a file or a pipe."""

import sys

from rich.console import Console
from rich.table import Table

from hand_recon.tables.beside import notes_beside, text_table
from hand_recon.tables.documents import Comparison, markdown
from hand_recon.tables.text_tables import TextTable, notes, text_tables


def show(comparison: Comparison, *, rich: bool | None = None) -> None:
    """Print a comparison to standard output.

    Args:
        comparison: Comparison to print.
        rich: Whether to draw tables; none to draw them if standard output is a terminal.
    """
    if not (sys.stdout.isatty() if rich is None else rich):
        sys.stdout.write(markdown(comparison))
        return
    console = Console()
    shown = [
        (heading, text_tables(summary), notes(summary))
        for heading, summary in zip(comparison.headings, comparison.summaries, strict=True)
    ]
    shown += [(one.table.title, (text_table(one),), notes_beside(one)) for one in comparison.beside]
    for heading, tables, sentences in shown:
        console.rule(f"[bold]{heading}")
        for table in tables:
            for part in narrowed(table, console.width):
                console.print(_drawn(part))
        for note in sentences:
            console.print(note, style="dim", markup=False)
    for one in comparison.left_out:
        console.print(f"Left out: {one.folder}: {one.reason}", style="yellow", markup=False)


def narrowed(table: TextTable, width: int) -> list[TextTable]:
    """Split a table into parts that each fit a width, with the first column repeated.

    Args:
        table: Table to split between columns.
        width: Width of the terminal, characters.

    Returns:
        The parts; the whole table where it fits.
    """
    columns = list(zip(table.columns, *table.rows, strict=True))
    # A cell has a space on both sides and a line on one.
    needed = [max(len(cell) for cell in column) + 3 for column in columns]
    parts: list[list[int]] = []
    for column in range(1, len(columns)):
        taken = sum(needed[other] for other in parts[-1]) if parts else width
        if taken + needed[column] + 1 > width:
            parts.append([0])
        parts[-1].append(column)
    return [
        TextTable(
            table.title,
            tuple(table.columns[column] for column in part),
            tuple(tuple(row[column] for column in part) for row in table.rows),
        )
        for part in parts
    ]


def _drawn(table: TextTable) -> Table:
    drawn = Table(title=table.title, title_justify="left", header_style="bold")
    for index, heading in enumerate(table.columns):
        drawn.add_column(heading, justify="right" if index else "left", no_wrap=index == 0)
    for row in table.rows:
        drawn.add_row(*row)
    return drawn
