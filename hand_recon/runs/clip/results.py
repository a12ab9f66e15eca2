"""Results of a clip: hands, angles, animations, and numbers about the run."""

import importlib.util
import logging
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from hand_recon.fitting.drawing import drawn_hand
from hand_recon.fitting.hands_file import hand_entries
from hand_recon.fitting.hands_lines import writing_hand_lines
from hand_recon.fitting.hands_list import writing_entries
from hand_recon.formats.angles_plot import write_angles_plot
from hand_recon.formats.angles_table import write_angles
from hand_recon.formats.animated_glb import write_animated_glb
from hand_recon.formats.bvh import write_bvh
from hand_recon.hand.model import HandModel
from hand_recon.knowledge.ranges import load_ranges
from hand_recon.motion.trajectory import Trajectory
from hand_recon.runs.clip.options import MotionOptions
from hand_recon.runs.clip.smoothed import ClipPoses, SmoothedHand
from hand_recon.visualization.hand_overlay import DrawnHand

logger = logging.getLogger(__name__)

CLIP_PRODUCTS: Final = (
    "hands.json", "hands.jsonl", "angles.csv", "angles.png", "hands.glb", "video.webm", "video.mp4",
    "video.avi", "clip.json", "unfinished", "hands.json.part", "hands.jsonl.part", "config.yaml",
)  # fmt: skip
"""Files and folders of `predict` for a video, besides one `hand_<number>.bvh` for each hand."""

LINES_FROM: Final = 1000
"""Hands from which on they are written as lines (`hands.jsonl`), which can be read one by one."""

BLOCK: Final = 64
"""Frames whose hands are in memory at once."""


def clip_products(folder: Path) -> list[str]:
    """Names of files and folders; a folder that holds one of them is not written to.

    Args:
        folder: Folder of the results, which need not exist.
    """
    return [*CLIP_PRODUCTS, *sorted(path.name for path in folder.glob("hand_*.bvh"))]


@dataclass(frozen=True)
class FrameOfHands:
    """Hands of one frame, as they are written and drawn."""

    number: int
    """Number of the frame."""
    entries: tuple[dict[str, Any], ...]
    """Objects of the file of hands, by the number of the hand."""
    drawn: dict[int, DrawnHand]
    """Hands to draw by their numbers."""


def frames_of_hands(
    hands: Sequence[SmoothedHand], poses: ClipPoses, frames: Sequence[int]
) -> Iterator[FrameOfHands]:
    """Pose the hands of a clip frame by frame, those of some frames at a time.

    Args:
        hands: The hands.
        poses: Poses them.
        frames: Numbers of the frames of the clip, increasing.

    Yields:
        Every frame in order, also those without a hand.
    """
    for first in range(0, len(frames), BLOCK):
        numbers = frames[first : first + BLOCK]
        entries: dict[int, list[dict[str, Any]]] = {number: [] for number in numbers}
        drawn: dict[int, dict[int, DrawnHand]] = {number: {} for number in numbers}
        for hand in hands:
            inside = (hand.motion.frames >= numbers[0]) & (hand.motion.frames <= numbers[-1])
            if not inside.any():
                continue
            records, vertices = poses(hand, np.flatnonzero(inside))
            for row, entry in enumerate(hand_entries(records)):
                number = entry["clip"]["frame"]
                entries[number].append(entry)
                label = str(hand.motion.hand)
                drawn[number][hand.motion.hand] = drawn_hand(records, vertices, row, label)
        for number in numbers:
            yield FrameOfHands(number, tuple(entries[number]), drawn[number])


@contextmanager
def writing_frames(
    folder: Path, hands: int
) -> Iterator[Callable[[Iterable[dict[str, Any]]], None]]:
    """Write the file of hands: a list, or from `LINES_FROM` hands on one to a line.

    Args:
        folder: Folder of the results.
        hands: Number of hands in all frames.
    """
    writing = (
        writing_hand_lines(folder / "hands.jsonl")
        if hands >= LINES_FROM
        else writing_entries(folder / "hands.json", ())
    )
    with writing as write:
        yield write


def write_motions(
    folder: Path,
    motions: Sequence[Trajectory],
    hand: HandModel,
    options: MotionOptions,
    duration: float,
) -> None:
    """Write the angles and the animations of a clip.

    Files of an interrupted command are written again.

    Args:
        folder: Folder of the results.
        motions: Motion of every hand.
        hand: The hand model.
        options: What is written.
        duration: Time of the clip's last frame, seconds.
    """
    if not motions:
        return
    write_angles(_fresh(folder / "angles.csv"), motions)
    if options.plot and importlib.util.find_spec("matplotlib") is None:
        logger.info("No angles.png: it needs matplotlib (pip install 'hand_recon[train]').")
    elif options.plot:
        ranges = load_ranges("literature", hand.rest_angles)
        write_angles_plot(_fresh(folder / "angles.png"), motions, ranges)
    if options.glb:
        write_animated_glb(_fresh(folder / "hands.glb"), motions, hand, duration)
    if options.bvh:
        for motion in motions:
            write_bvh(_fresh(folder / f"hand_{motion.hand}.bvh"), motion, hand)


def _fresh(path: Path) -> Path:
    """A file's name, without what an interrupted command left there."""
    path.unlink(missing_ok=True)
    return path


def counts_of(records: Iterable[dict[str, Any]]) -> Counter[str]:
    """Numbers of hands, of seen, fitted and doubtful ones, as of photographs.

    Args:
        records: Objects of the file of hands.
    """
    counts = Counter(hands=0, fitted=0, doubtful=0, bridged=0)
    for entry in records:
        counts["hands"] += 1
        counts["fitted"] += entry["verdict"] != "not fitted"
        seen = entry["clip"]["seen"]
        counts["doubtful"] += seen and entry["verdict"] == "doubtful"
        counts["bridged"] += not seen
    return counts
