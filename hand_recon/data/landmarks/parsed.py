"""Common form of parsed landmark files, and the checks that turn it into `ImageLandmarks`."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import torch
from jaxtyping import Bool, Float

from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.hand.skeleton import landmark_permutation

logger = logging.getLogger(__name__)

MEANINGS: Final = ("auto", "confidence", "sigma")
"""Possible meanings of the third value of a point."""

SIDES: Final = ("left", "right")
"""Names of a hand's side."""


@dataclass(frozen=True)
class ParsedHands:
    """Unchecked contents of a file of N hands; NaN where the file has no value."""

    points: Float[np.ndarray, "hand landmark=21 2"]
    """Pixels of the image, in the file's order of landmarks."""
    third_value: Float[np.ndarray, "hand landmark=21"] | None = None
    """Third value whose meaning the file does not specify."""
    confidence: Float[np.ndarray, "hand landmark=21"] | None = None
    """Scores from 0 to 1."""
    sigma: Float[np.ndarray, "hand landmark=21"] | None = None
    """Standard deviations, pixels of the image."""
    intrinsics: Float[np.ndarray, "hand 3 3"] | None = None
    """Camera matrices."""
    sides: Sequence[str | None] = ()
    """`left`, `right` or None for each hand; empty if no side is known."""
    names: Sequence[str | None] = ()
    """Name of each hand in the file; empty if it has no names."""
    images: Sequence[str | None] = ()
    """Image of each hand as written in the file; empty if it names none."""
    boxes: Float[np.ndarray, "hand 4"] | None = None
    """Left, top, right and bottom, pixels of the image; NaN, or no extent, where there is no box."""
    occluded: Bool[np.ndarray, "hand landmark=21"] | None = None
    """True for landmarks that cannot be seen, in the file's order of landmarks."""
    image_sizes: Float[np.ndarray, "hand 2"] | None = None
    """Width and height of each hand's image as the file states them; NaN where it does not."""
    title: str | None = None
    """The tool's format in words, such as `OpenPose's people`; None for the project's own forms."""
    left_out: Sequence[str] = ()
    """Entries of the file that are not among the hands, counted in words."""
    in_freihand_order: bool = False
    """True if the file names its landmarks, which are then in FreiHAND's order already."""


@dataclass(frozen=True)
class Assumptions:
    """Assumed values of what a file does not specify.

    Raises:
        ValueError: A value is unknown.
    """

    third_value: str = "auto"
    """One of `MEANINGS`; `auto` takes numbers that all lie in [0, 1] for confidences, else for σ."""
    side: str | None = "right"
    """Side of hands whose side the file does not give; None refuses such a file."""
    order: str = "freihand"
    """Order of the landmarks, a key of `hand_recon.hand.skeleton.LANDMARK_ORDERS`."""
    images: Path | None = None
    """Folder of the images, if it is not that of the file."""

    def __post_init__(self) -> None:
        if self.third_value not in MEANINGS:
            raise ValueError(
                f"Unknown third value {self.third_value!r}; choose one of {list(MEANINGS)}."
            )
        if self.side is not None and self.side not in SIDES:
            raise ValueError(f"Unknown side {self.side!r}; choose one of {list(SIDES)}.")
        landmark_permutation(self.order, "freihand")


def read_side(where: str, value: object) -> str | None:
    """Parse the side of a hand.

    Args:
        where: File and hand, for the message.
        value: A side in any case; None or an empty text is an unknown side.

    Raises:
        ValueError: It is something else.
    """
    if value is None or value == "":
        return None
    side = str(value).strip().lower()
    if side not in SIDES:
        raise ValueError(f"{where} has the side {value!r}; expected one of {list(SIDES)}.")
    return side


def to_image_sizes(values: Sequence[tuple[object, object]]) -> Float[np.ndarray, "hand 2"] | None:
    """Widths and heights as numbers, NaN where they are no positive numbers; None if none is."""
    sizes = np.full((len(values), 2), np.nan)
    for hand, (width, height) in enumerate(values):
        if isinstance(width, int | float) and isinstance(height, int | float):
            sizes[hand] = (width, height) if width > 0 and height > 0 else np.nan
    return None if np.isnan(sizes).all() else sizes


def to_image_landmarks(path: Path, parsed: ParsedHands, assumed: Assumptions) -> ImageLandmarks:
    """Check parsed hands and put the landmarks into the project's order.

    Args:
        path: The file, for messages.
        parsed: Its contents.
        assumed: Assumed values of what it does not specify.

    Raises:
        ValueError: There are no hands, or numbers that cannot be landmarks in pixels.
    """
    hands = len(parsed.points)
    if hands == 0:
        raise ValueError(f"{path} holds no hands; expected one or more, of 21 points each.")
    confidence, sigma = _interpret_third_value(path, parsed, assumed.third_value)
    labelled = np.isfinite(parsed.points).all(axis=-1)
    if confidence is not None:
        # Detectors write (0, 0) with confidence 0 for what they did not find.
        labelled &= ~(confidence == 0)
    _check_points(path, parsed.points, labelled)
    confidence, sigma = _where(labelled, confidence), _where(labelled, sigma)
    _check_confidence(path, confidence)
    _check_sigma(path, sigma)
    order = list(landmark_permutation(assumed.order, "freihand"))
    points = np.where(labelled[..., None], parsed.points, np.nan)
    root = assumed.images or path.parent
    images = tuple(root / image if image else None for image in parsed.images)
    named = parsed.names or (None,) * hands
    shown = parsed.images or (None,) * hands
    names = (
        name or image or str(n) for n, (name, image) in enumerate(zip(named, shown, strict=True))
    )
    return ImageLandmarks(
        landmarks_2d=torch.from_numpy(points[:, order]),
        labelled=torch.from_numpy(labelled[:, order]),
        left=_which_left(path, parsed.sides, hands, assumed.side),
        names=tuple(names),
        sigma=None if sigma is None else torch.from_numpy(sigma[:, order]),
        confidence=None if confidence is None else torch.from_numpy(confidence[:, order]),
        intrinsics=None if parsed.intrinsics is None else torch.from_numpy(parsed.intrinsics),
        images=images,
        hand_boxes=None if parsed.boxes is None else torch.from_numpy(_known_boxes(parsed.boxes)),
        occluded=None
        if parsed.occluded is None
        else torch.from_numpy((parsed.occluded & labelled)[:, order]),
        image_sizes=None if parsed.image_sizes is None else torch.from_numpy(parsed.image_sizes),
    )


def _known_boxes(boxes: Float[np.ndarray, "hand 4"]) -> Float[np.ndarray, "hand 4"]:
    """Boxes, with NaN for those without extent: annotators write zeros for a box that they did not draw."""
    extent = (boxes[:, 2:] - boxes[:, :2]).min(axis=-1, keepdims=True)
    return np.where(np.isfinite(boxes).all(axis=-1, keepdims=True) & (extent > 0), boxes, np.nan)


def refuse(path: Path, wrong: Bool[np.ndarray, " hand"], what: str) -> None:
    """Raise an error that names the first wrong hands, if there are any.

    Raises:
        ValueError: A hand is wrong.
    """
    if wrong.any():
        first = ", ".join(str(hand) for hand in np.flatnonzero(wrong)[:5])
        raise ValueError(
            f"{path}: {int(wrong.sum())} of {len(wrong)} hands have {what} Counted from 0: {first}."
        )


def _interpret_third_value(
    path: Path, parsed: ParsedHands, meaning: str
) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Confidence and σ, after deciding which of the two the third value is."""
    confidence, sigma, third_value = parsed.confidence, parsed.sigma, parsed.third_value
    if third_value is None or np.isnan(third_value).all():
        return confidence, sigma
    if meaning == "auto":
        within = bool(((third_value >= 0) & (third_value <= 1))[~np.isnan(third_value)].all())
        meaning = "confidence" if within else "sigma"
        range_found = "all lie in [0, 1]" if within else "do not all lie in [0, 1]"
        logger.info(
            "%s: the third values %s and are read as %s; set third_value=confidence or third_value=sigma if "
            "they are something else.",
            path, range_found, "confidences" if within else "standard deviations in pixels",
        )  # fmt: skip
    return (third_value, sigma) if meaning == "confidence" else (confidence, third_value)


def _check_points(
    path: Path,
    points: Float[np.ndarray, "hand landmark=21 2"],
    labelled: Bool[np.ndarray, "hand landmark=21"],
) -> None:
    infinite = np.isinf(points).any(axis=(1, 2))
    refuse(path, infinite, "infinite coordinates; write null for a landmark that is missing.")
    halves = (np.isnan(points).sum(axis=-1) == 1).any(axis=-1)
    refuse(
        path, halves, "landmarks with one coordinate only; write both, or null for the landmark."
    )
    if labelled.any() and np.abs(points[labelled]).max() <= 2:
        raise ValueError(
            f"{path}: all coordinates lie within ±{np.abs(points[labelled]).max():.3g}, which are shares of "
            "the image's size, as MediaPipe gives them, and not pixels. Multiply u by the image's width and "
            "v by its height."
        )


def _check_confidence(path: Path, confidence: np.ndarray | None) -> None:
    if confidence is not None:
        outside = np.any((confidence < 0) | (confidence > 1), axis=-1)
        refuse(
            path,
            outside,
            "confidences outside [0, 1]; if they are σ in pixels, set third_value=sigma.",
        )


def _check_sigma(path: Path, sigma: np.ndarray | None) -> None:
    if sigma is not None:
        wrong = (~(sigma > 0) & ~np.isnan(sigma)) | np.isinf(sigma)
        refuse(
            path, np.any(wrong, axis=-1),
            "a σ that is not positive and finite. σ is in pixels; null stands for unknown. A depth, such as "
            "MediaPipe's z, is neither σ nor confidence: leave it out.",
        )  # fmt: skip


def _where(labelled: np.ndarray, values: np.ndarray | None) -> np.ndarray | None:
    """Values at labelled landmarks, NaN elsewhere; None if there are no values."""
    if values is None:
        return None
    kept = np.where(labelled, values, np.nan)
    return None if np.isnan(kept).all() else kept


def _which_left(
    path: Path, sides: Sequence[str | None], hands: int, assumed: str | None
) -> Bool[torch.Tensor, " hand"]:
    unknown = hands - sum(side is not None for side in sides)
    if unknown and assumed is None:
        raise ValueError(
            f"{path} gives no side for {unknown} of {hands} hands, and 2D landmarks do not determine it: a "
            "right palm looks like the back of a left hand. If all of these are of one side, set side=right "
            "or side=left (data.side in training); else write `side` for each hand."
        )
    if unknown:
        logger.info(
            "%s: no side is given for %d of %d hands; they are read as %s hands (side=%s).",
            path, unknown, hands, assumed, assumed,
        )  # fmt: skip
    known = [side or assumed for side in sides] or [assumed] * hands
    return torch.tensor([side == "left" for side in known])
