"""Files of labels: those to train on, the doubtful ones, a table of all, and the progress of a command."""

import csv
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np

from hand_recon.data.whole_files import replaced_when_whole
from hand_recon.runs.labelling.label_records import LabelledHand, LabelledImage, listed
from hand_recon.runs.photo_results import appending, read_progress

LABELS: Final = "labels.json"
"""Labels to train on."""

DOUBTFUL: Final = "doubtful.json"
"""Hands with a mark."""

TABLE: Final = "hands.csv"
"""All hands with their scores and marks, and the images without hands."""

PROGRESS: Final = "progress.jsonl"
"""Images that a command has finished; it is removed at the end."""

KEEP: Final = ("sure", "all")
"""Choices of the hands in `LABELS`."""

COLUMNS: Final = (
    "image", "width", "height", "error", "hand", "side", "score", "side_score", "sigma_percent", "marks",
    "reasons",
)  # fmt: skip
"""Columns of `TABLE`; `sigma_percent` is the mean σ in percent of the hand's extent."""

Pair = tuple[LabelledImage, LabelledHand]
"""A hand and its image."""


class AddImages(Protocol):
    """Function that records finished images."""

    def __call__(self, images: Sequence[LabelledImage], /) -> None:
        """Record images."""
        ...


@contextmanager
def recording(path: Path) -> Iterator[tuple[list[LabelledImage], AddImages]]:
    """Open a file of progress; yields the images in it and the function that adds finished ones.

    What an interrupted command left is kept as far as its lines are whole.

    Args:
        path: The file.
    """
    batches = read_progress(path)
    with appending(path, batches) as append:
        done = [LabelledImage.from_row(row) for rows in batches for row in rows]
        yield done, lambda images: append([image.to_row() for image in images])


def pairs_of(images: Sequence[LabelledImage]) -> list[Pair]:
    """All hands with their images, in order."""
    return [(image, hand) for image in images for hand in image.hands]


def write_labels(path: Path, pairs: Sequence[Pair], about: Mapping[str, Any]) -> None:
    """Write hands as `hand_recon.data.landmarks.files` reads them.

    The keys beside `hands` are not read: `about`, and `scores`, `side_scores` and `marks`, whose entries
    belong to the hands in order.

    Args:
        path: The file; it is replaced only by a complete one.
        pairs: The hands.
        about: Facts on the command, as JSON holds them.
    """
    hands = ",\n".join(json.dumps(_entry(image, hand)) for image, hand in pairs)
    beside = {
        "scores": [hand.score for _, hand in pairs],
        "side_scores": [hand.side_score for _, hand in pairs],
        "marks": [dict(hand.reasons) for _, hand in pairs],
    }
    tail = "".join(f",\n{json.dumps(key)}: {json.dumps(values)}" for key, values in beside.items())
    text = f'{{"about": {json.dumps(dict(about))},\n"hands": [\n{hands}\n]{tail}}}\n'
    with replaced_when_whole(path) as unfinished:
        unfinished.write_text(text, encoding="utf-8")


def _entry(image: LabelledImage, hand: LabelledHand) -> dict[str, Any]:
    width, height = image.size or (None, None)
    known = {"sigma": hand.sigma, "confidence": hand.confidence}
    return {
        "image": image.name,
        "side": hand.side,
        "landmarks": listed(hand.landmarks_2d),
        **{key: listed(values) for key, values in known.items() if values is not None},
        "width": width,
        "height": height,
    }


def write_table(path: Path, images: Sequence[LabelledImage]) -> None:
    """Write a row for each hand, and one for each image without hands.

    Args:
        path: The CSV file.
        images: All images.
    """
    with path.open("w", encoding="utf-8", newline="") as stream:
        table = csv.DictWriter(stream, COLUMNS, restval="")
        table.writeheader()
        for image in images:
            width, height = image.size or ("", "")
            about = {"image": image.name, "width": width, "height": height}
            if not image.hands:
                table.writerow({**about, "error": image.error or ""})
            for number, hand in enumerate(image.hands, start=1):
                table.writerow({**about, "hand": number, **_numbers(hand)})


def _numbers(hand: LabelledHand) -> dict[str, object]:
    sigma = None if hand.sigma is None else 100 * float(np.nanmean(hand.sigma)) / hand.extent
    return {
        "side": hand.side,
        "score": "" if hand.score is None else hand.score,
        "side_score": "" if hand.side_score is None else hand.side_score,
        "sigma_percent": "" if sigma is None else round(sigma, 2),
        "marks": "; ".join(hand.reasons),
        "reasons": " ".join(hand.reasons.values()),
    }
