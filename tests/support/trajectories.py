"""Made-up motions of hands, and the geometry that files of them must hold."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from hand_recon.detection.detector import Side
from hand_recon.hand.model import HandModel
from hand_recon.motion.trajectory import Trajectory
from hand_recon.schema import HandGeometry, HandParameters

TO_GLTF = np.array([1.0, -1.0, -1.0])
MIRROR = torch.tensor([-1.0, 1.0, 1.0])

# The palm faces the camera, fingers up: the columns are the hand's axes in the camera's frame.
FACING = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])


@dataclass(frozen=True)
class Clip:
    """Numbers of a made-up hand."""

    frames: int = 20
    start: int = 0
    rate: float = 30.0
    seed: int = 0


def moving_hand(hand: int = 1, side: Side = "right", clip: Clip | None = None) -> Trajectory:
    """A hand that bends its fingers, rotates by more than a whole turn and moves, with a shape of its own."""
    clip = clip or Clip()
    rng = np.random.default_rng(clip.seed)
    frames = clip.start + np.arange(clip.frames)
    phase = np.linspace(0.0, 2.0, clip.frames)[:, None, None]
    middle, swing = np.array([0.6, 0.0, 0.0]), np.array([0.7, 0.2, 0.1])
    angles = middle + swing * np.sin(phase + rng.uniform(0, 6, (15, 3)))
    # Older SciPy takes no empty list of rotations.
    turns = np.linspace(0.0, 8.0, max(clip.frames, 1))[:, None] * np.array([0.3, 0.8, 0.52])
    spin = Rotation.from_rotvec(turns).as_matrix()[: clip.frames]
    path = np.array([0.05, -0.04, 0.6]) + phase[:, :, 0] * np.array([0.1, 0.05, -0.08])
    return Trajectory(
        hand, side, frames, frames / clip.rate, angles, spin @ FACING, path,
        rng.normal(size=10), np.ones(clip.frames, dtype=bool),
    )  # fmt: skip


def still_hand(
    angles: Float[np.ndarray, "joint=15 axis=3"] | None = None, side: Side = "right"
) -> Trajectory:
    """A hand with the palm towards the camera in one frame, of the mean shape."""
    return Trajectory(
        1, side, np.array([0]), np.array([0.0]), (np.zeros((15, 3)) if angles is None else angles)[None],
        FACING[None], np.array([[0.0, 0.0, 0.5]]), np.zeros(10), np.array([True]),
    )  # fmt: skip


def without_frames(trajectory: Trajectory, *frames: int) -> Trajectory:
    """The motion without some frames, as where a gap is too long to be bridged."""
    kept = ~np.isin(trajectory.frames, frames)
    return replace(
        trajectory,
        frames=trajectory.frames[kept],
        times=trajectory.times[kept],
        joint_angles=trajectory.joint_angles[kept],
        root_rotation=trajectory.root_rotation[kept],
        translation=trajectory.translation[kept],
        observed=trajectory.observed[kept],
    )


def with_times(trajectory: Trajectory, times: Float[np.ndarray, " frame"]) -> Trajectory:
    """The same poses at other times."""
    return replace(trajectory, times=times)


def in_camera(trajectory: Trajectory, hand: HandModel) -> HandGeometry:
    """The hand in the camera's frame at all frames, by `HandModel.to_camera` of the right hand.

    A left hand is the mirror image of a right hand with mirrored rotation and translation.
    """
    mirror = torch.diag(MIRROR if trajectory.side == "left" else torch.ones(3))
    geometry = hand.to_camera(
        HandParameters(
            torch.as_tensor(trajectory.joint_angles).float(),
            torch.as_tensor(trajectory.shape).float().expand(len(trajectory), -1),
            mirror @ torch.as_tensor(trajectory.root_rotation).float() @ mirror,
            torch.as_tensor(trajectory.translation).float() @ mirror,
        )
    )
    return HandGeometry(
        geometry.vertices @ mirror, geometry.joints @ mirror, geometry.landmarks @ mirror
    )


def in_world(points: torch.Tensor) -> Float[np.ndarray, "..."]:
    """Points of the camera's frame in the world of glTF and BVH."""
    return points.double().numpy() * TO_GLTF
