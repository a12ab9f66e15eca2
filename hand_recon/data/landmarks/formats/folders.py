"""Folders of landmark files, of which each has the hands of one image or frame."""

import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from hand_recon.data.landmarks.formats.found import NoHandsError, counts_in_words
from hand_recon.data.landmarks.parsed import ParsedHands

ENDINGS: Final = frozenset({".json", ".jsonl", ".csv", ".xml", ".pose", ".txt", ".npy"})
"""Endings of the files of a folder that are read."""

_NO_IMAGE: Final = "files without hands"


def parse_folder(path: Path, parse: Callable[[Path], ParsedHands]) -> ParsedHands:
    """The hands of all files of a folder, in the order of their names, with numbers by their value.

    Files in which the tool found no hands are counted as left out. Names of hands begin with their file's.

    Args:
        path: The folder; its folders are not read.
        parse: Reads one file.

    Raises:
        ValueError: There are no files, a file is wrong, or files are of several forms.
    """
    files = sorted(
        (file for file in path.iterdir() if file.suffix.lower() in ENDINGS and file.is_file()),
        key=lambda file: [
            int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", file.name)
        ],
    )
    left_out: Counter[str] = Counter()
    parts: list[tuple[Path, ParsedHands]] = []
    for file in files:
        try:
            parts.append((file, parse(file)))
        except NoHandsError:
            left_out[_NO_IMAGE] += 1
    if not parts:
        raise ValueError(
            f"{path} is a folder, and none of its {len(files)} files {sorted(ENDINGS)} has hands; expected "
            "one or more, each with the hands of an image."
        )
    _refuse_several_forms(path, parts)
    joined = _joined([replace(part, names=_names(file, part)) for file, part in parts])
    return replace(
        joined,
        title=f"{len(parts)} files of {joined.title or 'hands'}",
        left_out=[*counts_in_words(left_out), *joined.left_out],
    )


def _refuse_several_forms(path: Path, parts: Sequence[tuple[Path, ParsedHands]]) -> None:
    (first, known), *others = parts
    for file, part in others:
        if (part.title, part.in_freihand_order) != (known.title, known.in_freihand_order):
            raise ValueError(
                f"{path} has files of several forms: {first.name} holds {known.title or 'hands'}, "
                f"{file.name} {part.title or 'hands'}. Put those of each form into a folder of their own."
            )


def _names(file: Path, part: ParsedHands) -> list[str]:
    names = part.names or (None,) * len(part.points)
    images = part.images or (None,) * len(part.points)
    return [
        name if name and image else f"{file.stem} {name or number}"
        for number, (name, image) in enumerate(zip(names, images, strict=True))
    ]


def _joined(parts: Sequence[ParsedHands]) -> ParsedHands:
    """The hands of all parts; what some parts lack is unknown for their hands."""
    counts = [len(part.points) for part in parts]
    occluded = [part.occluded for part in parts if part.occluded is not None]
    return ParsedHands(
        points=np.concatenate([part.points for part in parts]),
        third_value=_stacked([part.third_value for part in parts], counts, 21),
        confidence=_stacked([part.confidence for part in parts], counts, 21),
        sigma=_stacked([part.sigma for part in parts], counts, 21),
        intrinsics=_stacked([part.intrinsics for part in parts], counts, 3, 3),
        sides=[side for part in parts for side in part.sides or (None,) * len(part.points)],
        names=[name for part in parts for name in part.names],
        images=[image for part in parts for image in part.images or (None,) * len(part.points)],
        boxes=_stacked([part.boxes for part in parts], counts, 4),
        occluded=np.concatenate(occluded) if len(occluded) == len(parts) else None,
        image_sizes=_stacked([part.image_sizes for part in parts], counts, 2),
        title=parts[0].title,
        left_out=list(dict.fromkeys(words for part in parts for words in part.left_out)),
        in_freihand_order=parts[0].in_freihand_order,
    )


def _stacked(
    values: Sequence[Float[np.ndarray, "..."] | None], counts: Sequence[int], *shape: int
) -> Float[np.ndarray, "..."] | None:
    if all(value is None for value in values):
        return None
    return np.concatenate(
        [
            np.full((count, *shape), np.nan) if value is None else value
            for value, count in zip(values, counts, strict=True)
        ]
    )
