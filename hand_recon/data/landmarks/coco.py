"""Hands in COCO's keypoint format: 21 keypoints per annotation, or the two hands of a whole body.

Annotation files and lists of results are read alike. COCO-WholeBody keeps hands as `lefthand_kpts` and
`righthand_kpts`, or as the keypoints 91 to 132 of its 133; Halpe-FullBody (Fang et al., TPAMI 2022) as 94 to
135 of 136. mmpose's files of OneHand10K, Panoptic and RHD have one hand per annotation. All of them are in
FreiHAND's order but RHD's own, which goes from tip to base. Where a category names its keypoints, as CVAT's
export does, the names tell the order. Annotations of bodies alone are left out.

The third value of a keypoint is COCO's visibility (0, 1, 2) or a score; 0 is a missing keypoint.
In a file that uses 2 as well, 1 is a keypoint that is labelled but cannot be seen.
"""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Bool, Float

from hand_recon.data.landmarks.formats.found import (
    Reading,
    clipped_scores,
    counts_in_words,
    sizes_of,
    text_of,
)
from hand_recon.data.landmarks.formats.names import landmarks_of_names, side_in
from hand_recon.data.landmarks.formats.point_lists import coordinates_of, is_point
from hand_recon.data.landmarks.formats.whole_body import layout_of, pick
from hand_recon.data.landmarks.parsed import ParsedHands, read_side

logger = logging.getLogger(__name__)

LENGTH: Final = 63
"""Numbers of a hand: u, v and visibility of 21 keypoints."""

KEYS: Final = {"keypoints": None, "lefthand_kpts": "left", "righthand_kpts": "right"}
"""Keys of an annotation that hold hands, and the side that each key implies."""

BOXES: Final = {
    "keypoints": "bbox", "lefthand_kpts": "lefthand_box", "righthand_kpts": "righthand_box",
}  # fmt: skip
"""Key of the box for each of `KEYS`: left, top, width and height."""

_HAND_KEYS: Final = tuple(key for key, side in KEYS.items() if side is not None)


@dataclass(frozen=True)
class _Hand:
    """One hand of an annotation."""

    numbers: Float[np.ndarray, "landmark=21 3"]
    side: str | None
    name: str
    image: Mapping[str, Any]
    box: Float[np.ndarray, " edge=4"] | None = None


@dataclass(frozen=True)
class _Tables:
    """Images and categories of an annotation file, by id."""

    images: Mapping[Any, Mapping[str, Any]]
    categories: Mapping[Any, Mapping[str, Any]]


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
        ValueError: No annotation has a hand, or something else is in the place of numbers.
    """
    of_results = isinstance(content, list)
    reading = Reading(path, "COCO's results" if of_results else "COCO's annotations")
    whole = {"annotations": content} if isinstance(content, list) else content
    tables = _Tables(_by_id(reading, whole, "images"), _by_id(reading, whole, "categories"))
    annotations = reading.objects(whole["annotations"], "`annotations`")
    hands: list[_Hand] = []
    for annotation in annotations:
        hands += _hands_of(reading, annotation, tables)
    if not hands:
        raise _no_hands(reading, annotations)
    _warn_of_unknown_names(reading, tables)
    return _collected(reading, hands)


def _by_id(reading: Reading, whole: Mapping[str, Any], key: str) -> dict[Any, dict[str, Any]]:
    entries = reading.objects(whole.get(key), f"`{key}`")
    return {_key(entry.get("id")): entry for entry in entries}


def _key(identity: object) -> str | int | float | None:
    """An identity as a key; None for what is none."""
    return identity if isinstance(identity, str | int | float) else None


def _hands_of(reading: Reading, annotation: dict[str, Any], tables: _Tables) -> list[_Hand]:
    """The hands of one annotation; those that it marks as not valid are left out."""
    given = _key(annotation.get("image_id"))
    # Lists of results such as AlphaPose's have the file's name instead of a number.
    image = tables.images.get(given, {"file_name": given} if isinstance(given, str) else {})
    identity = f"annotation {_key(annotation.get('id', given))}"
    called = text_of(image.get("file_name")) or identity
    hands = []
    for key in _HAND_KEYS:
        numbers = _keypoints(reading, annotation, key, identity)
        if numbers is None:
            continue
        if not annotation.get(f"{key.removesuffix('_kpts')}_valid", True):
            reading.left_out["hands marked as not valid"] += 1
            continue
        if len(numbers) != 21:
            raise _wrong_count(reading, key, identity, len(numbers))
        box = _box(reading, annotation, key)
        hands.append(_Hand(numbers, KEYS[key], f"{called} {KEYS[key]}", image, box))
    # In COCO-WholeBody's annotations, `keypoints` are those of the body.
    if any(annotation.get(key) for key in _HAND_KEYS):
        return hands
    return _hands_of_keypoints(reading, annotation, tables, image)


def _hands_of_keypoints(
    reading: Reading, annotation: dict[str, Any], tables: _Tables, image: Mapping[str, Any]
) -> list[_Hand]:
    """The hands among `keypoints`; a whole body's must have a keypoint, and its box is not used."""
    identity = f"annotation {_key(annotation.get('id', annotation.get('image_id')))}"
    called = text_of(image.get("file_name")) or identity
    numbers = _keypoints(reading, annotation, "keypoints", identity)
    if numbers is None:
        reading.left_out["annotations without keypoints"] += 1
        return []
    category = tables.categories.get(_key(annotation.get("category_id")), {})
    layout = layout_of(len(numbers), _names(category))
    if layout is None:
        reading.left_out[f"annotations of {len(numbers)} keypoints"] += 1
        return []
    reading.named |= layout.named
    side = _side(f"{reading.path}: {identity}", annotation, str(category.get("name", "")))
    if len(layout.hands) == 1:
        ((named, places),) = layout.hands.items()
        box = _box(reading, annotation, "keypoints") if len(numbers) < 30 else None
        return [_Hand(pick(numbers, places), named or side, called, image, box)]
    found = {named: pick(numbers, places) for named, places in layout.hands.items()}
    return [
        _Hand(hand, named, f"{called} {named}", image)
        for named, hand in found.items()
        if (np.nan_to_num(hand[:, 2]) != 0).any()
    ]


def _keypoints(
    reading: Reading, annotation: dict[str, Any], key: str, identity: str
) -> Float[np.ndarray, "keypoint 3"] | None:
    """Keypoints with their third value; None without any. Some files have one list per keypoint."""
    given = annotation.get(key)
    if not given:
        return None
    if isinstance(given, list) and all(is_point(point) for point in given):
        given = [coordinates_of(point) for point in given]
    try:
        numbers = np.array(given, dtype=np.float64)
    except (ValueError, TypeError, OverflowError) as error:
        raise ValueError(
            f"{reading.path}: a keypoint or a box is not a number ({key} of {identity}: {error!s:.80})."
        ) from error
    if numbers.ndim == 1 and len(numbers) % 3 == 0:
        return numbers.reshape(-1, 3)
    if numbers.ndim == 2 and numbers.shape[1] in {2, 3}:
        return np.pad(numbers, ((0, 0), (0, 3 - numbers.shape[1])), constant_values=np.nan)
    raise _wrong_count(reading, key, identity, numbers.size / 3)


def _wrong_count(reading: Reading, key: str, identity: str, keypoints: float) -> ValueError:
    return ValueError(
        f"{reading.path}: {key} of {identity} has {round(3 * keypoints)} numbers, expected {LENGTH}: u, v "
        "and visibility of 21 keypoints (or the 133 or 136 keypoints of a body)."
    )


def _no_hands(reading: Reading, annotations: Sequence[dict[str, Any]]) -> ValueError:
    for annotation in annotations:
        given = annotation.get("keypoints")
        if given and not any(annotation.get(key) for key in _HAND_KEYS):
            identity = f"annotation {_key(annotation.get('id', annotation.get('image_id')))}"
            numbers = _keypoints(reading, annotation, "keypoints", identity)
            return _wrong_count(
                reading, "keypoints", identity, 0 if numbers is None else len(numbers)
            )
    return ValueError(
        f"{reading.path}: none of {len(annotations)} annotations has a hand; expected `keypoints` of "
        f"{LENGTH} numbers, COCO-WholeBody's `lefthand_kpts` and `righthand_kpts` marked as valid, or "
        "the 133 or 136 keypoints of a body."
    )


def _names(category: Mapping[str, Any]) -> list[str]:
    names = category.get("keypoints")
    return [str(name) for name in names] if isinstance(names, list) else []


def _warn_of_unknown_names(reading: Reading, tables: _Tables) -> None:
    """Warn of names of a hand's keypoints that name no landmark, whose order is then not known."""
    for category in tables.categories.values():
        names = _names(category)
        unknown = [name for name in names if name not in landmarks_of_names(names)]
        if unknown and len(names) == 21:
            logger.warning(
                "%s: the category %r has names of keypoints that name no landmark: %s. %s",
                reading.path, category.get("name"), unknown[:21],
                "These keypoints are left out." if reading.named else
                "The order of the landmarks is taken from the option `order`.",
            )  # fmt: skip


def _box(
    reading: Reading, annotation: dict[str, Any], key: str
) -> Float[np.ndarray, " edge=4"] | None:
    """Left, top, right and bottom, pixels; None for a hand without a box."""
    given = annotation.get(BOXES[key])
    if not given:
        return None
    try:
        box = np.array(given, dtype=np.float64).reshape(4)
    except (ValueError, TypeError, OverflowError) as error:
        raise ValueError(
            f"{reading.path}: a keypoint or a box is not a number ({BOXES[key]}: {error!s:.80})."
        ) from error
    # A box of zero size, which stands for no box, keeps zero size.
    box[2:] += box[:2]
    return box


def _side(where: str, annotation: dict[str, Any], category: str) -> str | None:
    """Side from the annotation, else from its category's name."""
    return read_side(where, annotation.get("side", annotation.get("handedness"))) or side_in(
        category
    )


def _collected(reading: Reading, hands: Sequence[_Hand]) -> ParsedHands:
    numbers = np.stack([hand.numbers for hand in hands])
    points, score = numbers[..., :2].copy(), numbers[..., 2]
    points[score == 0] = np.nan
    return ParsedHands(
        points=points,
        confidence=None if _are_visibilities(score) else clipped_scores(reading.path, score),
        sides=[hand.side for hand in hands],
        names=[hand.name for hand in hands],
        images=[text_of(hand.image.get("file_name")) for hand in hands],
        boxes=_boxes(hands),
        occluded=_occluded(score),
        image_sizes=sizes_of([hand.image for hand in hands]),
        title=reading.title,
        left_out=counts_in_words(reading.left_out),
        in_freihand_order=reading.named,
    )


def _boxes(hands: Sequence[_Hand]) -> Float[np.ndarray, "hand 4"] | None:
    if all(hand.box is None for hand in hands):
        return None
    unknown = np.full(4, np.nan)
    return np.stack([unknown if hand.box is None else hand.box for hand in hands])


def _occluded(
    score: Float[np.ndarray, "hand landmark=21"],
) -> Bool[np.ndarray, "hand landmark=21"] | None:
    # Many files only mark that a keypoint is there, by 1.
    return score == 1 if _are_visibilities(score) and (score == 2).any() else None


def _are_visibilities(score: Float[np.ndarray, "hand landmark=21"]) -> bool:
    return bool((np.isin(score, (0, 1, 2)) | np.isnan(score)).all())
