"""Warns of hands whose landmarks lie outside of their images."""

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from hand_recon.data.landmarks.image_sizes import stored_size, upright_size

logger = logging.getLogger(__name__)

LOOKED_AT: Final = 64
"""Number of image files whose size is looked up where the landmark file does not give it."""

Points = Float[np.ndarray, "hand landmark=21 2"]
Sizes = Float[np.ndarray, "hand 2"]


def known_sizes(images: Sequence[Path | None], given: Sizes | None, hands: int) -> Sizes:
    """Width and height of each hand's image; of some hands evenly spaced where only the files tell it.

    Args:
        images: Image file of each hand; empty if there are none.
        given: Sizes that the landmark file gives, pixels; NaN where it does not.
        hands: Number of hands.
    """
    sizes = np.full((hands, 2), np.nan) if given is None else given.astype(np.float64)
    if not images:
        return sizes
    for hand in np.unique(np.linspace(0, hands - 1, LOOKED_AT).round().astype(int)):
        image = images[hand]
        stored = None if image is None or np.isfinite(sizes[hand]).all() else stored_size(image)
        if stored is not None:
            sizes[hand] = upright_size(stored)
    return sizes


def warn_of_hands_outside(path: Path, points: Points, sizes: Sizes) -> None:
    """Warn of hands of which most landmarks lie outside of the image, and name a likely cause.

    Args:
        path: The landmark file, for the message.
        points: Landmarks, pixels; NaN where missing.
        sizes: Width and height of each hand's image, pixels; NaN where unknown.
    """
    outside = _mostly_outside(points, sizes)
    if not outside.any():
        return
    hand = int(np.flatnonzero(outside)[0])
    if not _mostly_outside(points, sizes[:, ::-1])[outside].any():
        cause = "They would lie inside if width and height were exchanged: is the image rotated?"
    elif not _mostly_outside(points[..., ::-1], sizes)[outside].any():
        cause = "They would lie inside if u and v were exchanged."
    else:
        cause = "Are the landmarks in pixels of another image size?"
    logger.warning(
        "%s: of %d of %d hands, most landmarks lie outside of the image; the first is hand %d around "
        "(%.4g, %.4g) in an image of %g × %g pixels. %s",
        path, int(outside.sum()), len(outside), hand, *np.nanmedian(points[hand], axis=0), *sizes[hand],
        cause,
    )  # fmt: skip


def _mostly_outside(points: Points, sizes: Sizes) -> Bool[np.ndarray, " hand"]:
    there = np.isfinite(points).all(axis=-1)
    beyond = there & ((points < 0) | (points > sizes[:, None])).any(axis=-1)
    known = np.isfinite(sizes).all(axis=-1) & there.any(axis=1)
    return np.asarray(known & (2 * beyond.sum(axis=1) > there.sum(axis=1)))
