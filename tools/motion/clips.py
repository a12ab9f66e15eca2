"""Clips of one hand with 3D ground truth: living poses in made-up motion, and a clip by two cameras."""

import itertools
import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from depth.sets import CENTRE, FOCAL, SecondCamera, headset_poses
from depth.stereo import stereo_clip
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks

RATE: Final = 30.0
"""Frames per second."""

POSES: Final = 12
"""Poses that a made-up clip goes through."""

MOVES: Final = (0.25, 0.9)
"""Shortest and longest time from one pose to the next, seconds."""

HOLDS: Final = (0.0, 0.5)
"""Shortest and longest time for which a pose is held, seconds."""

TILT: Final = 0.6
"""Standard deviation of each component of the rotation between poses, radians."""

PLACES: Final = ((-0.08, -0.08, 0.4), (0.08, 0.08, 0.6))
"""Least and largest coordinates of the hand's middle MCP in the camera's frame, metres."""

MISSING: Final = 0.04
"""Share of frames in which the hand is not found, besides one gap."""

GAP: Final = 9
"""Frames of the gap in the middle of a clip."""

_BASES: Final = [5, 17]
_STARTS: Final = [0 if place % 4 == 0 else place for place in range(20)]
"""Landmark at which each bone begins; bone i ends at landmark i + 1."""


@dataclass(frozen=True)
class MotionClip:
    """Landmarks of one hand in the frames in which it was found, and ground truth in all frames."""

    name: str
    """Name for tables."""
    landmarks: ImageLandmarks
    """2D landmarks of the found frames."""
    frames: Int[np.ndarray, " found"]
    """Numbers of the found frames; the first is zero."""
    rate: float
    """Frames per second."""
    ground_truth: Float[np.ndarray, "frame landmark=21 3"]
    """3D landmarks of every frame to the last found one, camera frame, metres; NaN where unknown."""
    second: SecondCamera | None = None
    """A second view of the found frames."""


def made_up_clip(
    folder: Path, *, side: str, seed: int, noise: float, correlation: float
) -> MotionClip:
    """Move from one recorded pose of a living hand to the next, seen by a made-up camera.

    Bones turn from the direction of one pose to that of the next with least jerk, the hand moves and turns
    likewise, and every pose is held for a while.

    Args:
        folder: Folder of the headset's poses, as for `depth.sets.headset_poses`.
        side: `left` or `right`.
        seed: Seed of poses, motion and noise.
        noise: Standard deviation of each coordinate of a landmark, pixels.
        correlation: Correlation of the noise in successive frames.
    """
    random = np.random.default_rng(seed)
    recorded = headset_poses(folder, noise=0.0, views=1)
    chosen = recorded.landmarks.left.numpy() == (side == "left")
    poses = recorded.ground_truth.numpy()[chosen]
    truth = _motion(poses[random.permutation(len(poses))[:POSES]], random)
    pixels = FOCAL * truth[..., :2] / truth[..., 2:] + CENTRE
    pixels = pixels + noise * _correlated(pixels.shape, correlation, random)
    frames = _found(len(truth), random)
    truth = truth[frames[0] : frames[-1] + 1]
    landmarks = _landmarks(pixels[frames], frames, left=side == "left")
    name = f"headset, {side}, {noise:g} px, correlation {correlation:g}"
    return MotionClip(name, landmarks, frames - frames[0], RATE, truth)


def _motion(
    poses: Float[np.ndarray, "pose landmark=21 3"], random: np.random.Generator
) -> Float[np.ndarray, "frame landmark=21 3"]:
    """Landmarks of a hand that goes through poses, camera frame, metres."""
    bones = np.stack([_bones(pose) for pose in poses])
    share = _shares(len(poses), random)
    first = np.minimum(share.astype(int), len(poses) - 2)
    part = (share - first)[:, None]
    moved = _between(bones[first], bones[first + 1], part[..., None])
    turns = [Rotation.random(random_state=random)]
    for _ in poses[1:]:
        turns.append(Rotation.from_rotvec(TILT * random.normal(size=3)) * turns[-1])
    between = [(after * before.inv()).as_rotvec() for before, after in itertools.pairwise(turns)]
    turned = Rotation.from_rotvec(part * np.array(between)[first])
    rotation = (turned * Rotation.concatenate(turns)[first]).as_matrix()
    places = random.uniform(*PLACES, size=(len(poses), 3))
    place = (1 - part) * places[first] + part * places[first + 1]
    points = np.zeros((len(share), 21, 3))
    for bone, start in enumerate(_STARTS):
        points[:, bone + 1] = points[:, start] + moved[:, bone]
    points = (points - points[:, 9:10]) @ rotation.swapaxes(1, 2)
    return points + place[:, None]


def _shares(poses: int, random: np.random.Generator) -> Float[np.ndarray, " frame"]:
    """Number of the pose at every frame, with fractions between poses by minimum jerk."""
    times, values = [0.0], [0.0]
    for pose in range(poses):
        times.append(times[-1] + random.uniform(*HOLDS))
        values.append(float(pose))
        times.append(times[-1] + random.uniform(*MOVES))
        values.append(float(min(pose + 1, poses - 1)))
    share = np.interp(np.arange(0.0, times[-1], 1 / RATE), times, values)
    whole, part = np.floor(share), share % 1
    return whole + part**3 * (10 - 15 * part + 6 * part**2)


def _bones(points: Float[np.ndarray, "landmark=21 3"]) -> Float[np.ndarray, "bone=20 3"]:
    """Vectors along the bones in axes of the palm, metres."""
    index, little = points[_BASES] - points[0]
    across = np.cross(index, little)
    along = index + little
    axes = np.stack([along, np.cross(across, along), across])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return (points[1:] - points[_STARTS]) @ axes.T


def _between(first: np.ndarray, second: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Vectors that turn from some directions to others, with lengths in between."""
    lengths = [np.linalg.norm(each, axis=-1, keepdims=True) for each in (first, second)]
    one, other = first / lengths[0], second / lengths[1]
    angle = np.arccos(np.clip((one * other).sum(axis=-1, keepdims=True), -1.0, 1.0))
    angle = np.maximum(angle, 1e-6)
    direction = (np.sin((1 - part) * angle) * one + np.sin(part * angle) * other) / np.sin(angle)
    return ((1 - part) * lengths[0] + part * lengths[1]) * direction


def _correlated(
    shape: tuple[int, ...], correlation: float, random: np.random.Generator
) -> np.ndarray:
    """Noise of unit variance with a correlation of successive frames."""
    noise = random.normal(size=shape)
    for frame in range(1, len(noise)):
        noise[frame] = correlation * noise[frame - 1] + np.sqrt(1 - correlation**2) * noise[frame]
    return noise


def _found(count: int, random: np.random.Generator) -> Int[np.ndarray, " found"]:
    """Frames in which the hand is found."""
    kept = random.random(count) >= MISSING
    kept[count // 2 : count // 2 + GAP] = False
    return np.flatnonzero(kept)


def _landmarks(
    points: Float[np.ndarray, "hand landmark=21 2"], frames: np.ndarray, *, left: bool
) -> ImageLandmarks:
    camera = torch.tensor([[FOCAL, 0.0, CENTRE], [0.0, FOCAL, CENTRE], [0.0, 0.0, 1.0]]).double()
    return ImageLandmarks(
        landmarks_2d=torch.from_numpy(points.round(2)),
        labelled=torch.ones(points.shape[:2], dtype=torch.bool),
        left=torch.full((len(points),), left),
        names=tuple(f"frame {frame}" for frame in frames.tolist()),
        intrinsics=camera.expand(len(points), 3, 3).clone(),
    )


def landmark_clip(folder: Path) -> MotionClip:
    """Read a clip of a hand that hardly moves, from files with landmarks and ground truth.

    Args:
        folder: Folder of `frames.json` (frame × 21 × 2, pixels), `K.json` (camera matrix) and `truth.npy`
            (frame × 21 × 3, camera frame, metres).
    """
    seen = np.array(json.loads((folder / "frames.json").read_text(encoding="utf-8")), dtype=float)
    camera = torch.tensor(json.loads((folder / "K.json").read_text(encoding="utf-8"))).double()
    frames = np.arange(len(seen))
    landmarks = replace(
        _landmarks(seen, frames, left=False), intrinsics=camera.expand(len(seen), 3, 3).clone()
    )
    truth = np.load(folder / "truth.npy").astype(float)
    return MotionClip("slow", landmarks, frames, RATE, truth)


def two_camera_clip(folder: Path) -> MotionClip:
    """Read the clip of one hand by two cameras, with the frames in which both found the hand.

    Args:
        folder: The clip's folder, as for `depth.stereo.stereo_clip`.
    """
    found = stereo_clip(folder)
    frames = np.array([int(name.split()[-1]) for name in found.landmarks.names])
    frames = frames - frames[0]
    truth = np.full((frames[-1] + 1, 21, 3), np.nan)
    truth[frames] = found.ground_truth.numpy()
    return MotionClip("stereo", found.landmarks, frames, RATE, truth, found.second)
