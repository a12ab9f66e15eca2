"""A page of all images with their hands and verdicts: an HTML file beside its images, without a network.

It has no script: what is shown is chosen by radio buttons and style rules alone. It is written without a
template engine, which fitting does not need otherwise.
"""

import math
import os
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Final
from urllib.parse import quote

_STYLE: Final = """
  body { font: 16px/1.45 system-ui, sans-serif; margin: 1.5rem; color: #1c1c1c; background: #fff; }
  h1 { font-size: 1.5rem; overflow-wrap: anywhere; }
  label { margin: 0 1.2rem 0 .2rem; white-space: nowrap; }
  table { border-collapse: collapse; width: 100%; }
  th, td { padding: .4rem .7rem; text-align: left; vertical-align: top; }
  tbody { border-top: 2px solid #ccc; }
  thead th { position: sticky; top: 0; background: #fff; border-bottom: 2px solid #888; }
  th[scope=rowgroup] { font-weight: normal; overflow-wrap: anywhere; width: 52%; }
  img { display: block; height: 15rem; max-width: 100%; object-fit: contain; object-position: left top; }
  td.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
  td.verdict { white-space: nowrap; }
  td.verdict.doubtful { background: #ffe9a8; font-weight: bold; }
  td.verdict.not-fitted, td.error { background: #ffd6cf; }
  ul { margin: 0; padding-left: 1.1rem; }
  @media print { input, label { display: none; } }
"""


@dataclass(frozen=True)
class GalleryHand:
    """One hand of an image."""

    side: str
    """Side, `left` or `right`."""
    verdict: str
    """Verdict, such as `plausible`, `doubtful` or `not fitted`."""
    reasons: Sequence[str] = ()
    """Reasons of the verdict, one sentence each."""
    residual: float = math.nan
    """Mean distance of the fitted to the given landmarks, pixels of the image; NaN if unknown."""


@dataclass(frozen=True)
class GalleryEntry:
    """One image."""

    image: str
    """Name of the image."""
    overlay: str | None = None
    """Path of the drawing, relative to the page's folder; None without one."""
    hands: Sequence[GalleryHand] = ()
    """Hands of the image, in order."""
    error: str | None = None
    """Reason why the image could not be processed; None if it was."""
    notes: Sequence[str] = ()
    """Further sentences about the image."""

    @property
    def states(self) -> frozenset[str]:
        """The groups of images that this one belongs to, of `STATES`."""
        if self.error is not None:
            return frozenset({"error"})
        if not self.hands:
            return frozenset({"empty"})
        verdicts = {_word(hand.verdict) for hand in self.hands}
        return frozenset(verdicts & STATES.keys()) or frozenset({"plausible"})


STATES: Final = {
    "doubtful": "doubtful",
    "not-fitted": "not fitted",
    "error": "could not be processed",
    "empty": "no hand found",
    "plausible": "plausible",
}
"""Groups of images and their titles; an image with several hands may be in several groups."""


def write_gallery(folder: str | Path, entries: Sequence[GalleryEntry], title: str) -> Path:
    """Write `index.html` in a folder, which is made if it is missing.

    Drawings are loaded when they come into view, so that the page works for ten thousand images. Names may
    hold any letters and cannot change the page.

    Args:
        folder: Folder of the page; paths of drawings are relative to it.
        entries: Images, in the order of the page.
        title: Title of the page.

    Returns:
        The file.
    """
    target = Path(folder) / "index.html"
    target.parent.mkdir(parents=True, exist_ok=True)
    with target.open("w", encoding="utf-8", newline="\n") as stream:
        stream.writelines(line + "\n" for line in _page(entries, title))
    return target


def _page(entries: Sequence[GalleryEntry], title: str) -> Iterator[str]:
    counts = Counter(state for entry in entries for state in entry.states)
    rules = (
        f"  #show-{state}:checked ~ table tbody:not(.{state}) {{ display: none; }}"
        for state in STATES
    )
    yield '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">'
    yield '<meta name="viewport" content="width=device-width, initial-scale=1">'
    yield (
        f"<title>{page_text(title)}</title>\n<style>{_STYLE}"
        + "\n".join(rules)
        + "\n</style>\n</head>"
    )
    yield f"<body>\n<h1>{page_text(title)}</h1>"
    yield f"<p>{_summary(entries)}</p>"
    # Buttons stand before the table, not around it: the rules select what follows them.
    yield '<input type="radio" name="show" id="show-all" checked>'
    yield f'<label for="show-all">all images ({len(entries)})</label>'
    for state, name in STATES.items():
        yield f'<input type="radio" name="show" id="show-{state}">'
        yield f'<label for="show-{state}">{name} ({counts[state]})</label>'
    yield "<table>\n<thead><tr><th>image</th><th>hand</th><th>side</th><th>verdict</th>"
    yield "<th>reasons</th><th>residual, px</th></tr></thead>"
    for entry in entries:
        yield from _rows(entry)
    yield "</table>\n</body>\n</html>"


def _summary(entries: Sequence[GalleryEntry]) -> str:
    hands = [hand for entry in entries for hand in entry.hands]
    verdicts = Counter(hand.verdict for hand in hands)
    parts = [f"{_count(len(entries), 'image')}, {_count(len(hands), 'hand')}"]
    parts += [f"{count} {page_text(verdict)}" for verdict, count in verdicts.most_common()]
    failed = sum(entry.error is not None for entry in entries)
    if failed:
        parts.append(f"{_count(failed, 'image')} could not be processed")
    return "; ".join(parts) + "."


def _rows(entry: GalleryEntry) -> Iterator[str]:
    """One group of rows: the image at the left, its hands below each other at the right."""
    span = max(1, len(entry.hands))
    yield f'<tbody class="{" ".join(sorted(entry.states))}"><tr>'
    yield f'<th scope="rowgroup" rowspan="{span}">{_image(entry)}{_list(entry.notes)}</th>'
    if entry.error is not None:
        yield f'<td colspan="5" class="error">{page_text(entry.error)}</td></tr></tbody>'
        return
    if not entry.hands:
        yield '<td colspan="5">no hand found</td></tr></tbody>'
        return
    for number, hand in enumerate(entry.hands, start=1):
        opening = "<tr>" if number > 1 else ""
        residual = f"{hand.residual:.1f}" if math.isfinite(hand.residual) else "–"
        yield (
            f"{opening}<td>{number}</td><td>{page_text(hand.side)}</td>"
            f'<td class="verdict {_word(hand.verdict)}">{page_text(hand.verdict)}</td>'
            f'<td>{_list(hand.reasons)}</td><td class="number">{residual}</td></tr>'
        )
    yield "</tbody>"


def _image(entry: GalleryEntry) -> str:
    name = page_text(entry.image)
    if entry.overlay is None:
        return name
    address = relative_address(entry.overlay)
    return (
        f'<a href="{address}"><img src="{address}" alt="{name} with its hands" loading="lazy" '
        f'decoding="async"></a>{name}'
    )


def _list(sentences: Sequence[str]) -> str:
    if not sentences:
        return ""
    return "<ul>" + "".join(f"<li>{page_text(sentence)}</li>" for sentence in sentences) + "</ul>"


def relative_address(path: str) -> str:
    """Relative address of a file for a page: every byte but letters, digits and slashes is escaped.

    Args:
        path: Path of the file from the page's folder.
    """
    # A colon would otherwise end the name of a protocol, a backslash is Windows' slash.
    return quote(os.fsencode(path.replace(os.sep, "/")), safe="/")


def page_text(words: str) -> str:
    """Text for a page; bytes of names that are no letters become escapes.

    Args:
        words: Any text, such as a file's name.
    """
    return escape(words.encode("utf-8", "backslashreplace").decode("utf-8"))


def _word(verdict: str) -> str:
    """A verdict as the name of a class."""
    return "".join(letter if letter.isalnum() else "-" for letter in verdict.lower())


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
