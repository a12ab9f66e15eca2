"""The 26 hand joints of OpenXR: positions, axes and radii (`XR_EXT_hand_tracking`; decision 84).

A joint is named after the bone that begins there. Its −z axis runs along this bone towards the fingertip, its
y axis leaves the back of the finger, on both hands; x completes a right-handed frame. Tips have the axes of
their distal bones. Positions are in the world of `joint_motion.py`: y up, metres, the camera at the origin,
looking along −z. The radius of a joint is its distance from the skin at rest.

Neither hand model has the carpal ends of the four metacarpals, nor the palm's centre. They are estimated:
each metacarpal begins on the line from the wrist to the MCP, after a share of 0.54 / 1.54, because the carpus
is 0.54 times as high as the third metacarpal is long (Youm et al., J. Bone Joint Surg. Am. 60, 1978, 423).
The palm is the middle of the third metacarpal.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from hand_recon.formats.joint_motion import local_rotations
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import FINGERS, JOINTS, LANDMARKS, PARENTS, TIPS
from hand_recon.motion.trajectory import Trajectory, mirror_of
from hand_recon.rendering.mesh_files import CAMERA_TO_GLTF

PARTS: Final = ("METACARPAL", "PROXIMAL", "INTERMEDIATE", "DISTAL", "TIP")
"""Joints of a finger; the thumb has no intermediate one."""

XR_JOINTS: Final = (
    "PALM",
    "WRIST",
    *(f"THUMB_{part}" for part in PARTS if part != "INTERMEDIATE"),
    *(f"{finger.upper()}_{part}" for finger in FINGERS[1:] for part in PARTS),
)
"""Names of the joints in OpenXR's order, without `XR_HAND_JOINT_` and `_EXT`."""

ESTIMATED: Final = ("PALM", *(f"{finger.upper()}_METACARPAL" for finger in FINGERS[1:]))
"""Joints that the hand models lack."""

CARPUS: Final = 0.54 / 1.54
"""Share of the way from the wrist to an MCP at which the metacarpal begins."""

SMALLEST_RADIUS: Final = 0.001
"""Radius of a joint on the skin, metres: OpenXR's radii are positive."""


@dataclass(frozen=True)
class XrMotion:
    """Joints of one hand at every frame of its motion, in a world with y up."""

    positions: Float[np.ndarray, "frame joint=26 3"]
    """Metres."""
    orientations: Float[np.ndarray, "frame joint=26 quaternion=4"]
    """Unit quaternions (x, y, z, w) from the joint's axes to the world's."""
    radii: Float[np.ndarray, " joint=26"]
    """Distance of each joint from the skin, metres."""


@torch.no_grad()
def xr_motion(trajectory: Trajectory, hand: HandModel) -> XrMotion:
    """Compute the joints of OpenXR of a motion.

    Args:
        trajectory: The hand.
        hand: Model of the right hand.
    """
    angles = torch.as_tensor(trajectory.joint_angles).to(hand.template)
    shape = torch.as_tensor(trajectory.shape).to(hand.template)
    vertices, joints = hand.rest(shape)
    posed = hand(angles, shape.expand(len(angles), -1))
    rest = _points(_numpy(joints)[None], _numpy(hand.landmarks_of(vertices, joints))[None])[0]
    points = _points(_numpy(posed.joints), _numpy(posed.landmarks))
    axes = _orientations(local_rotations(angles, hand))[:, _MOVED_BY] @ _rest_axes(rest, hand)
    mirror, world = mirror_of(trajectory.side), np.array(CAMERA_TO_GLTF)
    root = world[:, None] * trajectory.root_rotation.astype(np.float64)
    # Of mirrored axes, −z and y keep their meanings, and x is reversed to complete a right-handed frame.
    axes = root[:, None] @ (mirror[:, None] * axes * mirror)
    positions = np.einsum("fxy,fjy->fjx", root, points * mirror)
    positions += (trajectory.translation * world)[:, None]
    orientations = Rotation.from_matrix(axes.reshape(-1, 3, 3)).as_quat().reshape(-1, 26, 4)
    return XrMotion(positions, orientations, _radii(rest, _numpy(vertices), hand))


def _skeleton_joint(name: str) -> int:
    """Index, among the 16, of the joint that moves a joint of OpenXR."""
    finger, _, part = name.lower().partition("_")
    if name in {"WRIST", *ESTIMATED}:
        return 0
    # The thumb's metacarpal begins at its CMC, a finger's first phalanx at its MCP.
    thumb = {"metacarpal": "CMC", "proximal": "MCP", "distal": "IP", "tip": "IP"}
    fingers = {"proximal": "MCP", "intermediate": "PIP", "distal": "DIP", "tip": "DIP"}
    return JOINTS.index(f"{finger} {(thumb if finger == 'thumb' else fingers)[part]}")


_MOVED_BY: Final = [_skeleton_joint(name) for name in XR_JOINTS]


def _points(
    joints: Float[np.ndarray, "frame joint=16 3"],
    landmarks: Float[np.ndarray, "frame landmark=21 3"],
) -> Float[np.ndarray, "frame joint=26 3"]:
    """Places of the joints, from rotation centres and fingertips in any frame."""
    places = joints[:, _MOVED_BY]
    for tip in TIPS:
        finger = LANDMARKS[tip].split()[0].upper()
        places[:, XR_JOINTS.index(f"{finger}_TIP")] = landmarks[:, tip]
        if finger != "THUMB":
            mcp = joints[:, JOINTS.index(f"{finger.lower()} MCP")]
            base = joints[:, 0] + CARPUS * (mcp - joints[:, 0])
            places[:, XR_JOINTS.index(f"{finger}_METACARPAL")] = base
    ends = [XR_JOINTS.index(f"MIDDLE_{part}") for part in ("METACARPAL", "PROXIMAL")]
    places[:, XR_JOINTS.index("PALM")] = places[:, ends].mean(axis=1)
    return places


def _rest_axes(
    rest: Float[np.ndarray, "joint=26 3"], hand: HandModel
) -> Float[np.ndarray, "joint=26 3 3"]:
    """Axes of the joints of a right hand at rest, in columns x, y, z."""
    axes = np.empty((len(XR_JOINTS), 3, 3))
    frames = _numpy(hand.frames)
    for index, name in enumerate(XR_JOINTS):
        if name.endswith("TIP"):
            axes[index] = axes[index - 1]
            continue
        ahead = {"PALM": "MIDDLE_PROXIMAL", "WRIST": "MIDDLE_METACARPAL"}.get(name)
        end = index + 1 if ahead is None else XR_JOINTS.index(ahead)
        moved_by = _MOVED_BY[index]
        dorsal = frames[moved_by - 1, :, 1] if moved_by else np.array([0.0, 1.0, 0.0])
        z = _unit(rest[index] - rest[end])
        y = _unit(dorsal - dorsal @ z * z)
        axes[index] = np.stack([np.cross(y, z), y, z], axis=1)
    return axes


def _orientations(
    local: Float[np.ndarray, "frame joint=15 3 3"],
) -> Float[np.ndarray, "frame joint=16 3 3"]:
    """Rotation of every joint's segment from rest, in the hand's frame."""
    found = [np.tile(np.eye(3), (len(local), 1, 1))]
    for joint in range(1, len(PARENTS)):
        found.append(found[PARENTS[joint]] @ local[:, joint - 1])
    return np.stack(found, axis=1)


def _radii(
    rest: Float[np.ndarray, "joint=26 3"], vertices: Float[np.ndarray, "vertex 3"], hand: HandModel
) -> Float[np.ndarray, " joint=26"]:
    # A tenth of a second, which other formats should not wait for.
    from trimesh.triangles import closest_point

    triangles = vertices[hand.faces.cpu().numpy()]
    nearest = [
        closest_point(triangles, np.tile(point, (len(triangles), 1)))  # type: ignore[no-untyped-call]
        for point in rest
    ]
    distances = np.linalg.norm(np.stack(nearest) - rest[:, None], axis=-1).min(axis=1)
    return np.maximum(distances, SMALLEST_RADIUS)


def _unit(vector: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    return np.asarray(vector / np.linalg.norm(vector))


def _numpy(tensor: torch.Tensor) -> Float[np.ndarray, "..."]:
    return tensor.detach().cpu().numpy().astype(np.float64)
