"""Reads 2D landmarks of hands from a file; the format is recognized by the content.

Points are pixels of the image, 21 per hand in FreiHAND's order (`hand_recon.hand.skeleton.LANDMARKS`) unless
another is named. Pixel i covers [i, i + 1), so a detector that counts from pixel centres is half a pixel off.

JSON
    A list of N hands of 21 points, each `[u, v]`, `[u, v, c]` or `null` if it is missing; `c` is a
    confidence or σ in pixels, which applies to the whole file. One hand alone need not be nested. A hand that
    was not found is `null`.

    A list of N objects (or one) with more fields: `landmarks` as above and, optionally, `side` (or
    `handedness`), `image`, `name`, `intrinsics` (or `K`), `confidence` and `sigma` (21 numbers each;
    σ also as 21 pairs), `box` (left, top, right, bottom) and `occluded` (21 true or false). Other keys are
    ignored with a warning. `fit.json` is such a list.

    COCO's keypoint format (`hand_recon.data.landmarks.coco`).

CSV
    One row per hand or one per landmark (`hand_recon.data.landmarks.csv_table`).

A landmark whose confidence is 0 is missing: detectors write (0, 0, 0) for what they did not find.
"""

import dataclasses
import json
import logging
import os
from pathlib import Path

from hand_recon.data.landmarks.camera_files import read_intrinsics
from hand_recon.data.landmarks.coco import is_coco, parse_coco
from hand_recon.data.landmarks.csv_table import parse_csv
from hand_recon.data.landmarks.image_landmarks import FEWEST, ImageLandmarks
from hand_recon.data.landmarks.json_lists import LANDMARK_KEYS, parse_objects, parse_points
from hand_recon.data.landmarks.parsed import Assumptions, ParsedHands, to_image_landmarks

logger = logging.getLogger(__name__)


def read_landmarks(
    path: str | Path,
    intrinsics: str | Path | None = None,
    assumed: Assumptions | None = None,
) -> ImageLandmarks:
    """Landmarks of N hands.

    Args:
        path: JSON or CSV, see above.
        intrinsics: Camera matrices of the images, one or one per hand; they override those in the file.
        assumed: Assumed values of what the file does not specify.

    Raises:
        FileNotFoundError: A file is missing.
        ValueError: A file cannot be parsed, or its numbers cannot be landmarks or cameras.
    """
    path = Path(os.path.expanduser(path))
    text = _text(path)
    is_json = text.lstrip().startswith(("[", "{"))
    parsed = _parse_json(path, text) if is_json else parse_csv(path, text)
    if intrinsics is not None and len(parsed.points):
        if parsed.intrinsics is not None:
            logger.warning("%s has camera matrices too; those of %s are used.", path, intrinsics)
        cameras = read_intrinsics(Path(os.path.expanduser(intrinsics)), len(parsed.points))
        parsed = dataclasses.replace(parsed, intrinsics=cameras)
    landmarks = to_image_landmarks(path, parsed, assumed or Assumptions())
    poor = [name for name, good in zip(landmarks.names, landmarks.usable, strict=True) if not good]
    if poor:
        logger.warning(
            "%s: %d of %d hands have fewer than %d labelled landmarks, or all in one place; the first: %s.",
            path, len(poor), len(landmarks), FEWEST, poor[:5],
        )  # fmt: skip
    return landmarks


def _text(path: Path) -> str:
    if not path.is_file():
        raise FileNotFoundError(
            f"No landmarks at {path}. Give a JSON list of hands of 21 points [u, v], COCO keypoints or CSV."
        )
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not text ({error}); expected JSON or CSV.") from error


def _parse_json(path: Path, text: str) -> ParsedHands:
    try:
        content = json.loads(text)
    except ValueError as error:
        raise ValueError(
            f"{path} is not complete JSON ({error}). It may be cut off, or be JSON lines: put all hands into "
            "one list."
        ) from error
    if is_coco(content):
        return parse_coco(path, content)
    if isinstance(content, dict):
        if not any(key in content for key in LANDMARK_KEYS):
            raise ValueError(
                f"{path} is an object with the keys {sorted(content)[:10]}; expected a list of hands, an "
                "object with `landmarks`, or COCO's with `annotations`."
            )
        content = [content]
    if not content:
        raise ValueError(f"{path} holds no hands; expected one or more, of 21 points each.")
    if any(isinstance(entry, dict) for entry in content):
        return parse_objects(path, content)
    return parse_points(path, content)
