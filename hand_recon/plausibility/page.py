"""The report as a page: `index.html` beside its images, without a network or a script."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from hand_recon.visualization.gallery import page_text, relative_address

_STYLE: Final = """
  body { font: 16px/1.45 system-ui, sans-serif; margin: 1.5rem; color: #1c1c1c; background: #fff; }
  h1 { font-size: 1.5rem; } h2 { font-size: 1.2rem; margin-top: 2rem; }
  table { border-collapse: collapse; } th, td { padding: .25rem .7rem; border-bottom: 1px solid #ddd; }
  th { text-align: left; } td.number { text-align: right; font-variant-numeric: tabular-nums; }
  figure { display: inline-block; margin: .5rem 1rem .5rem 0; max-width: 54rem; vertical-align: top; }
  img { max-width: 100%; } figcaption { font-size: .9rem; overflow-wrap: anywhere; }
  .implausible { color: #b3120f; font-weight: bold; }
"""


@dataclass(frozen=True)
class PictureOfHand:
    """One drawn hand."""

    image: str
    """Path of the drawing, relative to the page."""
    name: str
    """Name of the hand and of its file."""
    verdict: str
    """Verdict."""
    reasons: Sequence[str]
    """Reasons of the verdict."""


@dataclass(frozen=True)
class PageTable:
    """One table of the page; numbers are right-aligned."""

    title: str
    """Heading."""
    columns: Sequence[str]
    """Headings of the columns."""
    rows: Sequence[Sequence[Any]]
    """Cells: text, numbers, or None for an empty one."""


@dataclass(frozen=True)
class Page:
    """Content of the page."""

    title: str
    """Title."""
    tables: Sequence[PageTable]
    """Tables, in order; empty ones are left out."""
    notes: Sequence[str]
    """Sentences about what was assumed."""
    map: str | None
    """Path of the map, relative to the page; None without one."""
    hands: Sequence[PictureOfHand]
    """The worst hands."""


def write_page(path: Path, page: Page) -> None:
    """Write the page.

    Args:
        path: The file.
        page: Its content.
    """
    path.write_text("\n".join(_lines(page)) + "\n", encoding="utf-8")


def _lines(page: Page) -> Iterator[str]:
    title = page_text(page.title)
    yield '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">'
    yield f"<title>{title}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n<h1>{title}</h1>"
    if page.notes:
        yield "<ul>" + "".join(f"<li>{page_text(note)}</li>" for note in page.notes) + "</ul>"
    for table in page.tables:
        if table.rows:
            yield from _table(table)
    if page.map is not None:
        yield "<h2>Natural and audited poses</h2>"
        yield f'<img src="{relative_address(page.map)}" alt="map of poses">'
    if page.hands:
        yield f"<h2>The {len(page.hands)} worst hands</h2>"
    for hand in page.hands:
        reasons = " ".join(page_text(reason) for reason in hand.reasons)
        name, verdict = page_text(hand.name), page_text(hand.verdict)
        address = relative_address(hand.image)
        yield (
            f'<figure><img src="{address}" alt="{name}" loading="lazy"><figcaption>'
            f'{name}: <span class="{verdict}">{verdict}</span>. '
            f"{reasons}</figcaption></figure>"
        )
    yield "</body>\n</html>"


def _table(table: PageTable) -> Iterator[str]:
    yield f"<h2>{page_text(table.title)}</h2>\n<table>\n<thead><tr>"
    yield (
        "".join(f"<th>{page_text(name)}</th>" for name in table.columns) + "</tr></thead>\n<tbody>"
    )
    for row in table.rows:
        yield "<tr>" + "".join(_cell(cell) for cell in row) + "</tr>"
    yield "</tbody>\n</table>"


def _cell(value: object) -> str:
    text = shown(value)
    return (
        f"<td>{page_text(text)}</td>"
        if isinstance(value, str)
        else f'<td class="number">{text}</td>'
    )


def shown(value: object) -> str:
    """A cell as text: numbers with one decimal, – for none."""
    if value is None or value != value:
        return "–"
    return f"{value:.1f}" if isinstance(value, float) else str(value)
