"""Text for groups of frames in the messages of the lint."""

from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import Final

from jaxtyping import Bool, Int
from torch import Tensor

MOST_RANGES: Final = 3
"""Most ranges of frames that a message lists."""

MOST_GROUPS: Final = 5
"""Most sequences that a message names."""


def frame_ranges(frames: Int[Tensor, " frame"], gap: int = 1) -> str:
    """Describe increasing frame numbers as ranges, such as `3, 260 to 399`.

    Args:
        frames: Numbers counted from 0.
        gap: Largest step between two frames of one range, that of the inspected frames.
    """
    ranges: list[list[int]] = []
    for frame in frames.tolist():
        if ranges and frame - ranges[-1][1] <= gap:
            ranges[-1][1] = frame
        else:
            ranges.append([frame, frame])
    shown = [
        f"{first}" if first == last else f"{first} to {last}"
        for first, last in ranges[:MOST_RANGES]
    ]
    rest = len(ranges) - MOST_RANGES
    return ", ".join(shown) + (f" and {rest} more ranges" if rest > 0 else "")


def read_frame_names(folder: Path, count: int) -> tuple[str, ...] | None:
    """Names of the frames of HO3D's test set, `<sequence>/<frame>`, from evaluation.txt.

    Args:
        folder: Folder of the ground truth; evaluation.txt may be in it or in the folder above.
        count: Number of frames.

    Returns:
        One name for each frame; none if there is no such file, or one of another number of lines.
    """
    for path in (folder / "evaluation.txt", folder.parent / "evaluation.txt"):
        try:
            lines = path.read_text(encoding="utf-8-sig").split()
        except (OSError, UnicodeDecodeError):
            continue
        if len(lines) == count:
            return tuple(lines)
    return None


def sequences_of(names: Sequence[str] | None, frames: Bool[Tensor, " frame"]) -> str:
    """Name the sequences of some frames, in brackets; empty if the names are not known.

    Args:
        names: Name of each frame, `<sequence>/<frame>` as in HO3D's evaluation.txt.
        frames: True for the frames in question.
    """
    if not names or len(names) != len(frames):
        return ""
    groups = dict.fromkeys(
        str(PurePosixPath(name).parent)
        for name, chosen in zip(names, frames.tolist(), strict=True)
        if chosen
    )
    known = [group for group in groups if group != "."]
    if not known:
        return ""
    rest = len(known) - MOST_GROUPS
    return f" ({', '.join(known[:MOST_GROUPS])}{f' and {rest} more' if rest > 0 else ''})"
