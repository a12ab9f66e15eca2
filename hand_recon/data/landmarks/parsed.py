"""Common form of parsed landmark files, and the checks that turn it into `ImageLandmarks`."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import torch
from jaxtyping import Bool, Float

from hand_recon.data.landmarks.camera_checks import in_pixels
from hand_recon.data.landmarks.image_bounds import known_sizes, warn_of_hands_outside
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.data.landmarks.image_paths import located_images
from hand_recon.data.landmarks.image_sizes import sizes_of_images
from hand_recon.data.landmarks.placeholders import PLACEHOLDERS, at_placeholders, say_placeholders
from hand_recon.data.landmarks.points_in_space import refuse_points_in_space
from hand_recon.data.landmarks.refusal import refuse
from hand_recon.data.landmarks.third_values import (
    MEANINGS,
    check_sigma_size,
    clipped_scores,
    interpret,
)
from hand_recon.hand.landmark_order import better_order, bone_sums
from hand_recon.hand.skeleton import landmark_permutation

logger = logging.getLogger(__name__)

LONGEST_BONES: Final = 6.0
"""Largest median sum of bone lengths over hand size of real hands (3.8, and 8 for random points)."""

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
    """One of `MEANINGS`; `auto` decides by the numbers of the whole file (decision 57)."""
    side: str | None = "right"
    """Side of hands whose side the file does not give; None refuses such a file."""
    order: str = "freihand"
    """Order of the landmarks, a key of `hand_recon.hand.skeleton.LANDMARK_ORDERS`."""
    images: Path | None = None
    """Folder of the images, if it is not that of the file."""
    placeholders: str = "missing"
    """One of `PLACEHOLDERS`: `missing` takes exactly (0, 0) or (−1, −1) without a score for "not found"."""

    def __post_init__(self) -> None:
        if self.third_value not in MEANINGS:
            raise ValueError(
                f"Unknown third value {self.third_value!r}; choose one of {list(MEANINGS)}."
            )
        if self.placeholders not in PLACEHOLDERS:
            raise ValueError(
                f"Unknown placeholders {self.placeholders!r}; choose one of {list(PLACEHOLDERS)}."
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
    refuse_points_in_space(path, parsed.points, parsed.third_value)
    labelled, confidence, sigma = _labels(path, parsed, assumed)
    _check_points(path, parsed.points, labelled)
    _check_confidence(path, confidence)
    _check_sigma(path, sigma)
    points = np.where(labelled[..., None], parsed.points, np.nan)
    if sigma is not None:
        check_sigma_size(path, points, sigma)
    _warn_of_another_order(path, points, assumed.order)
    order = list(landmark_permutation(assumed.order, "freihand"))
    images = located_images(path, assumed.images or path.parent, parsed.images)
    sizes = known_sizes(images, parsed.image_sizes, hands)
    warn_of_hands_outside(path, points, sizes)
    intrinsics = parsed.intrinsics
    if intrinsics is not None:
        intrinsics = in_pixels(path, intrinsics, sizes_of_images(images, parsed.image_sizes, hands))
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
        intrinsics=None if intrinsics is None else torch.from_numpy(intrinsics),
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


def _labels(
    path: Path, parsed: ParsedHands, assumed: Assumptions
) -> tuple[Bool[np.ndarray, "hand landmark=21"], np.ndarray | None, np.ndarray | None]:
    """Mask of the landmarks with a label, and their confidence and σ, NaN where there is none."""
    labelled = np.isfinite(parsed.points).all(axis=-1)
    nowhere = at_placeholders(parsed.points) & labelled
    if assumed.placeholders == "keep":
        nowhere[:] = False
    confidence, sigma, third = parsed.confidence, parsed.sigma, parsed.third_value
    if third is not None and not np.isnan(third).all():
        seen = np.where(nowhere[..., None], np.nan, parsed.points)
        meaning, third = interpret(path, seen, third, assumed.third_value)
        confidence = third if meaning == "confidence" else confidence
        sigma = third if meaning == "sigma" else sigma
    if confidence is not None:
        # A score above 0 at these coordinates says that the landmark was found there.
        nowhere &= ~(confidence > 0)
        confidence = clipped_scores(path, np.where(nowhere, np.nan, confidence))
        # Detectors write (0, 0) with confidence 0 for what they did not find.
        labelled &= ~(confidence == 0)
    nowhere &= labelled
    say_placeholders(path, parsed.points, nowhere)
    labelled &= ~nowhere
    return labelled, _where(labelled, confidence), _where(labelled, sigma)


def _warn_of_another_order(
    path: Path, points: Float[np.ndarray, "hand landmark=21 2"], assumed: str
) -> None:
    """Warn where the bones are clearly shorter in another known order; nothing is reordered."""
    order = better_order(points, assumed)
    # Points that are no hand have long bones in every order.
    if order is not None and float(np.median(bone_sums(points)[order])) < LONGEST_BONES:
        logger.warning(
            "%s: the landmarks look to be in the order of %r and not of %r: bones are shorter in that order. "
            "They are read as %r; if that is wrong, set order=%s (data.order in training).",
            path, order, assumed, assumed, order,
        )  # fmt: skip


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
