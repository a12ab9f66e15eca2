"""Results of `predict`: hands, tables, overlays of photographs, meshes, and a page that shows all of them."""

import csv
import json
import logging
import os
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Int
from rich.console import Console
from rich.table import Table

from hand_recon.data.photos.formats import PhotoError
from hand_recon.data.photos.photo import read_photo
from hand_recon.fitting.drawing import PHOTO_STYLE, drawn_hand, save_meshes
from hand_recon.fitting.fitted_hands import FittedHands
from hand_recon.fitting.hand_records import HandRecords
from hand_recon.fitting.hands_file import entries_so_far, read_hands, writing_hands
from hand_recon.fitting.hands_tables import write_tables
from hand_recon.fitting.records_of_fits import to_records
from hand_recon.fitting.results import check_mesh_format, file_name, write_image
from hand_recon.runs.looking import LookedAt
from hand_recon.runs.ranking_file import check_ranking, write_ranking
from hand_recon.visualization.gallery import GalleryEntry, GalleryHand, write_gallery
from hand_recon.visualization.hand_overlay import draw_hands

logger = logging.getLogger(__name__)

PHOTO_PRODUCTS: Final = (
    "hands.json", "hands.json.part", "hands.csv", "landmarks.csv", "images.csv", "to_annotate.csv",
    "progress.jsonl", "overlays", "meshes", "index.html", "pictures", "fits.png", "metrics.json",
    "checkpoints",
)  # fmt: skip
"""Files and folders of `predict`; a folder that holds one of them is not written to."""

COLUMNS: Final = (
    "image", "width", "height", "hands", "doubtful", "error", "overlay", "read_ms", "detect_ms", "fit_ms",
    "draw_ms",
)  # fmt: skip
"""Columns of `images.csv`."""


@dataclass(frozen=True)
class PhotoOptions:
    """Options for the results besides `hands.json` and the tables.

    Raises:
        ValueError: The format of meshes or the ranking is unknown.
    """

    overlays: bool = True
    """True for an image of each photograph with its hands, and `index.html`."""
    meshes: str | None = None
    """Format of the meshes, one of `hand_recon.fitting.results.MESH_FORMATS`; None for no meshes."""
    rank: str | None = None
    """`uncertainty` for a list of the images to annotate next, `to_annotate.csv`; None for no list."""

    def __post_init__(self) -> None:
        check_ranking(self.rank, folder=True)
        if self.meshes is not None:
            check_mesh_format(self.meshes)


class PhotoResults:
    """Writer of a folder of results, photograph by photograph."""

    def __init__(
        self, folder: Path, faces: Int[np.ndarray, "face 3"], options: PhotoOptions
    ) -> None:
        self.folder, self.faces, self.options = folder, faces, options
        self.rows: list[dict[str, Any]] = []
        self.summary: dict[str, int] = {}

    @contextmanager
    def writing(self, *, goes_on: bool) -> Iterator[list[str]]:
        """Open the files, and complete them at the end; yields the names of photographs that are done.

        `summary` then has the numbers of images, of images that could not be processed, and of hands.

        Args:
            goes_on: True to keep the photographs that an interrupted run finished.
        """
        hands, progress = self.folder / "hands.json", self.folder / "progress.jsonl"
        kept: list[dict[str, Any]] = []
        batches: list[list[dict[str, Any]]] = []
        if goes_on:
            batches, kept = _consistent(read_progress(progress), entries_so_far(hands))
        self.rows = [row for rows in batches for row in rows]
        done = [row["image"] for row in self.rows]
        if done:
            logger.info("%d images are done already.", len(done))
        with (
            writing_hands(hands, kept) as self.write,
            appending(progress, batches) as self.record,
        ):
            yield done
        records = read_hands(hands)
        _write_table(self.folder / "images.csv", self.rows)
        write_tables(self.folder, records)
        if self.options.rank is not None:
            write_ranking(self.folder, self.rows, records)
        if self.options.overlays:
            self._gallery(records)
        progress.unlink()
        failed = sum(bool(row["error"]) for row in self.rows)
        self.summary = {"images": len(self.rows), "failed": failed, **records.counts()}
        self._report(records)

    def add(self, batch: Sequence[LookedAt], part: FittedHands | None) -> None:
        """Write the hands of some photographs.

        Args:
            batch: The photographs.
            part: Their hands in order; None if there are none.
        """
        records = None if part is None else to_records(part)
        if records is not None:
            self.write(records)
        first, done = 0, []
        for one in batch:
            rows = range(first, first + len(one.hands))
            first += len(one.hands)
            start = time.perf_counter()
            overlay = (
                "" if records is None or part is None else self._draw(one, rows, part, records)
            )
            row = {
                "image": one.name,
                "width": "" if one.size is None else one.size[0],
                "height": "" if one.size is None else one.size[1],
                "hands": len(rows),
                "doubtful": 0
                if records is None
                else sum(records.verdicts[hand] == "doubtful" for hand in rows),
                "error": one.error or "",
                "overlay": overlay,
                **{
                    f"{stage}_ms": round(1000 * seconds, 1)
                    for stage, seconds in one.seconds.items()
                },
                "draw_ms": round(1000 * (time.perf_counter() - start), 1),
            }
            done.append(row)
        # A batch is done as a whole: its hands are fitted together, and again only together.
        self.rows += done
        self.record(done)

    def _draw(self, one: LookedAt, rows: range, part: FittedHands, records: HandRecords) -> str:
        """Write the overlay and the mesh of a photograph; the overlay's name, or nothing."""
        fitted = [hand for hand in rows if records.verdicts[hand] != "not fitted"]
        if not fitted:
            return ""
        name = file_name(one.name, one.number)
        if self.options.meshes is not None:
            save_meshes(
                _made(self.folder / "meshes") / f"{name}.{self.options.meshes}",
                part.prediction.vertices.numpy()[fitted],
                [records.sides[hand] for hand in fitted],
                self.faces,
            )
        if not self.options.overlays or one.path is None:
            return ""
        vertices = part.prediction.vertices.numpy()
        drawn = [drawn_hand(records, vertices, hand, str(hand - rows.start + 1)) for hand in fitted]
        try:
            pixels = read_photo(one.path).pixels
        except PhotoError as error:
            logger.warning("%s is not drawn: it could be read before, and now: %s", one.name, error)
            return ""
        image = draw_hands(pixels, drawn, self.faces, PHOTO_STYLE)
        write_image(_made(self.folder / "overlays") / f"{name}.jpg", image)
        return f"overlays/{name}.jpg"

    def _gallery(self, hands: HandRecords) -> None:
        """Write `index.html`."""
        by_image: dict[str | None, list[int]] = {}
        for hand, image in enumerate(hands.images):
            by_image.setdefault(image, []).append(hand)
        entries = [
            GalleryEntry(
                image=row["image"],
                overlay=row["overlay"] or None,
                error=row["error"] or None,
                hands=tuple(
                    GalleryHand(
                        side=hands.sides[hand],
                        verdict=hands.verdicts[hand],
                        reasons=hands.reasons[hand],
                        residual=float(hands.residual[hand]),
                    )
                    for hand in by_image.get(row["image"], [])
                ),
            )
            for row in self.rows
        ]
        write_gallery(self.folder, entries, "Reconstructed hands")

    def _report(self, hands: HandRecords) -> None:
        """Print the counts, on standard error."""
        table = Table(title=str(self.folder), show_header=False)
        table.add_column("what")
        table.add_column("value", justify="right")
        empty = sum(not row["error"] and int(row["hands"]) == 0 for row in self.rows)
        cameras = Counter(hands.cameras)
        further = [("images without hands", empty)]
        further += [(f"hands with the camera: {name}", count) for name, count in cameras.items()]
        for what, count in (*self.summary.items(), *further):
            table.add_row(_MEANINGS.get(what, what), str(count))
        console = Console(stderr=True)
        console.print(table)
        if self.options.overlays:
            console.print(f"Look at them: {self.folder / 'index.html'}", soft_wrap=True)


_MEANINGS: Final = {
    "failed": "images that could not be processed",
    "fitted": "fitted hands",
    "doubtful": "doubtful hands, with the reasons in hands.json",
}


def _made(folder: Path) -> Path:
    folder.mkdir(exist_ok=True)
    return folder


@contextmanager
def appending(
    path: Path, batches: Sequence[list[dict[str, Any]]]
) -> Iterator[Callable[[list[dict[str, Any]]], None]]:
    """Write the rows of batches as JSON, a batch to a line; yields the function that appends a batch.

    Args:
        path: The file; it is replaced only by a file that holds all of the batches.
        batches: Batches that it begins with.
    """
    beginning = path.with_name(f"{path.name}.new")
    with beginning.open("w", encoding="utf-8") as stream:

        def append(rows: list[dict[str, Any]]) -> None:
            stream.write(json.dumps(rows) + "\n")
            stream.flush()

        for rows in batches:
            append(rows)
        os.fsync(stream.fileno())
        os.replace(beginning, path)
        yield append


def read_progress(path: Path) -> list[list[dict[str, Any]]]:
    """Batches of rows of a file of progress whose lines are whole, as far as they go."""
    if not path.is_file():
        return []
    batches = []
    for line in path.read_text(encoding="utf-8").split("\n")[:-1]:
        try:
            batches.append(json.loads(line))
        except (ValueError, RecursionError):
            break
    return batches


def _consistent(
    batches: list[list[dict[str, Any]]], entries: list[dict[str, Any]]
) -> tuple[list[list[dict[str, Any]]], list[dict[str, Any]]]:
    """The batches of images all of whose hands are there, and these hands."""
    hands = Counter(entry["image"] for entry in entries)
    done = [rows for rows in batches if all(hands[row["image"]] == row["hands"] for row in rows)]
    names = {row["image"] for rows in done for row in rows}
    return done, [entry for entry in entries if entry["image"] in names]


def _write_table(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as stream:
        table = csv.DictWriter(stream, COLUMNS)
        table.writeheader()
        table.writerows(rows)
