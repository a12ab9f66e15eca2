"""Hands found in a tool's file, on their way to `ParsedHands`; and checks of untyped JSON."""

import logging
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Bool, Float

from hand_recon.data.landmarks.parsed import ParsedHands

logger = logging.getLogger(__name__)

NOT_FOUND: Final = "hands that were not found"
"""Words for hands that a detector writes as zeros or leaves empty."""


class NoHandsError(ValueError):
    """A file of a known format has no hands, as of an image in which a detector found none."""


@dataclass(frozen=True)
class FoundHand:
    """One hand of a tool's file; NaN where the file has no number."""

    points: Float[np.ndarray, "landmark=21 2"]
    """Pixels of the image, or shares of its size."""
    side: str | None = None
    """`left` or `right`."""
    name: str | None = None
    """Name of the hand in the file."""
    image: str | None = None
    """Its image as written in the file."""
    confidence: Float[np.ndarray, " landmark=21"] | None = None
    """Scores of the landmarks, 0 for one that was not found."""
    occluded: Bool[np.ndarray, " landmark=21"] | None = None
    """True for landmarks that cannot be seen."""
    image_size: tuple[float, float] | None = None
    """Width and height of the image as the file states them."""


def to_parsed(
    path: Path, title: str, hands: Sequence[FoundHand], left_out: Mapping[str, int]
) -> ParsedHands:
    """Collect the hands of a file.

    Args:
        path: The file, for messages.
        title: The tool's format in words.
        hands: Its hands in their order.
        left_out: Number of entries that are not among them, by what they are (in the plural).

    Raises:
        NoHandsError: There are no hands.
    """
    counted = counts_in_words(left_out)
    if not hands:
        found = f" (left out: {', '.join(counted)})" if counted else ""
        raise NoHandsError(
            f"{path} is read as {title} and holds no hands{found}; expected one or more, of 21 points each."
        )
    return ParsedHands(
        points=np.stack([hand.points for hand in hands]),
        confidence=_confidence(path, hands),
        sides=[hand.side for hand in hands],
        names=[hand.name for hand in hands],
        images=[hand.image for hand in hands],
        occluded=_occluded(hands),
        image_sizes=sizes_of([{"image_size": hand.image_size} for hand in hands]),
        title=title,
        left_out=counted,
    )


def counts_in_words(left_out: Mapping[str, int]) -> list[str]:
    """Counts with what is counted: `bodies of 17 keypoints (3)`."""
    return [f"{what} ({count})" for what, count in left_out.items() if count]


def clipped_scores(
    path: Path, score: Float[np.ndarray, "hand landmark=21"]
) -> Float[np.ndarray, "hand landmark=21"]:
    """Scores from 0 to 1: those of some detectors (RTMPose, AlphaPose) exceed 1 or go below 0."""
    outside = (score > 1) | (score < 0)
    if outside.any():
        # Some of AlphaPose's go to 6, and tell nothing once they are clipped.
        most = 2 * outside.sum() > np.isfinite(score).sum()
        logger.log(
            logging.WARNING if most else logging.INFO,
            "%s: %d of %d scores are above 1 or below 0 and are read as 1 and 0; the highest is %.4g.",
            path, int(outside.sum()), int((~np.isnan(score)).sum()), np.nanmax(score),
        )  # fmt: skip
    return score.clip(min=0.0, max=1.0)


def _confidence(
    path: Path, hands: Sequence[FoundHand]
) -> Float[np.ndarray, "hand landmark=21"] | None:
    if all(hand.confidence is None for hand in hands):
        return None
    unknown = np.full(21, np.nan)
    rows = [unknown if hand.confidence is None else hand.confidence for hand in hands]
    return clipped_scores(path, np.stack(rows))


def _occluded(hands: Sequence[FoundHand]) -> Bool[np.ndarray, "hand landmark=21"] | None:
    """Occlusions; None unless all hands have them, and for a file that marks none."""
    rows = [hand.occluded for hand in hands if hand.occluded is not None]
    stacked = np.stack(rows) if len(rows) == len(hands) else np.zeros((0, 21), dtype=bool)
    return stacked if stacked.any() else None


class Reading:
    """Checks of a file's JSON that name the place of what is wrong, and a count of what is left out."""

    def __init__(self, path: Path, title: str) -> None:
        """Start with nothing left out.

        Args:
            path: The file.
            title: The tool's format in words.
        """
        self.path = path
        self.title = title
        self.left_out: Counter[str] = Counter()
        self.hands: list[FoundHand] = []
        self.named = False
        """True once the file's own names have put landmarks into FreiHAND's order."""

    def objects(self, value: object, where: str) -> list[dict[str, Any]]:
        """A list of objects.

        Raises:
            ValueError: It is something else.
        """
        entries = self.entries(value, where)
        for position, entry in enumerate(entries):
            if not isinstance(entry, dict):
                raise self.error(f"{where}, entry {position}", entry, "an object")
        return entries

    def entries(self, value: object, where: str) -> list[Any]:
        """A list; None counts as an empty one.

        Raises:
            ValueError: It is something else.
        """
        if value is None:
            return []
        if not isinstance(value, list):
            raise self.error(where, value, "a list")
        return value

    def numbers(
        self, value: object, where: str, *shape: int, missing: bool = False
    ) -> Float[np.ndarray, "..."]:
        """Numbers of a shape, NaN for null.

        Args:
            value: Nested lists.
            where: Their place in the file.
            shape: Expected shape; −1 for any length.
            missing: True if null may stand for a missing number.

        Raises:
            ValueError: It is something else.
        """
        expected = f"{' × '.join('n' if length < 0 else str(length) for length in shape)} numbers"
        try:
            array = np.array(value, dtype=np.float64)
        except (ValueError, TypeError, OverflowError, RecursionError) as error:
            raise self.error(where, value, expected) from error
        fits = array.ndim == len(shape) and all(
            wanted in {-1, length} for wanted, length in zip(shape, array.shape, strict=True)
        )
        if not fits or (np.isnan(array).any() and not missing):
            raise self.error(where, value, expected)
        return array

    def error(self, where: str, found: object, expected: str) -> ValueError:
        """The error for a value that is not what the format has in its place."""
        return ValueError(
            f"{self.path} is read as {self.title}, but {where} is {_shown(found)}; expected {expected}. "
            "Export the file again, or write a list of hands of 21 points [u, v] in pixels."
        )

    def parsed(self) -> ParsedHands:
        """The hands that were added.

        Raises:
            NoHandsError: There are none.
        """
        parsed = to_parsed(self.path, self.title, self.hands, self.left_out)
        return replace(parsed, in_freihand_order=self.named)

    def add(self, hand: FoundHand) -> None:
        """Add a hand; one without any landmark is counted as left out."""
        known = np.isfinite(hand.points).all(axis=-1)
        if hand.confidence is not None:
            known &= ~(hand.confidence <= 0)
        if known.any():
            self.hands.append(hand)
        else:
            self.left_out[NOT_FOUND] += 1


def _shown(value: object) -> str:
    """A value for a message: its beginning, or the length of a list."""
    if isinstance(value, list):
        return f"a list of {len(value)} entries"
    if isinstance(value, dict):
        return f"an object with the keys {sorted(map(str, value))[:10]}"
    return f"{value!r:.60}"


def documents(content: object) -> list[dict[str, Any]]:
    """The objects of a file: one alone, or a list of them such as JSON lines; empty for other content."""
    if isinstance(content, dict):
        return [content]
    if isinstance(content, list) and all(isinstance(entry, dict) for entry in content):
        return content
    return []


def all_documents(content: object, recognised: Callable[[dict[str, Any]], bool]) -> bool:
    """True if content is one object or several, and all of them are recognised."""
    found = documents(content)
    return bool(found) and all(recognised(document) for document in found)


def first_of(entry: Mapping[str, Any], keys: Iterable[str]) -> Any:  # noqa: ANN401  # any JSON
    """The value of the first key that an object has and that is not null; None without one."""
    return next((entry[key] for key in keys if entry.get(key) is not None), None)


def size_of(entry: Mapping[str, Any]) -> tuple[float, float] | None:
    """Width and height of an image in pixels, where an object states both; None otherwise."""
    pair = first_of(entry, ("image_size", "imageSize"))
    if not isinstance(pair, list | tuple) or len(pair) != 2:
        pair = [first_of(entry, keys) for keys in _SIZE_KEYS]
    sizes = [
        float(value) if isinstance(value, int | float) and 1 < value < 1e6 else 0.0
        for value in pair
    ]
    return (sizes[0], sizes[1]) if all(sizes) else None


_SIZE_KEYS: Final = (
    ("width", "image_width", "imageWidth", "original_width"),
    ("height", "image_height", "imageHeight", "original_height"),
)


def sizes_of(entries: Sequence[Mapping[str, Any]]) -> Float[np.ndarray, "hand 2"] | None:
    """`size_of` of objects, NaN for those that state none; None if none of them does."""
    sizes = [size_of(entry) for entry in entries]
    if all(size is None for size in sizes):
        return None
    return np.array([size or (np.nan, np.nan) for size in sizes], dtype=np.float64)


def text_of(value: object) -> str | None:
    """A text or a number as text; None for anything else."""
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        return None
    return str(value) or None
