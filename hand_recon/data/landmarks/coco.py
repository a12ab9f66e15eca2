"""Hands in COCO's keypoint format: 21 keypoints per annotation, or the two hands of COCO-WholeBody.

Annotation files and lists of results are read alike. The third number of a keypoint is COCO's visibility
(0, 1, 2) or a score; 0 is a keypoint that is not there. COCO-WholeBody's hands are in FreiHAND's order.
"""

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from hand_recon.data.landmarks.parsed import ParsedHands, read_side

logger = logging.getLogger(__name__)

LENGTH: Final = 63
"""Numbers of a hand: u, v and visibility of 21 keypoints."""

KEYS: Final = {"keypoints": None, "lefthand_kpts": "left", "righthand_kpts": "right"}
"""Where an annotation keeps hands, and which side they then are."""


@dataclass(frozen=True)
class _Hand:
    """One hand of an annotation."""

    numbers: list[Any]
    side: str | None
    image: str | None
    name: str


def is_coco(content: object) -> bool:
    """Whether JSON is an annotation file of COCO or a list of results."""
    if isinstance(content, dict):
        return isinstance(content.get("annotations"), list)
    return (
        isinstance(content, list)
        and bool(content)
        and all(isinstance(entry, dict) and any(key in entry for key in KEYS) for entry in content)
    )


def parse_coco(path: Path, content: dict[str, Any] | list[Any]) -> ParsedHands:
    """The hands of all annotations, in their order; the left one first where there are two.

    Raises:
        ValueError: No annotation has a hand, or one has another number of keypoints than 21.
    """
    whole = content if isinstance(content, dict) else {"annotations": content}
    images = {entry.get("id"): entry for entry in whole.get("images", [])}
    categories = {
        entry.get("id"): str(entry.get("name", "")) for entry in whole.get("categories", [])
    }
    hands: list[_Hand] = []
    for annotation in whole["annotations"]:
        image = images.get(annotation.get("image_id"), {})
        category = categories.get(annotation.get("category_id"), "")
        hands += _hands_of(path, annotation, image.get("file_name"), category)
    if not hands:
        raise ValueError(
            f"{path}: none of {len(whole['annotations'])} annotations has a hand; expected `keypoints` of "
            f"{LENGTH} numbers, or COCO-WholeBody's `lefthand_kpts` and `righthand_kpts` marked as valid."
        )
    try:
        numbers = np.array([hand.numbers for hand in hands], dtype=np.float64).reshape(-1, 21, 3)
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path}: a keypoint is not a number ({error}).") from error
    points, score = numbers[..., :2].copy(), numbers[..., 2]
    points[score == 0] = np.nan
    return ParsedHands(
        points=points,
        confidence=_confidence(path, score),
        sides=[hand.side for hand in hands],
        names=[hand.name for hand in hands],
        images=[hand.image for hand in hands],
    )  # fmt: skip


def _hands_of(
    path: Path, annotation: dict[str, Any], image: str | None, category: str
) -> list[_Hand]:
    """The hands of one annotation; those that it marks as not valid are left out."""
    identity = f"annotation {annotation.get('id', annotation.get('image_id'))}"
    hands = []
    for key, known_side in KEYS.items():
        numbers = annotation.get(key)
        if not numbers or not annotation.get(f"{key.removesuffix('_kpts')}_valid", True):
            continue
        beside_hands = known_side is None and any(KEYS[key] for key in KEYS if key in annotation)
        if beside_hands and len(numbers) != LENGTH:
            # The body's keypoints, in COCO-WholeBody.
            continue
        if len(numbers) != LENGTH:
            raise ValueError(
                f"{path}: {key} of {identity} has {len(numbers)} numbers, expected {LENGTH}: u, v and "
                "visibility of 21 keypoints."
            )
        side = known_side or _side(f"{path}: {identity}", annotation, category)
        name = f"{image or identity}" if known_side is None else f"{image or identity} {side}"
        hands.append(_Hand(numbers, side, image, name))
    return hands


def _side(where: str, annotation: dict[str, Any], category: str) -> str | None:
    """What the annotation says, else what its category's name says."""
    told = read_side(where, annotation.get("side", annotation.get("handedness")))
    named = [side for side in ("left", "right") if side in category.lower()]
    return told or (named[0] if len(named) == 1 else None)


def _confidence(path: Path, score: np.ndarray) -> np.ndarray | None:
    """Scores from 0 to 1; none where the numbers are visibilities, which say nothing of precision."""
    if np.isin(score, (0, 1, 2)).all():
        return None
    if (score > 1).any():
        logger.info("%s: scores above 1 are read as 1.", path)
    return score.clip(max=1.0)
