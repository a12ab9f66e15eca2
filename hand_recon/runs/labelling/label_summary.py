"""Numbers of labelled images, hands and marks, and their display."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from hand_recon.runs.labelling.label_files import DOUBTFUL, LABELS, pairs_of
from hand_recon.runs.labelling.label_records import LabelledImage


def summary_of(
    images: Sequence[LabelledImage], kept: int, written: Sequence[Path]
) -> dict[str, Any]:
    """Count images, hands and marks.

    Args:
        images: All images.
        kept: Number of hands in the labels.
        written: Further files.

    Returns:
        `images`, `without_hands`, `damaged` (names), `hands`, `kept`, `doubtful`, `marks` (number of hands by
        mark, the most frequent first) and `written`.
    """
    hands = [hand for _, hand in pairs_of(images)]
    marks = Counter(name for hand in hands for name in hand.reasons)
    damaged = [image.name for image in images if image.error is not None]
    return {
        "images": len(images),
        "without_hands": sum(not image.hands for image in images) - len(damaged),
        "damaged": damaged,
        "hands": len(hands),
        "kept": kept,
        "doubtful": sum(not hand.is_sure for hand in hands),
        "marks": dict(marks.most_common()),
        "written": [str(path) for path in written],
    }


def show_summary(summary: dict[str, Any], folder: Path, root: Path) -> None:
    """Print the numbers, and the command that trains on the labels, on standard error.

    Args:
        summary: `summary_of`.
        folder: Folder of the labels.
        root: Folder of the images.
    """
    table = Table(title=Text(str(folder)), show_header=False)
    table.add_column("what")
    table.add_column("number", justify="right")
    lines = [
        ("images", summary["images"]),
        ("images without hands", summary["without_hands"]),
        ("images that could not be used", len(summary["damaged"])),
        ("hands", summary["hands"]),
        (f"hands in {LABELS}", summary["kept"]),
        (f"doubtful hands, in {DOUBTFUL}", summary["doubtful"]),
        *((f"  {mark}", number) for mark, number in summary["marks"].items()),
    ]
    for what, number in lines:
        table.add_row(what, str(number))
    console = Console(stderr=True, highlight=False, soft_wrap=True)
    console.print(table)
    if summary["damaged"]:
        console.print(f"Not used: {', '.join(summary['damaged'])}", markup=False)
    for path in summary["written"]:
        console.print(f"Written: {path}", markup=False)
    if not summary["kept"]:
        return
    console.print(
        f"Train: hand-recon train data=landmarks data.train={folder / LABELS} data.images={root} "
        "data.landmark_set=mediapipe",
        markup=False,
    )
