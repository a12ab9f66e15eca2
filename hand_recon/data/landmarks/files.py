"""Reads 2D landmarks of hands from a file; the format is recognized by the content.

Points are pixels of the image, 21 per hand in FreiHAND's order (`hand_recon.hand.skeleton.LANDMARKS`) unless
another is named. Pixel i covers [i, i + 1), so a detector that counts from pixel centres is half a pixel off.

JSON, or JSON lines with one hand or one frame on each line
    A list of N hands of 21 points, each `[u, v]`, `[u, v, c]` or `null` if it is missing; `c` is a
    confidence or σ in pixels, which applies to the whole file. One hand alone need not be nested. A hand that
    was not found is `null`. A list of such lists is a list of frames.

    A list of N objects (or one) with more fields: `landmarks` as above and, optionally, `side` (or
    `handedness`), `image`, `name`, `intrinsics` (or `K`), `confidence` and `sigma` (21 numbers each;
    σ also as 21 pairs), `box` (left, top, right, bottom) and `occluded` (21 true or false). Other keys are
    ignored with a warning. The files of reconstructed hands are such lists.

    COCO's keypoint format (`hand_recon.data.landmarks.coco`), and the files of other tools
    (`hand_recon.data.landmarks.formats`; docs/landmark_files.md has a table).

CSV
    One row per hand or one per landmark (`hand_recon.data.landmarks.csv_table`), or DeepLabCut's.

XML, .pose, .npy, .txt
    CVAT's annotations; the files of pose-format; one array of hands × 21 × 2 or 3; YOLO's labels.

A folder
    Such files of one form, one for each image, as OpenPose and LabelMe write them.

A landmark whose confidence is 0 is missing: detectors write (0, 0, 0) for what they did not find. Coordinates
that are shares of the image's size are multiplied by it where it is known (decision 56).
"""

import dataclasses
import logging
import os
from pathlib import Path
from typing import Any, Final

import numpy as np

from hand_recon.data.landmarks.cameras import with_cameras
from hand_recon.data.landmarks.csv_table import parse_csv
from hand_recon.data.landmarks.formats.content import to_json, to_text
from hand_recon.data.landmarks.formats.cvat import parse_cvat
from hand_recon.data.landmarks.formats.deeplabcut import is_deeplabcut, parse_deeplabcut
from hand_recon.data.landmarks.formats.folders import parse_folder
from hand_recon.data.landmarks.formats.found import NoHandsError
from hand_recon.data.landmarks.formats.point_lists import is_point
from hand_recon.data.landmarks.formats.pose_file import is_pose_file, parse_pose_file
from hand_recon.data.landmarks.formats.registry import json_format_of
from hand_recon.data.landmarks.formats.shares import shares_to_pixels
from hand_recon.data.landmarks.formats.ultralytics import is_yolo_labels, parse_yolo_labels
from hand_recon.data.landmarks.image_landmarks import FEWEST, ImageLandmarks
from hand_recon.data.landmarks.image_orientation import upright_without_camera
from hand_recon.data.landmarks.json_lists import objects_in, parse_objects, parse_points
from hand_recon.data.landmarks.parsed import Assumptions, ParsedHands, to_image_landmarks
from hand_recon.data.landmarks.points_in_space import refuse_points_in_space
from hand_recon.data.landmarks.refusal import refuse
from hand_recon.reading.archives import load_array
from hand_recon.reading.naming import naming
from hand_recon.reading.text import read_bytes

logger = logging.getLogger(__name__)

LARGEST_IMAGE: Final = 1e7
"""Coordinate that no pixel of an image reaches."""


def read_landmarks(
    path: str | Path,
    intrinsics: str | Path | None = None,
    assumed: Assumptions | None = None,
    image_size: tuple[float, float] | None = None,
) -> ImageLandmarks:
    """Landmarks of N hands.

    Args:
        path: JSON or CSV, or another tool's file, see above; or a folder of them, one for each image.
        intrinsics: Camera matrices of the images, one or one per hand; they override those in the file.
        assumed: Assumed values of what the file does not specify.
        image_size: Width and height of the images in pixels, for landmarks in shares of it where neither
            the file nor an image beside it tells the size.

    Raises:
        FileNotFoundError: A file is missing.
        ValueError: A file cannot be parsed, or its numbers cannot be landmarks or cameras.
    """
    path = Path(os.path.expanduser(path))
    assumed = assumed or Assumptions()
    if path.is_dir() and assumed.images is None:
        assumed = dataclasses.replace(assumed, images=path)
    with naming(path, "landmarks of hands"):
        parsed = parse_folder(path, parse_file) if path.is_dir() else parse_file(path)
    if len(parsed.points):
        _refuse_huge(path, parsed)
        refuse_points_in_space(path, parsed.points, parsed.third_value)
        parsed = shares_to_pixels(path, parsed, assumed.images or path.parent, image_size)
    landmarks = to_image_landmarks(path, parsed, _order_of_file(path, parsed, assumed))
    landmarks = upright_without_camera(_with_cameras(path, landmarks, intrinsics), path)
    _tell(path, parsed, landmarks)
    poor = [name for name, good in zip(landmarks.names, landmarks.usable, strict=True) if not good]
    if poor:
        logger.warning(
            "%s: %d of %d hands have fewer than %d labelled landmarks, or all in one place; the first: %s.",
            path, len(poor), len(landmarks), FEWEST, poor[:5],
        )  # fmt: skip
    return landmarks


def parse_file(path: Path) -> ParsedHands:
    """Unchecked contents of a landmark file of any known format.

    Args:
        path: The file; its ending is of no account.

    Raises:
        FileNotFoundError: It is missing.
        ValueError: It is of no known format, or not what its format has.
    """
    if not path.is_file():
        raise FileNotFoundError(
            f"No landmarks at {path}. Give a JSON list of hands of 21 points [u, v], COCO keypoints or CSV."
        )
    content = read_bytes(path)
    if is_pose_file(content):
        return parse_pose_file(path, content)
    if content.startswith(b"\x93NUMPY"):
        return _parse_array(path, content)
    text = to_text(path, content)
    start = text.lstrip()
    if start.startswith(("[", "{")):
        return _parse_json(path, text)
    if start.startswith("<"):
        return parse_cvat(path, text)
    if is_yolo_labels(text):
        return parse_yolo_labels(path, text)
    return parse_deeplabcut(path, text) if is_deeplabcut(text) else parse_csv(path, text)


def _parse_json(path: Path, text: str) -> ParsedHands:
    content, lines = to_json(path, text)
    try:
        return _parse_content(path, content)
    except ValueError as error:
        if not lines or isinstance(error, NoHandsError):
            raise
        raise ValueError(f"{error} The file was read as JSON lines.") from error


def _parse_content(path: Path, content: Any) -> ParsedHands:  # noqa: ANN401  # any JSON
    form = json_format_of(content)
    if form is not None:
        return form.parse(path, content)
    unnested = _objects_of_frames(content)
    if unnested:
        return _parse_content(path, unnested)
    if isinstance(content, dict):
        content = (
            content["hands"]
            if isinstance(content.get("hands"), list)
            else objects_in(path, content)
        )
    if not isinstance(content, list) or not content:
        raise ValueError(f"{path} holds no hands; expected one or more, of 21 points each.")
    if any(isinstance(entry, dict) and not is_point(entry) for entry in content):
        return parse_objects(path, content)
    return parse_points(path, content)


def _objects_of_frames(content: object) -> list[dict[str, Any]]:
    """The objects of a list of lists of objects, one list for each frame; empty for anything else."""
    frames = content if isinstance(content, list) else []
    if not all(isinstance(frame, list) for frame in frames):
        return []
    entries = [entry for frame in frames for entry in frame]
    are_objects = all(isinstance(entry, dict) and not is_point(entry) for entry in entries)
    return entries if are_objects else []


def _parse_array(path: Path, content: bytes) -> ParsedHands:
    array = load_array(content, path)
    shape = array.shape[-2:] if array.ndim in {2, 3} else ()
    if array.dtype.kind not in "fiu" or shape not in {(21, 2), (21, 3)}:
        found = " × ".join(map(str, array.shape))
        raise ValueError(
            f"{path} holds {found} values of type {array.dtype}; expected numbers, hands × 21 × 2 or 3."
        )
    numbers = array.reshape(-1, *shape).astype(np.float64)
    third = numbers[..., 2] if numbers.shape[-1] == 3 else None
    return ParsedHands(points=numbers[..., :2], third_value=third)


def _with_cameras(
    path: Path, landmarks: ImageLandmarks, intrinsics: str | Path | None
) -> ImageLandmarks:
    """The landmarks with the cameras of a file of their own, if one is given."""
    if intrinsics is None:
        return landmarks
    if landmarks.intrinsics is not None:
        logger.warning("%s has camera matrices too; those of %s are used.", path, intrinsics)
    return with_cameras(landmarks, Path(os.path.expanduser(intrinsics)))


def _refuse_huge(path: Path, parsed: ParsedHands) -> None:
    """Refuse numbers that no image has, and that would overflow in what follows."""
    sizes = np.abs(np.where(np.isnan(parsed.points), 0.0, parsed.points)).max(axis=(1, 2))
    refuse(
        path,
        np.isinf(sizes),
        "infinite coordinates; write null for a landmark that is missing.",
    )
    refuse(
        path, sizes > LARGEST_IMAGE,
        f"coordinates beyond {LARGEST_IMAGE:,.0f} pixels; write null for a landmark that is missing.",
    )  # fmt: skip
    if parsed.third_value is not None:
        third = np.abs(np.where(np.isfinite(parsed.third_value), parsed.third_value, 0.0))
        refuse(
            path, third.max(axis=1) > LARGEST_IMAGE,
            f"third values beyond {LARGEST_IMAGE:,.0f}, which are neither confidences nor σ; leave them out.",
        )  # fmt: skip


def _order_of_file(path: Path, parsed: ParsedHands, assumed: Assumptions) -> Assumptions:
    """The assumptions, with the order that the file's names have told instead of the assumed one."""
    if not parsed.in_freihand_order:
        return assumed
    if assumed.order != "freihand":
        logger.warning("%s names its landmarks; order=%s is not used for it.", path, assumed.order)
    return dataclasses.replace(assumed, order="freihand")


def _tell(path: Path, parsed: ParsedHands, landmarks: ImageLandmarks) -> None:
    """Log what a file of another tool was read as, and how many hands of it."""
    if parsed.title is None:
        return
    left = int(landmarks.left.sum())
    counts = [(left, "left"), (len(landmarks) - left, "right")]
    hands = " and ".join(f"{count} {side}" for count, side in counts if count)
    last = counts[1][0] or counts[0][0]
    noun, verb = "hand" if last == 1 else "hands", "is" if len(landmarks) == 1 else "are"
    left_out = f"; left out: {', '.join(parsed.left_out)}" if parsed.left_out else ""
    logger.info("%s: %s; %s %s %s read%s.", path, parsed.title, hands, noun, verb, left_out)
