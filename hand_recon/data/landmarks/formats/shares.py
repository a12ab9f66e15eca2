"""Coordinates in shares of the image's size, as MediaPipe gives them, converted to pixels (decision 56)."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from hand_recon.data.landmarks.image_paths import located_images
from hand_recon.data.landmarks.image_sizes import sizes_of_images
from hand_recon.data.landmarks.parsed import ParsedHands
from hand_recon.data.landmarks.placeholders import at_placeholders
from hand_recon.data.landmarks.refusal import refuse

LARGEST: Final = 2.0
"""Largest coordinate that is read as a share; a hand reaches out of its image, but not by a whole image."""

_NEGATIVE: Final = 0.25
"""Share of negative coordinates above which they are relative to a point of the hand."""


def shares_to_pixels(
    path: Path, parsed: ParsedHands, root: Path, image_size: tuple[float, float] | None = None
) -> ParsedHands:
    """Multiply coordinates that are shares by the size of their image; pixels are returned as they are.

    The size is that in the file, else that of the image file, else `image_size`. Third values that are
    negative are depths, and are left out.

    Args:
        path: The landmark file.
        parsed: Its contents.
        root: Folder of its images.
        image_size: Width and height in pixels.

    Raises:
        ValueError: The size of an image is not known, or coordinates are relative to a point of the hand.
    """
    if not _are_shares(path, parsed):
        return parsed
    sizes = _sizes(path, parsed, root, image_size)
    unknown = np.isnan(sizes).any(axis=1)
    if unknown.any():
        largest = np.nanmax(np.abs(parsed.points))
        refuse(
            path, unknown,
            f"landmarks within ±{largest:.3g}, which are shares of the image's size, as MediaPipe gives "
            "them, and not pixels, of images of unknown size. Set image_size=[width,height], write `width` "
            "and `height`, or `image` for an image beside it, into the file, or multiply u by the image's "
            "width and v by its height.",
        )  # fmt: skip
    # (0, 0) and (−1, −1) keep their values, by which they are found to be missing.
    nowhere = at_placeholders(parsed.points)
    third = parsed.third_value
    if third is not None and (third[~nowhere] < 0).any():
        third = None
    of_size = {f"{width:g} × {height:g}" for width, height in sizes.tolist()}
    spoken = of_size.pop() if len(of_size) == 1 else f"{len(of_size)} sizes"
    return dataclasses.replace(
        parsed,
        points=np.where(nowhere[..., None], parsed.points, parsed.points * sizes[:, None]),
        third_value=third,
        image_sizes=sizes,
        title=f"{parsed.title or 'hands'} in shares of images of {spoken}",
    )


def _are_shares(path: Path, parsed: ParsedHands) -> bool:
    labelled = _labelled(parsed)
    coordinates = parsed.points[labelled]
    largest = np.abs(coordinates).max(initial=0.0)
    if not 0 < largest <= LARGEST:
        return False
    if (coordinates < 0).mean() > _NEGATIVE:
        raise ValueError(
            f"{path}: all coordinates lie within ±{largest:.3g} and many are negative: they are relative to "
            "a point of the hand, as 3D points in metres are (MediaPipe's world landmarks), and are not in "
            "the image. Give 2D landmarks in pixels, or project the points with the camera."
        )
    return True


def _labelled(parsed: ParsedHands) -> Bool[np.ndarray, "hand landmark=21"]:
    labelled = np.isfinite(parsed.points).all(axis=-1)
    return labelled if parsed.confidence is None else labelled & ~(parsed.confidence == 0)


def _sizes(
    path: Path, parsed: ParsedHands, root: Path, image_size: tuple[float, float] | None
) -> Float[np.ndarray, "hand 2"]:
    """Width and height of each hand's image; NaN where they are not known."""
    written: Sequence[str | None] = parsed.images or (None,) * len(parsed.points)
    files = located_images(path, root, written)
    sizes = sizes_of_images(files, parsed.image_sizes, len(parsed.points))
    return np.where(np.isnan(sizes), image_size or np.nan, sizes)
