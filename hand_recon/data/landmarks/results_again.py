"""Reconstructed hands as landmarks to fit again (`hand_recon.fitting.hands_file` has the format)."""

import logging
from pathlib import Path
from typing import Any, Final

from hand_recon.data.landmarks.image_landmarks import FEWEST

logger = logging.getLogger(__name__)

_RESULT_KEYS: Final = frozenset({"landmarks_3d", "joint_angles_degrees", "loss"})
"""Keys that tell a file of reconstructed hands."""

_POINT_KEYS: Final = ("observed_2d", "landmarks", "landmarks_2d")
"""Keys of a hand's 21 points, the first that is present and not null."""

_KNOWN_SOURCES: Final = frozenset({"given", "EXIF", "field of view"})
"""Sources of a reconstructed hand's camera that are known rather than assumed."""


def is_result(entry: dict[str, Any]) -> bool:
    """True for a hand of a file of reconstructed hands.

    Args:
        entry: The hand's object.
    """
    return bool(_RESULT_KEYS & entry.keys())


def entries_of_results(
    path: Path, content: list[dict[str, Any]]
) -> tuple[list[dict[str, Any]], str]:
    """Reconstructed hands as objects with `landmarks`, `intrinsics` and `image_size`.

    The landmarks are the observed ones where the file has them, else the projections. The cameras are those
    of the file if all hands have a known one; otherwise all are left out, with a warning.

    Args:
        path: The file, for messages.
        content: Its hands.

    Returns:
        The objects, and a title of their landmarks for messages.
    """
    points = [
        next((entry[key] for key in _POINT_KEYS if entry.get(key) is not None), None)
        for entry in content
    ]
    cameras = _cameras_of_results(path, content, points)
    entries = [
        {
            **{key: value for key, value in entry.items() if key not in _POINT_KEYS},
            "landmarks": some,
            "intrinsics": camera,
            "image_size": _size_of_result(entry),
        }
        for entry, some, camera in zip(content, points, cameras, strict=True)
    ]
    observed = any(entry.get("observed_2d") is not None for entry in content)
    return entries, "observed landmarks" if observed else "projections"


def _cameras_of_results(
    path: Path, content: list[dict[str, Any]], points: list[Any]
) -> list[object]:
    """The known camera of each hand; None for all of them where one that can be fitted has none."""
    cameras = [_camera_of_result(entry) for entry in content]
    by_image = {
        entry["image"]: camera
        for entry, camera in zip(content, cameras, strict=True)
        if camera is not None and isinstance(entry.get("image"), str)
    }
    spare = next((camera for camera in cameras if camera is not None), None)
    filled = []
    for entry, own, some in zip(content, cameras, points, strict=True):
        camera = own
        if own is None and entry.get("camera") is None:  # A hand without a result has no camera.
            image = entry.get("image")
            camera = by_image.get(image) if isinstance(image, str) else None
            camera = spare if camera is None and not _can_be_fitted(some) else camera
        filled.append(camera)
    unknown = sum(camera is None for camera in filled)
    known = sum(camera is not None for camera in cameras)
    if unknown and known:
        logger.warning(
            "%s: %d of %d hands have no known camera, so that the known cameras of %d are left out. Fit "
            "them in a file of their own, or give the camera of all with intrinsics=<file>.",
            path, unknown, len(content), known,
        )  # fmt: skip
    return [None] * len(content) if unknown else filled


def _can_be_fitted(points: object) -> bool:
    """True if a hand's value may hold enough landmarks for a fit."""
    return isinstance(points, list) and sum(one is not None for one in points) >= FEWEST


def _camera_of_result(entry: dict[str, Any]) -> object:
    """The camera matrix of a reconstructed hand; None if it was assumed."""
    camera = entry.get("camera")
    if not isinstance(camera, dict):
        return None
    known = camera.get("known") is True or str(camera.get("source")) in _KNOWN_SOURCES
    return camera.get("intrinsics") if known else None


def _size_of_result(entry: dict[str, Any]) -> object:
    camera = entry.get("camera")
    return camera.get("image_size") if isinstance(camera, dict) else None
