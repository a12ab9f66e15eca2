"""Table of annotated hands from images with 2D landmarks only, the method's training data (Sec. 3.3).

COCO keypoints, JSON lists, CSV (`hand_recon.data.landmarks.files`) or a folder of HInt
(`hand_recon.data.landmarks.hint`) become one table of annotated images.
"""

import logging
import re
from pathlib import Path
from typing import Final

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hand_recon.data.annotations import AnnotatedHands
from hand_recon.data.cache import digest, file_identity
from hand_recon.data.images import read_image
from hand_recon.data.landmarks.image_landmarks import FEWEST, ImageLandmarks, boxes
from hand_recon.data.landmarks.image_orientation import to_upright
from hand_recon.data.landmarks.image_paths import searched_places
from hand_recon.data.landmarks.image_sizes import stored_size

logger = logging.getLogger(__name__)

WHOLE: Final = 16
"""Number of labelled landmarks whose box counts as the hand's: at most one finger and a joint are missing."""

CHECKED_IMAGES: Final = 16
"""Number of images that are opened to check that the landmarks lie inside."""


def annotate(landmarks: ImageLandmarks, root: Path, around: str, min_side: float) -> AnnotatedHands:
    """Table of the hands that are usable for training; the number left out is logged.

    Args:
        landmarks: Landmarks of any hands, each with its image.
        root: The folder that the names of samples and of the table are relative to.
        around: `joints` puts the box of the labelled landmarks into the table, `box` the dataset's own
            (`hand_frames`).
        min_side: Hands whose box is smaller are left out, pixels of the image.

    Raises:
        FileNotFoundError: None of the images is there.
        ValueError: A hand has no image, no hand is left, most landmarks lie outside their images, or most
            images have another size than their file says.
    """
    images = _images(landmarks, root)
    landmarks = to_upright(landmarks, root)
    frames = hand_frames(landmarks, around)
    kept = _usable_for_training(landmarks, frames, min_side, root).numpy()
    chosen = landmarks.select(torch.from_numpy(kept))
    rows = np.flatnonzero(kept)
    frames = frames[torch.from_numpy(kept)]
    shown = [images[row] for row in rows]
    left = chosen.left.numpy()
    columns = (chosen.landmarks_2d, frames, chosen.left, chosen.intrinsics, chosen.sigma,
               chosen.confidence, chosen.occluded)  # fmt: skip
    table = AnnotatedHands(
        name=f"landmarks-{re.sub(r'[^A-Za-z0-9_-]+', '-', root.name) or 'hands'}",
        root=root,
        images=shown,
        fingerprint=digest(
            _identity(shown), around, *(None if c is None else c.numpy().tobytes() for c in columns)
        ),
        landmarks_2d=chosen.landmarks_2d.numpy(),
        left=left if left.any() else None,
        intrinsics=_array(chosen.intrinsics),
        boxes=frames.numpy(),
        occluded=_array(chosen.occluded),
        confidence=_array(chosen.confidence),
        label_noise=_array(chosen.sigma),
    )
    _check_size(table)
    return table


def hand_frames(landmarks: ImageLandmarks, around: str) -> Float[Tensor, "hand 4"]:
    """Box that each crop is made around: left, top, right and bottom, pixels of the image.

    Where fewer than `WHOLE` landmarks are labelled, their box may show a single finger: then a dataset's box,
    where there is one, is joined to it. Where there is none, a crop around the box is one around the labels.

    Args:
        landmarks: Landmarks of any hands.
        around: `box` takes the dataset's box wherever there is one, else that of the landmarks is taken.
    """
    low, high = boxes(landmarks)
    labels = torch.cat([low, high], dim=-1)
    if landmarks.hand_boxes is None:
        return labels
    drawn = torch.where(landmarks.hand_boxes.isnan(), labels, landmarks.hand_boxes)
    if around == "box":
        return drawn
    joined = torch.cat(
        [torch.minimum(drawn[:, :2], low), torch.maximum(drawn[:, 2:], high)], dim=-1
    )
    whole = landmarks.labelled.sum(dim=-1, keepdim=True) >= WHOLE
    return torch.where(whole, labels, joined)


def scene(image: Path) -> str:
    """Name of an image that must stay in one split: its path without HInt's `_l` or `_r`."""
    return str(image.with_name(re.sub(r"_[lr]$", "", image.stem)))


def _images(landmarks: ImageLandmarks, root: Path) -> list[Path]:
    images = [image for image in landmarks.images if image is not None]
    if len(images) < len(landmarks):
        raise ValueError(
            f"{root}: {len(landmarks) - len(images)} of {len(landmarks)} hands name no image. To train "
            "on images, each hand needs one: `image` in JSON and CSV, `image_id` and `images` in COCO."
        )
    distinct = set(images)
    missing = sorted(image for image in distinct if not image.is_file())
    if len(missing) == len(distinct):
        raise FileNotFoundError(
            f"None of {len(distinct)} images is there; the first was looked for at "
            f"{', '.join(_searched(missing[0], root))}. Name their folder with data.images, or correct the "
            "names in the file."
        )
    if missing:
        logger.warning(
            "%d of %d images are not there and count like damaged ones; the first is %s.",
            len(missing), len(distinct), missing[0],
        )  # fmt: skip
    return images


def _searched(image: Path, root: Path) -> list[str]:
    """Places at which a missing image was looked for."""
    written = str(image.relative_to(root)) if image.is_relative_to(root) else str(image)
    return searched_places(root, written)


def _usable_for_training(
    landmarks: ImageLandmarks, frames: Float[Tensor, "hand 4"], min_side: float, root: Path
) -> Bool[Tensor, " hand"]:
    enough = landmarks.usable
    tiny = enough & ((frames[:, 2:] - frames[:, :2]).amax(dim=-1) < min_side)
    kept = enough & ~tiny
    if not kept.all():
        logger.warning(
            "%s: %d of %d hands are left out: %d have fewer than %d labelled landmarks (or all in one "
            "place), %d are smaller than min_side=%g pixels.",
            root, int((~kept).sum()), len(kept), int((~enough).sum()), FEWEST, int(tiny.sum()), min_side,
        )  # fmt: skip
    if not kept.any():
        raise ValueError(
            f"{root}: none of {len(kept)} hands can be trained on; each needs {FEWEST} labelled landmarks "
            f"and min_side={min_side:g} pixels of its image."
        )
    return kept


def _identity(images: list[Path]) -> str:
    """Digest that changes when an image changes."""
    distinct = sorted(set(images))
    known = {path: file_identity(path) if path.is_file() else str(path) for path in distinct}
    return digest([known[path] for path in images])


def _array(column: Tensor | None) -> np.ndarray | None:
    return None if column is None else column.numpy()


def _check_size(table: AnnotatedHands) -> None:
    """Refuse landmarks most of which lie outside their images, and so belong to another image size.

    Raises:
        ValueError: More than half of the checked hands lie outside.
    """
    seen, outside, lying = 0, 0, 0
    for row in np.unique(np.linspace(0, len(table) - 1, CHECKED_IMAGES).round().astype(int)):
        image = read_image(table.images[row])
        if image is None or table.boxes is None:
            continue
        middle = table.boxes[row].reshape(2, 2).mean(axis=0)
        size = np.array(image.shape[1::-1])
        seen += 1
        if ((middle < 0) | (middle > size)).any():
            outside += 1
            stored = stored_size(table.images[row])
            rotated = stored is not None and stored[2] >= 5
            lying += bool(rotated and ((middle >= 0) & (middle <= size[::-1])).all())
    if outside > seen / 2 or (lying and lying == outside):
        cause = (
            "They lie inside the images as these are stored, before EXIF's orientation rotates them: rotate "
            "the labels, or save the images upright and without EXIF's orientation, or give `width` and "
            "`height` of the stored images in the file."
            if lying == outside
            else "Landmarks must be in pixels of the images as they are on the disk, not of resized ones."
        )
        raise ValueError(
            f"{table.root}: {outside} of {seen} hands that were checked lie outside their images. {cause}"
        )
