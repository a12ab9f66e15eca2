"""A clip of one hand by two calibrated cameras, as a set for fits to the first camera's landmarks."""

import json
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from jaxtyping import Float

from depth.sets import DepthSet, SecondCamera
from hand_recon.data.landmarks.distortion import undistorted
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.hand.open_hand import open_hand
from hand_recon.hand.skeleton import LANDMARKS

LARGEST_ERROR: Final = 5.0
"""Largest mean reprojection error of a frame's triangulated landmarks, pixels; worse frames are left out."""

BLOCK: Final = 24
"""Consecutive frames in a group: what is wrong with one frame is often wrong with the next."""

BASES: Final = tuple(
    LANDMARKS.index(f"{finger} MCP") for finger in ("index", "middle", "ring", "little")
)
"""Landmarks whose distances from the wrist give the size of the hand."""


def stereo_clip(folder: Path, *, every: int = 1) -> DepthSet:
    """Read the frames in which both cameras found the hand, a right one.

    The unit of the calibration is not known in millimetres. It is chosen so that the hand of the clip has the
    size of the open hand's mean shape, which makes errors those of a hand of mean size.

    Args:
        folder: Folder with `calibration.json` (for `cam0` and `cam1`: `K`, `distortion` in OpenCV's
            order, `R` and `t` from the world) and `landmarks.npz` (`cam0`, `cam1` in pixels, `points`
            triangulated in the world, `error` in pixels; NaN where a camera found no hand).
        every: Step between frames.

    Raises:
        FileNotFoundError: The folder has no such files.
    """
    for name in ("calibration.json", "landmarks.npz"):
        if not (folder / name).is_file():
            raise FileNotFoundError(
                f"No {name} in {folder}; expected the stereo clip's calibration.json and landmarks.npz. "
                "Name their folder."
            )
    cameras = json.loads((folder / "calibration.json").read_text(encoding="utf-8"))
    with np.load(folder / "landmarks.npz") as archive:
        tracks = {name: archive[name] for name in ("cam0", "cam1", "points", "error")}
    whole = [np.isfinite(tracks[name]).all(axis=(1, 2)) for name in ("cam0", "cam1", "points")]
    good = np.logical_and.reduce([*whole, tracks["error"] <= LARGEST_ERROR])
    frames = np.flatnonzero(good)[::every]
    matrices = {name: np.array(cameras[name]["K"]) for name in ("cam0", "cam1")}
    seen = {name: _straight(folder, cameras[name], tracks[name][frames]) for name in matrices}
    unit = _unit_of(tracks["points"][good])
    (rotation, place), (second_rotation, second_place) = (
        (np.array(cameras[name]["R"]), np.array(cameras[name]["t"])) for name in matrices
    )
    between = second_rotation @ rotation.T
    count = len(frames)
    landmarks = ImageLandmarks(
        landmarks_2d=torch.from_numpy(seen["cam0"]),
        labelled=torch.ones(count, 21, dtype=torch.bool),
        left=torch.zeros(count, dtype=torch.bool),
        names=tuple(f"frame {frame}" for frame in frames.tolist()),
        intrinsics=torch.from_numpy(matrices["cam0"]).expand(count, 3, 3).clone(),
    )
    return DepthSet(
        "stereo",
        landmarks,
        torch.from_numpy(unit * (tracks["points"][frames] @ rotation.T + place)),
        tuple(str(frame // BLOCK) for frame in frames.tolist()),
        SecondCamera(
            torch.from_numpy(seen["cam1"]),
            torch.from_numpy(matrices["cam1"]),
            torch.from_numpy(between),
            torch.from_numpy(unit * (second_place - between @ place)),
        ),
    )


def _straight(
    folder: Path, camera: dict[str, Any], points: Float[np.ndarray, "frame landmark=21 2"]
) -> Float[np.ndarray, "frame landmark=21 2"]:
    """Remove lens distortion."""
    found = undistorted(
        folder / "calibration.json",
        points.reshape(-1, 2).astype(float),
        np.array(camera["K"]),
        tuple(camera["distortion"]),
        fisheye=False,
    )
    return found.reshape(points.shape)


def _unit_of(points: Float[np.ndarray, "frame landmark=21 3"]) -> float:
    """Metres per unit of the calibration for a hand of the open hand's mean size."""
    hand = open_hand()
    mean = hand(hand.neutral_angles(), torch.zeros(10)).landmarks.numpy()
    return float(_palm(mean) / np.median(_palm(points)))


def _palm(points: Float[np.ndarray, "*frame landmark=21 3"]) -> np.ndarray:
    """Sum of the distances from the wrist to the bases of the fingers, in the points' unit."""
    return np.linalg.norm(points[..., BASES, :] - points[..., :1, :], axis=-1).sum(axis=-1)
