"""Reads HInt: hands in the wild with 2D landmarks and their occlusion (Pavlakos et al., CVPR 2024).

A folder of `<name>_l.jpg` and `<name>_l.json` pairs; `_l` or `_r` is the hand's side, and both hands of a
image have a pair each. A JSON file is a list of `{bbox: [[left, top, right, bottom]], keypoints: 21 × 2,
occlusion: 21}`, in FreiHAND's order, occlusion 1 for a keypoint that is labelled but cannot be seen. The
archive has folders named `TRAIN_…`, `VAL_…` and `TEST_…`; those of Ego4D come without their images.
"""

import logging
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.data.landmarks.parsed import Assumptions, ParsedHands, to_image_landmarks
from hand_recon.reading.text import parse_json, read_text

logger = logging.getLogger(__name__)

SPLITS: Final = ("train", "val", "test")
"""Prefixes of the archive's folders, which are written in capitals."""

SUFFIXES: Final = (".jpg", ".jpeg", ".png")
"""Suffixes of image files."""

_SIDES: Final = {"l": "left", "r": "right"}


def folders_of(root: Path, split: str) -> list[Path]:
    """Folders of the archive that hold a split; empty if the root is not the archive's or has none.

    Args:
        root: Folder to search.
        split: One of `SPLITS`.
    """
    return sorted(
        folder for folder in root.iterdir()
        if folder.is_dir() and folder.name.upper().startswith(f"{split.upper()}_")
    )  # fmt: skip


def read_hint(
    root: Path, split: str = "train", assumed: Assumptions | None = None
) -> ImageLandmarks:
    """The hands of a folder, or of a split of the whole archive.

    Hands whose image is missing are left out with a warning.

    Args:
        root: The unpacked archive, or one of its folders.
        split: One of `SPLITS`; a single folder of pairs is read whole.
        assumed: Assumed values of what a file's name does not specify.

    Raises:
        FileNotFoundError: There is no such folder, or no hand with an image in it.
        ValueError: A file holds something else.
    """
    if not root.is_dir():
        raise FileNotFoundError(f"No folder {root} with pairs of images and JSON files.")
    is_archive = any(folders_of(root, name) for name in SPLITS)
    folders = folders_of(root, split) if is_archive else [root]
    files = sorted(path for folder in folders for path in folder.rglob("*.json"))
    pairs = [(path, _image(path)) for path in files]
    shown = [(path, image) for path, image in pairs if image is not None]
    if len(shown) < len(pairs):
        logger.warning(
            "%s: %d of %d hands are left out, as there are no images beside them (Ego4D's have to be "
            "fetched under its own licence).",
            root, len(pairs) - len(shown), len(pairs),
        )  # fmt: skip
    if not shown:
        raise FileNotFoundError(
            f"No pair of an image and a JSON file of {split} in {root}; expected HInt's folders TRAIN_…, "
            "VAL_… and TEST_…, or one of them."
        )
    return to_image_landmarks(root / "*.json", _parsed(shown), assumed or Assumptions(side=None))


def _image(path: Path) -> Path | None:
    candidates = (path.with_suffix(suffix) for suffix in SUFFIXES)
    return next((image for image in candidates if image.is_file()), None)


def _parsed(pairs: Sequence[tuple[Path, Path]]) -> ParsedHands:
    points, boxes, occluded, sides, images = [], [], [], [], []
    for path, image in pairs:
        for entry in _entries(path):
            points.append(_numbers(path, entry, "keypoints", (21, 2)))
            boxes.append(_numbers(path, entry, "bbox", (4,)))
            occluded.append(_numbers(path, entry, "occlusion", (21,)) > 0.5)
            sides.append(_side(path))
            images.append(str(image.absolute()))
    return ParsedHands(
        points=np.array(points).reshape(-1, 21, 2),
        sides=sides,
        names=[Path(image).stem for image in images],
        images=images,
        boxes=np.array(boxes).reshape(-1, 4),
        occluded=np.array(occluded, dtype=bool).reshape(-1, 21),
    )


def _entries(path: Path) -> list[dict[str, Any]]:
    content = parse_json(read_text(path), path)
    entries = content if isinstance(content, list) else [content]
    for entry in entries:
        if not isinstance(entry, dict) or "keypoints" not in entry:
            raise ValueError(
                f"{path} is not one of HInt's files: expected a list of objects with `bbox`, `keypoints` and "
                "`occlusion`."
            )
    return entries


def _numbers(path: Path, entry: dict[str, Any], key: str, shape: tuple[int, ...]) -> np.ndarray:
    expected = " × ".join(map(str, shape))
    try:
        numbers = np.array(entry[key], dtype=np.float64).reshape(shape)
    except (KeyError, ValueError, TypeError) as error:
        raise ValueError(f"{path}: `{key}` must be {expected} numbers ({error}).") from error
    # A keypoint may be missing, a box may not.
    if np.isinf(numbers).any() or (key != "keypoints" and np.isnan(numbers).any()):
        raise ValueError(
            f"{path}: `{key}` must be {expected} finite numbers. Correct or remove the file."
        )
    return numbers


def _side(path: Path) -> str | None:
    match = re.search(r"_([lr])$", path.stem)
    return None if match is None else _SIDES[match.group(1)]
