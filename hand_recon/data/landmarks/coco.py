"""Hands in COCO's keypoint format: 21 keypoints per annotation, or the two hands of a whole body.

Annotation files and lists of results are read alike. COCO-WholeBody keeps hands as `lefthand_kpts` and
`righthand_kpts`, or as the keypoints 91 to 132 of its 133; Halpe-FullBody (Fang et al., TPAMI 2022) as 94 to
135 of 136. mmpose's files of OneHand10K, Panoptic and RHD have one hand per annotation. All of them are in
FreiHAND's order but RHD's own, which goes from tip to base.

The third value of a keypoint is COCO's visibility (0, 1, 2) or a score; 0 is a missing keypoint.
In a file that uses 2 as well, 1 is a keypoint that is labelled but cannot be seen.
"""

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from hand_recon.data.landmarks.parsed import ParsedHands, read_side, to_image_sizes

logger = logging.getLogger(__name__)

LENGTH: Final = 63
"""Numbers of a hand: u, v and visibility of 21 keypoints."""

KEYS: Final = {"keypoints": None, "lefthand_kpts": "left", "righthand_kpts": "right"}
"""Keys of an annotation that hold hands, and the side that each key implies."""

BOXES: Final = {
    "keypoints": "bbox", "lefthand_kpts": "lefthand_box", "righthand_kpts": "righthand_box",
}  # fmt: skip
"""Key of the box for each of `KEYS`: left, top, width and height."""

WHOLE_BODIES: Final = {3 * 133: 91, 3 * 136: 94}
"""Length of a body's keypoint list → index of its left hand's first keypoint; the right hand follows."""


@dataclass(frozen=True)
class _Hand:
    """One hand of an annotation."""

    numbers: list[Any]
    side: str | None
    name: str
    box: list[Any] | None = None
    image: str | None = None


def is_coco(content: object) -> bool:
    """True if JSON content is an annotation file of COCO or a list of results."""
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
        ValueError: No annotation has a hand, or one has another number of keypoints than are known.
    """
    whole = content if isinstance(content, dict) else {"annotations": content}
    images = {entry.get("id"): entry.get("file_name") for entry in whole.get("images", [])}
    categories = {
        entry.get("id"): str(entry.get("name", "")) for entry in whole.get("categories", [])
    }
    sizes = {
        entry.get("id"): (entry.get("width"), entry.get("height"))
        for entry in whole.get("images", [])
    }
    hands: list[_Hand] = []
    sizes_of_hands: list[tuple[Any, Any]] = []
    for annotation in whole["annotations"]:
        image = _image(images, annotation.get("image_id"))
        category = categories.get(annotation.get("category_id"), "")
        found = _hands_of(path, annotation, image, category)
        hands += found
        sizes_of_hands += [sizes.get(annotation.get("image_id"), (None, None))] * len(found)
    if not hands:
        raise ValueError(
            f"{path}: none of {len(whole['annotations'])} annotations has a hand; expected `keypoints` of "
            f"{LENGTH} numbers, COCO-WholeBody's `lefthand_kpts` and `righthand_kpts` marked as valid, or "
            "the 133 or 136 keypoints of a body."
        )
    try:
        numbers = np.array([hand.numbers for hand in hands], dtype=np.float64).reshape(-1, 21, 3)
        boxes = _boxes(hands)
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path}: a keypoint or a box is not a number ({error}).") from error
    points, score = numbers[..., :2].copy(), numbers[..., 2]
    points[score == 0] = np.nan
    return ParsedHands(
        points=points,
        confidence=_confidence(path, score),
        sides=[hand.side for hand in hands],
        names=[hand.name for hand in hands],
        images=[hand.image for hand in hands],
        boxes=boxes,
        # Many files only mark that a keypoint is there, by 1.
        occluded=score == 1 if _are_visibilities(score) and (score == 2).any() else None,
        image_sizes=to_image_sizes(sizes_of_hands),
    )  # fmt: skip


def _image(images: dict[Any, Any], identity: object) -> str | None:
    """File name of an image; lists of results such as AlphaPose's have the name instead of a number."""
    named = images.get(identity, identity if isinstance(identity, str) else None)
    return None if named is None else str(named)


def _hands_of(
    path: Path, annotation: dict[str, Any], image: str | None, category: str
) -> list[_Hand]:
    """The hands of one annotation; those that it marks as not valid are left out."""
    identity = f"annotation {annotation.get('id', annotation.get('image_id'))}"
    called = image or identity
    hands = []
    for key, side in KEYS.items():
        numbers = _flat(annotation.get(key))
        if not numbers or not annotation.get(f"{key.removesuffix('_kpts')}_valid", True):
            continue
        if side is None and len(numbers) != LENGTH and any(annotation.get(k) for k in _HAND_KEYS):
            # In COCO-WholeBody, `keypoints` are those of the body.
            continue
        if side is None and len(numbers) in WHOLE_BODIES:
            hands += _hands_of_body(numbers, called, image)
            continue
        if len(numbers) != LENGTH:
            raise ValueError(
                f"{path}: {key} of {identity} has {len(numbers)} numbers, expected {LENGTH}: u, v and "
                "visibility of 21 keypoints (or the 133 or 136 keypoints of a body)."
            )
        box = annotation.get(BOXES[key])
        if side is None:
            side_found = _side(f"{path}: {identity}", annotation, category)
            hands.append(_Hand(numbers, side_found, called, box, image))
        else:
            hands.append(_Hand(numbers, side, f"{called} {side}", box, image))
    return hands


_HAND_KEYS: Final = tuple(key for key, side in KEYS.items() if side is not None)


def _hands_of_body(numbers: list[Any], called: str, image: str | None) -> list[_Hand]:
    """Hands with at least one keypoint among the keypoints of a body; the body's box is not used."""
    start = 3 * WHOLE_BODIES[len(numbers)]
    found = {
        "left": numbers[start : start + LENGTH],
        "right": numbers[start + LENGTH : start + 2 * LENGTH],
    }
    return [
        _Hand(hand, side, f"{called} {side}", image=image)
        for side, hand in found.items()
        if any(hand[2::3])
    ]


def _flat(numbers: Any) -> list[Any]:  # noqa: ANN401  # any JSON
    """Keypoints as one flat list; some files have one list per keypoint."""
    if isinstance(numbers, list) and numbers and all(isinstance(row, list) for row in numbers):
        return [number for row in numbers for number in row]
    return numbers or []


def _boxes(hands: list[_Hand]) -> np.ndarray | None:
    """Left, top, right and bottom, pixels; NaN for hands without a box."""
    if all(hand.box is None for hand in hands):
        return None
    rows = [hand.box or [None] * 4 for hand in hands]
    boxes = np.array(rows, dtype=np.float64).reshape(len(hands), 4)
    # A box of zero size, which stands for no box, keeps zero size.
    boxes[:, 2:] += boxes[:, :2]
    return boxes


def _side(where: str, annotation: dict[str, Any], category: str) -> str | None:
    """Side from the annotation, else from its category's name."""
    given = read_side(where, annotation.get("side", annotation.get("handedness")))
    named = [side for side in ("left", "right") if side in category.lower()]
    return given or (named[0] if len(named) == 1 else None)


def _are_visibilities(score: np.ndarray) -> bool:
    return bool(np.isin(score, (0, 1, 2)).all())


def _confidence(path: Path, score: np.ndarray) -> np.ndarray | None:
    """Scores from 0 to 1; None where the numbers are visibilities, which say nothing about precision."""
    if _are_visibilities(score):
        return None
    if (score > 1).any():
        logger.info("%s: scores above 1 are read as 1.", path)
    return score.clip(max=1.0)
