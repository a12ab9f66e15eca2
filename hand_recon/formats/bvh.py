"""BVH of one hand: skeleton and motion as a text file of motion capture.

BVH has no units and no surface. Lengths are metres: Blender reads one unit as one metre, so that the file
lies over the GLB of the same clip; programs that count in centimetres want a scale of 100 at import. The
world has y up and the camera at its origin, looking along −z. At rest all joint angles are zero, fingers
straight, and the hand is that of a figure with outstretched arms that faces +z.

The root has six channels and every other joint three, in the order Z, X, Y. For a finger these are nearly
bend, twist and splay, so that the angles lock only near 90° of twist, which no joint reaches. The root's do
lock, at a palm that faces the camera; the rotation stays exact there, and angles follow those of the frame
before.
"""

import warnings
from pathlib import Path
from typing import Final

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial.transform import Rotation, Slerp

from hand_recon.formats.joint_motion import (
    SINGLE_FRAME,
    JointMotion,
    check_motions,
    local_rotations,
    motion_of,
)
from hand_recon.formats.new_file import write_new
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import FINGERS, JOINT_OF_LANDMARK, JOINTS, PARENTS, TIPS
from hand_recon.motion.trajectory import Trajectory, mirror_of

STEADY: Final = 0.05
"""Largest deviation of a frame's time from a constant rate at which frames are taken as they are, frames."""

_ROTATIONS: Final = "Zrotation Xrotation Yrotation"
_POSITIONS: Final = "Xposition Yposition Zposition"
_DECIMALS: Final = 6


def write_bvh(path: str | Path, trajectory: Trajectory, hand: HandModel) -> Path:
    """Write the file of `bvh`; folders are made.

    Args:
        path: File to write.
        trajectory: The hand.
        hand: Model of the right hand.

    Raises:
        FileExistsError: The file exists.
        ValueError: As `bvh`.
    """
    return write_new(path, bvh(trajectory, hand).encode("ascii"))


def bvh(trajectory: Trajectory, hand: HandModel) -> str:
    """Make the text of a BVH file of one hand's motion.

    The file begins at the hand's first frame, since BVH has no times but a constant frame time. Where the
    times of frames vary, the motion is sampled again at their median rate: rotations on the shortest arc
    (slerp), the wrist's position on a line. Ends of fingers are the hand model's tip landmarks.

    Args:
        trajectory: The hand.
        hand: Model of the right hand.

    Raises:
        ValueError: The hand has no frame, numbers are not finite, or a time is negative.
    """
    check_motions([trajectory])
    motion = _from_neutral(motion_of(trajectory, hand), trajectory, hand)
    motion, frame_time = at_constant_rate(motion, trajectory.times)
    lines = [
        "HIERARCHY", *_hierarchy(trajectory, hand), "MOTION", f"Frames: {len(motion.wrist)}",
        f"Frame Time: {frame_time:.8f}",
    ]  # fmt: skip
    angles = to_euler_degrees(motion.rotations)
    order = _depth_first(0)
    rows = np.concatenate([motion.wrist, angles[:, order].reshape(len(angles), -1)], axis=1)
    # Adding zero turns −0 into 0.
    rows = rows.round(_DECIMALS) + 0.0
    lines += [" ".join(f"{value:.{_DECIMALS}f}" for value in row) for row in rows.tolist()]
    return "\n".join(lines) + "\n"


def at_constant_rate(
    motion: JointMotion, times: Float[np.ndarray, " frame"]
) -> tuple[JointMotion, float]:
    """Sample a motion at a constant rate, from its first time to its last.

    Args:
        motion: Motion at the given times.
        times: Increasing, seconds.

    Returns:
        The motion, as it was if its rate is constant within `STEADY`, and the frame time, seconds.
    """
    if len(times) == 1:
        return motion, SINGLE_FRAME
    length = float(times[-1] - times[0])
    frame_time = length / (len(times) - 1)
    even = np.linspace(times[0], times[-1], len(times))
    if np.abs(times - even).max() <= STEADY * frame_time:
        return motion, frame_time
    count = max(1, round(length / float(np.median(np.diff(times)))))
    new = np.linspace(times[0], times[-1], count + 1)
    rotations = np.stack(
        [
            Slerp(times, Rotation.from_matrix(motion.rotations[:, joint]))(new).as_matrix()
            for joint in range(len(JOINTS))
        ],
        axis=1,
    )
    wrist = np.stack([np.interp(new, times, values) for values in motion.wrist.T], axis=1)
    return JointMotion(rotations, wrist), length / count


def to_euler_degrees(
    rotations: Float[np.ndarray, "frame joint 3 3"],
) -> Float[np.ndarray, "frame joint axis=3"]:
    """Convert rotations to the angles of R_z R_x R_y, degrees, each frame's near those of the frame before.

    A rotation has two sets of such angles, and each angle may have whole turns more; of all of these the
    nearest are chosen, so that programs that interpolate angles take the short way.
    """
    with warnings.catch_warnings():
        # Where the angles lock, two of them are one rotation, which is exact all the same.
        warnings.filterwarnings("ignore", message="Gimbal lock", category=UserWarning)
        flat = Rotation.from_matrix(rotations.reshape(-1, 3, 3)).as_euler("ZXY", degrees=True)
    angles = flat.reshape(*rotations.shape[:2], 3)
    for frame in range(1, len(angles)):
        before = angles[frame - 1]
        other = angles[frame] * np.array([1.0, -1.0, 1.0]) + 180.0
        both = np.stack([angles[frame], other])
        both -= 360.0 * np.round((both - before) / 360.0)
        nearer = np.abs(both - before).sum(axis=-1).argmin(axis=0)
        angles[frame] = np.take_along_axis(both, nearer[None, :, None], axis=0)[0]
    return angles


def _from_neutral(motion: JointMotion, trajectory: Trajectory, hand: HandModel) -> JointMotion:
    """The same motion with rotations that are zero where all joint angles are zero.

    With N the orientations of joints at zero angles and L a rotation from the pose that was modelled, the
    rotation of a joint from the neutral, relative to its parent, is N_parent L Nᵀ.
    """
    mirror = mirror_of(trajectory.side)
    neutral = local_rotations(hand.neutral_angles(), hand) * np.outer(mirror, mirror)
    orientations = [np.eye(3)]
    for joint in range(1, len(JOINTS)):
        orientations.append(orientations[PARENTS[joint]] @ neutral[joint - 1])
    own = np.stack(orientations)
    parents = np.stack([np.eye(3), *(own[parent] for parent in PARENTS[1:])])
    return JointMotion(parents @ motion.rotations @ own.swapaxes(-1, -2), motion.wrist)


def _hierarchy(trajectory: Trajectory, hand: HandModel) -> list[str]:
    """Lines of the skeleton at zero angles."""
    shape = torch.as_tensor(trajectory.shape).to(hand.template)
    neutral = hand(hand.neutral_angles(), shape)
    mirror = mirror_of(trajectory.side)
    joints = neutral.joints.detach().cpu().double().numpy() * mirror
    landmarks = neutral.landmarks.detach().cpu().double().numpy() * mirror
    tips = {JOINT_OF_LANDMARK[tip - 1]: landmarks[tip] for tip in TIPS}

    def branch(joint: int, indent: str) -> list[str]:
        parent = PARENTS[joint]
        inner = indent + "  "
        offset = joints[joint] - joints[parent] if joint else np.zeros(3)
        name = f"{trajectory.side}_{JOINTS[joint].replace(' ', '_')}"
        channels = f"3 {_ROTATIONS}" if joint else f"6 {_POSITIONS} {_ROTATIONS}"
        lines = [
            f"{indent}{'JOINT' if joint else 'ROOT'} {name}", f"{indent}{{",
            f"{inner}OFFSET {_numbers(offset)}", f"{inner}CHANNELS {channels}",
        ]  # fmt: skip
        for child in _children(joint):
            lines += branch(child, inner)
        if joint in tips:
            end = _numbers(tips[joint] - joints[joint])
            lines += [f"{inner}End Site", f"{inner}{{", f"{inner}  OFFSET {end}", f"{inner}}}"]
        return [*lines, f"{indent}}}"]

    return branch(0, "")


def _children(joint: int) -> list[int]:
    """Joints of the next level, thumb first as in the landmarks."""
    children = [child for child, parent in enumerate(PARENTS) if parent == joint]
    return sorted(children, key=lambda child: FINGERS.index(JOINTS[child].split()[0]))


def _depth_first(joint: int) -> list[int]:
    """A joint and all joints after it, in the order of the file."""
    return [joint, *(one for child in _children(joint) for one in _depth_first(child))]


def _numbers(values: Float[np.ndarray, "3"]) -> str:
    return " ".join(f"{value + 0.0:.{_DECIMALS}f}" for value in values.round(_DECIMALS).tolist())
