"""Files of a report: Markdown, an HTML page that opens offline, CSV, and one chart per study."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Final

import jinja2

from hand_recon.tables.beside import Beside, csv_rows_beside, notes_beside, text_table
from hand_recon.tables.runs import LeftOut
from hand_recon.tables.summary import Summary
from hand_recon.tables.text_tables import TextTable, csv_rows, describe, notes, text_tables
from hand_recon.visualization.run_report import embedded

TITLE: Final = "The paper's tables beside ours"
"""Title of the documents."""

NAMES: Final = ("table1.md", "table1.html", "table1.csv")
"""Files that are always written; charts are `table1.png`, `table1_study2.png` and so on."""

CSV_2_3: Final = "tables2_3.csv"
"""File that is written where there is a run for Table 2 or 3."""


@dataclass(frozen=True)
class Comparison:
    """Contents of a report."""

    summaries: tuple[Summary, ...]
    """Summaries, one per study."""
    left_out: tuple[LeftOut, ...]
    """Runs that are in no table."""
    beside: tuple[Beside, ...] = ()
    """Tables 2 and 3, as far as there are runs for them."""

    def __post_init__(self) -> None:
        if not self.summaries:
            found = "; ".join(f"{one.folder}: {one.reason}" for one in self.left_out)
            raise ValueError(
                f"There is no finished run to report ({found or 'no run at all'}). Name finished ones with "
                "runs=<folder of a sweep>, or run `python -m hand_recon.train -m "
                "+experiment=ablation_row1,ablation_row2,…` first."
            )

    @property
    def headings(self) -> list[str]:
        """Heading of each study."""
        several = len(self.summaries) > 1
        return [
            f"Study {number}: {describe(summary.study)}" if several else describe(summary.study)
            for number, summary in enumerate(self.summaries, start=1)
        ]


def write_documents(comparison: Comparison, folder: Path) -> list[Path]:
    """Write all documents into a folder, which is created.

    Returns:
        The files, the page first.

    Raises:
        FileExistsError: The folder holds a report.
    """
    # matplotlib belongs to the extra `train`, whose absence is reported when the command begins.
    from hand_recon.tables.chart import draw_chart

    taken = [name for name in (*NAMES, CSV_2_3) if (folder / name).exists()]
    if taken:
        raise FileExistsError(
            f"{folder} already holds {taken[0]}, which is not overwritten. Leave `output` at its "
            "default, or name another folder."
        )
    folder.mkdir(parents=True, exist_ok=True)
    charts: list[Path | None] = []
    for number, summary in enumerate(comparison.summaries, start=1):
        chart = folder / ("table1.png" if number == 1 else f"table1_study{number}.png")
        charts.append(chart if draw_chart(summary, chart) else None)
    markdown_file, page_file, csv_file = (folder / name for name in NAMES)
    markdown_file.write_text(markdown(comparison, charts), encoding="utf-8")
    page_file.write_text(_page(comparison, charts), encoding="utf-8")
    _write_csv(csv_rows(comparison.summaries), csv_file)
    files = [page_file, markdown_file, csv_file, *(chart for chart in charts if chart)]
    if comparison.beside:
        files.append(folder / CSV_2_3)
        _write_csv(csv_rows_beside(comparison.beside), files[-1])
    return files


def markdown(comparison: Comparison, charts: Sequence[Path | None] = ()) -> str:
    """The whole comparison as Markdown, with aligned columns."""
    blocks = [f"# {TITLE}"]
    for position, summary in enumerate(comparison.summaries):
        blocks.append(f"## {comparison.headings[position]}")
        for table in text_tables(summary):
            blocks += [f"### {table.title}", _markdown_table(table)]
        if position < len(charts) and (chart := charts[position]) is not None:
            blocks.append(f"![PA-MPJPE (E_J) of every row]({chart.name})")
        blocks += notes(summary)
    for one in comparison.beside:
        blocks += [f"## {one.table.title}", _markdown_table(text_table(one)), *notes_beside(one)]
    if comparison.left_out:
        lines = [f"- {one.folder}: {one.reason}" for one in comparison.left_out]
        blocks += ["## Left out", "\n".join(lines)]
    return "\n\n".join(blocks) + "\n"


def _markdown_table(table: TextTable) -> str:
    cells = [[cell.replace("|", r"\|") for cell in row] for row in (table.columns, *table.rows)]
    widths = [max(3, *(len(row[column]) for row in cells)) for column in range(len(table.columns))]
    lines = [
        "| "
        + " | ".join(
            cell.rjust(width) if column else cell.ljust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        + " |"
        for row in cells
    ]
    rule = [("-" * width) if not column else "-" * (width - 1) + ":" for column, width in
            enumerate(widths)]  # fmt: skip
    return "\n".join([lines[0], "| " + " | ".join(rule) + " |", *lines[1:]])


def _page(comparison: Comparison, charts: Sequence[Path | None]) -> str:
    template = files("hand_recon.tables") / "tables.html.jinja"
    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    sections = [
        {
            "heading": heading,
            "tables": text_tables(summary),
            "chart": embedded(chart) if chart else None,
            "notes": notes(summary),
            "settings": summary.study.settings,
            "folders": [str(run.folder) for run in summary.study.runs],
        }
        for heading, summary, chart in zip(
            comparison.headings, comparison.summaries, charts, strict=True
        )
    ]
    return environment.from_string(template.read_text(encoding="utf-8")).render(
        title=TITLE,
        sections=sections,
        beside=[(text_table(one), notes_beside(one)) for one in comparison.beside],
        left_out=comparison.left_out,
    )


def _write_csv(lines: Sequence[Mapping[str, object]], target: Path) -> None:
    with target.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, fieldnames=list(lines[0]))
        writer.writeheader()
        writer.writerows(lines)
