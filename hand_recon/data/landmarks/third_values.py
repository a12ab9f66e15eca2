"""Meaning of a landmark's third number that a file does not name: confidence, σ, visibility or depth.

The numbers of the whole file decide, not single outliers (decision 57).
"""

import logging
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

logger = logging.getLogger(__name__)

MEANINGS: Final = ("auto", "confidence", "sigma", "ignore")
"""Possible meanings of the third value of a point."""

SCORE_LIMIT: Final = 1.5
"""Upper limit of scores that are not bounded by 1: RTMPose's peaks reach about 1.2."""

WITHIN: Final = 0.95
"""Least share of numbers in [0, 1] by which all are confidences, whatever the others are."""

DOUBTFUL_SIGMA: Final = 0.25
"""Median of σ over the longer side of the hand's box above which σ tells nothing about the hand."""

LARGEST_SIGMA: Final = 1.0
"""The same median above which a file whose σ are named is refused, too."""

DEPTH_SPREAD: Final = 0.15
"""Range of the third values of a hand below which they may be depths in metres."""

DEEPEST: Final = 250.0
"""Largest range of depths within a hand, and least depth of a hand before a camera, mm."""

PERCENT: Final = 50.0
"""Median above which numbers up to 100 are scores in percent and no σ."""

Values = Float[np.ndarray, "hand landmark=21"]


def interpret(
    path: Path, points: Float[np.ndarray, "hand landmark=21 2"], values: Values, meaning: str
) -> tuple[str, Values]:
    """Decide what the third values are.

    Args:
        path: The file, for messages.
        points: Landmarks, pixels; NaN where missing or a placeholder.
        values: Third values; NaN where there are none.
        meaning: One of `MEANINGS`.

    Returns:
        `confidence`, `sigma` or `ignore`, and the values: those of visibilities become confidences.

    Raises:
        ValueError: They can be neither confidences nor σ in pixels, and `meaning` is `auto`.
    """
    seen = np.where(np.isfinite(points).all(axis=-1), values, np.nan)
    if meaning != "auto":
        return meaning, values
    numbers = seen[~np.isnan(seen)]
    if not len(numbers) or _are_visibilities(numbers):
        return _as_visibilities(path, values, numbers)
    if _is_relative_depth(seen):
        logger.warning(
            "%s: the third values are 0 at one landmark of every hand alone: a depth relative to that "
            "landmark, such as MediaPipe's z, and no confidence. They are left out; third_value=ignore says "
            "the same, third_value=confidence or third_value=sigma uses them.", path,
        )  # fmt: skip
        return "ignore", values
    if are_scores(numbers):
        _say_confidences(path, seen, numbers)
        return "confidence", values
    _refuse_what_is_no_sigma(path, points, values, numbers)
    logger.info(
        "%s: the third values do not lie in [0, 1] and are read as standard deviations in pixels; set "
        "third_value=confidence or third_value=ignore if they are something else.", path,
    )  # fmt: skip
    return "sigma", values


def _say_confidences(path: Path, seen: Values, numbers: Float[np.ndarray, " number"]) -> None:
    whole = seen[np.isfinite(seen).all(axis=1)]
    varied = np.ptp(whole, axis=1) if len(whole) else np.zeros(1)
    # Depths in metres lie close together within a hand; scores do not, and the best are near 1.
    like_depths = 0 < float(np.median(varied)) < DEPTH_SPREAD and numbers.max() < 0.95
    logger.log(
        logging.WARNING if like_depths else logging.INFO,
        "%s: the third values %s in [0, 1] and are read as confidences%s; set third_value=sigma or "
        "third_value=ignore if they are something else.",
        path,
        "all lie" if numbers.max() <= 1 else "lie for the most part",
        ", although they hardly vary within a hand, as depths in metres" if like_depths else "",
    )


def are_scores(numbers: Float[np.ndarray, " number"]) -> bool:
    """True for numbers from 0 to 1, but for a few outliers, and for scores that exceed 1 a little."""
    if not len(numbers) or numbers.min() < -1:
        return False
    within = float(((numbers >= 0) & (numbers <= 1)).mean())
    if float((numbers < 0).mean()) > 1 - WITHIN:
        return False
    return within >= WITHIN or (within >= 0.25 and float(numbers.max()) < SCORE_LIMIT)


def clipped_scores(path: Path, confidence: Values) -> Values:
    """Confidences with those above 1 set to 1 and those below 0 set to 0, and a note of their number.

    Numbers that are no scores (`are_scores`) are returned as they are.
    """
    numbers = confidence[~np.isnan(confidence)]
    if not are_scores(numbers):
        return confidence
    above, below = int((numbers > 1).sum()), int((numbers < 0).sum())
    if above:
        logger.info(
            "%s: %d of %d confidences are above 1 (the largest is %.4g) and are read as 1.",
            path, above, len(numbers), float(numbers.max()),
        )  # fmt: skip
    if below:
        logger.info(
            "%s: %d of %d confidences are negative and are read as 0, a missing landmark.",
            path, below, len(numbers),
        )  # fmt: skip
    return confidence.clip(0.0, 1.0)


def check_sigma_size(
    path: Path, points: Float[np.ndarray, "hand landmark=21 2"], sigma: Values
) -> None:
    """Compare σ that a file or an option names with the size of the hands.

    Raises:
        ValueError: σ is larger than the hands themselves.
    """
    relative = _relative_to_hand(points, sigma)
    if relative is None or relative <= DOUBTFUL_SIGMA:
        return
    found = f"{path}: the standard deviations (σ) are {relative:.3g} times their hand's size in the median"
    if relative > LARGEST_SIGMA:
        raise ValueError(
            f"{found}; expected are pixels, a few percent of a hand. If they are depths or in another unit, "
            "leave them out or set third_value=ignore."
        )
    logger.warning("%s, so that the landmarks hardly count.", found)


def _as_visibilities(
    path: Path, values: Values, numbers: Float[np.ndarray, " number"]
) -> tuple[str, Values]:
    """Confidence 0 where COCO's visibility is 0, none elsewhere."""
    if not len(numbers):
        return "ignore", values
    logger.info(
        "%s: the third values are 0, 1 and 2 and are read as COCO's visibility, in which 0 is a missing "
        "landmark; set third_value=sigma if they are standard deviations.", path,
    )  # fmt: skip
    return "confidence", np.where(values == 0, 0.0, np.nan)


def _are_visibilities(numbers: Float[np.ndarray, " number"]) -> bool:
    distinct = set(np.unique(numbers).tolist())
    return 2.0 in distinct and len(distinct) > 1 and distinct <= {0.0, 1.0, 2.0}


def _is_relative_depth(values: Values) -> bool:
    """True if one landmark's number is 0 in every hand, and the others' are not those of confidences."""
    whole = values[np.isfinite(values).all(axis=1)]
    if not len(whole):
        return False
    scale = np.abs(whole).max(axis=1, keepdims=True)
    zero = np.abs(whole) <= 1e-4 * scale
    always = zero.all(axis=0)
    if not (scale > 0).all() or always.sum() != 1 or zero[:, ~always].mean() > 0.1:
        return False
    others = whole[:, ~always]
    return bool(others.min() < 0 or others.max() < 0.5 or others.max() > SCORE_LIMIT)


def _refuse_what_is_no_sigma(
    path: Path,
    points: Float[np.ndarray, "hand landmark=21 2"],
    values: Values,
    numbers: Float[np.ndarray, " number"],
) -> None:
    """Raise an error for numbers that can be neither confidences nor standard deviations.

    Raises:
        ValueError: They are depths, scores in percent, or larger than a σ of a hand can be.
    """
    ends = (
        "Leave the third number out or set third_value=ignore; third_value=sigma says that they are standard "
        "deviations in pixels."
    )
    span = f"{path}: the third values go from {numbers.min():.4g} to {numbers.max():.4g}"
    if numbers.min() <= 0 or np.isinf(numbers).any():
        raise ValueError(
            f"{span}: they are no confidences from 0 to 1, and a σ that is not positive and finite is none. "
            "A depth, such as MediaPipe's z, is neither: leave the third number out, or set "
            "third_value=ignore."
        )
    median = float(np.median(numbers))
    relative = _relative_to_hand(points, values)
    if relative is not None and relative > DOUBTFUL_SIGMA:
        ranges = [np.ptp(row[~np.isnan(row)]) for row in values if not np.isnan(row).all()]
        depths = median > DEEPEST and float(np.median(ranges)) < DEEPEST
        what = "look like depths in mm" if depths else "are no standard deviations in pixels"
        raise ValueError(
            f"{span}, {relative:.3g} times the size of their hand in the median, and {what}. {ends}"
        )
    if median > PERCENT and numbers.max() <= 100 and numbers.min() >= 0:
        raise ValueError(
            f"{span} with a median of {median:.4g}, and look like scores in percent. Divide them by 100. "
            f"{ends}"
        )


def _relative_to_hand(
    points: Float[np.ndarray, "hand landmark=21 2"], sigma: Values
) -> float | None:
    """Median of σ over the longer side of its hand's box; None if no hand has four landmarks."""
    there = np.isfinite(points).all(axis=-1)
    hands = there.sum(axis=1) >= 4
    if not hands.any():
        return None
    shown = np.where(there[..., None], points, np.nan)[hands]
    size = (np.nanmax(shown, axis=1) - np.nanmin(shown, axis=1)).max(axis=-1)
    ratios = np.abs(sigma[hands][size > 0]) / size[size > 0, None]
    known = ratios[there[hands][size > 0] & np.isfinite(ratios)]
    return float(np.median(known)) if len(known) else None
