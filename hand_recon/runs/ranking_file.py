"""The list of images to annotate next, `to_annotate.csv`: `hand-recon predict … rank=uncertainty`."""

import csv
import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from hand_recon.fitting.hand_records import HandRecords
from hand_recon.runs.ranking import RANKINGS, ranked_images

logger = logging.getLogger(__name__)

NAME: Final = "to_annotate.csv"
"""Name of the list."""

COLUMNS: Final = ("place", "image", "gain_mm", "value_mm", "reason")
"""Columns of the list: place from 1, image, value beside the images before it and alone, reason."""


def check_ranking(rank: str | None, *, folder: bool, photographs: bool = True) -> None:
    """Check that a list can be written.

    Args:
        rank: Value of `rank`.
        folder: True if there is a folder of results.
        photographs: True if the input is photographs.

    Raises:
        ValueError: The ranking is unknown, or there is no folder for it, or the input is a video.
    """
    if rank is None:
        return
    if rank not in RANKINGS:
        raise ValueError(f"Found rank={rank}; expected {' or '.join(RANKINGS)}, or null for none.")
    if not photographs:
        raise ValueError(
            f"Found rank={rank} and a video; expected photographs. Write the frames to a folder of images "
            "and give that: frames that are alike are listed after the first of them."
        )
    if not folder:
        raise ValueError(
            f"Found rank={rank} with json=- and no output; {NAME} is written to a folder. Add "
            "output=<folder>."
        )


def write_ranking(folder: Path, rows: Sequence[Mapping[str, Any]], hands: HandRecords) -> None:
    """Write the list of the images that could be read.

    Args:
        folder: Folder of the results.
        rows: Rows of `images.csv`.
        hands: Hands of all images.
    """
    images = [str(row["image"]) for row in rows if not row["error"]]
    with (folder / NAME).open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(COLUMNS)
        for place, one in enumerate(ranked_images(hands, images), start=1):
            writer.writerow([place, one.image, round(one.gain, 2), round(one.value, 2), one.reason])
    logger.info("Images in the order in which labels help most: %s", folder / NAME)
