"""Anatomical rotation centres of the joints, their axes and neutral pose (docs/open_hand.md)."""

from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Float

from hand_recon.hand.anatomical_axes import ARCH, ORDER, axes_at_rest, trapezium_frame, unit
from open_hand.source import SourceHand

__all__ = ["ORDER", "SOURCE_ROW", "Skeleton", "build_skeleton", "fingertip", "tip_vertex", "unit"]

MCP_SHIFT = {"index": 0.0130, "middle": 0.0115, "ring": 0.0125, "little": 0.0120}
"""Distance of the MCP centres proximal of the rig's, metres; they lie about 2 cm proximal of the webs."""

DIP_SHIFT = {"index": 0.0025, "middle": 0.0015, "ring": 0.0025, "little": 0.0010}
"""Distance of the DIP centres distal of the rig's, metres; the rig's distal phalanges are too long."""

CMC_SHIFT = (0.0110, 0.0005, -0.0010)
"""Offset of the trapezium's saddle from the rig's CMC, metres; it gives the published metacarpal length."""

THUMB_MCP_SHIFT = 0.0025
"""Distance of the thumb's MCP centre distal of the rig's, metres."""

DORSAL_DEPTH = {"MCP": 0.0098, "PIP": 0.0072, "DIP": 0.0057}
"""Depth of the centre of the condyles under the dorsal skin, metres, for the middle finger."""

METACARPAL_OFFSET = {"index": 0.006, "middle": -0.001, "ring": 0.006, "little": -0.006}
"""Offset of each metacarpal base towards the thumb, metres; in the rig, neighbours share a base."""

SOURCE_ROW = {"thumb": 0, "index": 1, "middle": 2, "ring": 3, "little": 4}
"""Row of each finger in the source's order; `ORDER` is MANO's."""


@dataclass(frozen=True)
class Skeleton:
    """Rotation centres and axes of the joints at rest."""

    joints: Float[np.ndarray, "joint=16 3"]
    """Rotation centres, metres."""
    tips: Float[np.ndarray, "finger=5 3"]
    """Fingertips in MANO's order, metres."""
    frames: Float[np.ndarray, "joint=15 3 3"]
    """Axes of each child segment at rest, one per column: twist, splay, bend."""
    rest_angles: Float[np.ndarray, "joint=15 axis=3"]
    """Bend, splay and twist of the rest pose from the anatomical neutral, radians."""

    def bone(self, joint: int) -> Float[np.ndarray, "2 3"]:
        """Both ends of the segment distal of a joint, 1 to 15."""
        finger, part = divmod(joint - 1, 3)
        end = self.tips[finger] if part == 2 else self.joints[joint + 1]
        return np.stack([self.joints[joint], end])


def build_skeleton(source: SourceHand) -> Skeleton:
    """Place the rotation centres in the source mesh and give every joint its axes."""
    joints = np.zeros((16, 3))
    tips = np.zeros((5, 3))
    mesh = trimesh.Trimesh(source.vertices, source.faces, process=False)
    for position, finger in enumerate(ORDER):
        centres = _thumb_centres if finger == "thumb" else _finger_centres
        joints[1 + 3 * position : 4 + 3 * position] = centres(source, mesh, finger)
        tips[position] = fingertip(source, finger)
    frames, rest_angles = axes_at_rest(joints, tips)
    return Skeleton(joints, tips, frames, rest_angles)


def fingertip(source: SourceHand, finger: str) -> Float[np.ndarray, " 3"]:
    """Position of the fingertip, metres: the farthest vertex along the distal phalanx."""
    return np.asarray(source.vertices[tip_vertex(source, finger)])


def tip_vertex(source: SourceHand, finger: str) -> int:
    """Index of the fingertip in the source mesh."""
    row = SOURCE_ROW[finger]
    _, proximal, distal = source.rig_joints[row]
    own = np.flatnonzero(source.finger_weights[:, row] > 0.98)
    return int(own[np.argmax(source.vertices[own] @ (distal - proximal))])


def _finger_centres(
    source: SourceHand, mesh: trimesh.Trimesh, finger: str
) -> Float[np.ndarray, "3 3"]:
    row = SOURCE_ROW[finger]
    mcp, pip, dip = source.rig_joints[row]
    tip = fingertip(source, finger)
    base = source.metacarpal_bases[row] + np.array([0.0, 0.0, METACARPAL_OFFSET[finger]])
    mcp = mcp + MCP_SHIFT[finger] * unit(base - mcp)
    dip = dip + DIP_SHIFT[finger] * unit(tip - dip)
    thickness = 1.0 if finger == "middle" else {"index": 0.98, "ring": 0.95, "little": 0.85}[finger]
    centres = []
    for name, centre, along in (
        ("MCP", mcp, pip - mcp),
        ("PIP", pip, dip - mcp),
        ("DIP", dip, tip - pip),
    ):
        dorsal = _dorsal_of(along, finger)
        skin = _skin(mesh, centre, dorsal)
        centres.append(skin - thickness * DORSAL_DEPTH[name] * dorsal)
    return np.stack(centres)


def _dorsal_of(along: Float[np.ndarray, " 3"], finger: str) -> Float[np.ndarray, " 3"]:
    tilt = np.radians(ARCH[finger])
    dorsal = np.array([0.0, np.cos(tilt), np.sin(tilt)])
    return np.asarray(unit(dorsal - dorsal @ unit(along) * unit(along)))


def _skin(
    mesh: trimesh.Trimesh, inside: Float[np.ndarray, " 3"], direction: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, " 3"]:
    hits, _, _ = mesh.ray.intersects_location(inside[None], direction[None], multiple_hits=True)
    return np.asarray(hits[np.argmin(np.linalg.norm(hits - inside, axis=1))])


def _thumb_centres(
    source: SourceHand, mesh: trimesh.Trimesh, finger: str
) -> Float[np.ndarray, "3 3"]:
    cmc, mcp, ip = source.rig_joints[SOURCE_ROW[finger]]
    cmc = cmc + np.array(CMC_SHIFT)
    mcp = mcp + THUMB_MCP_SHIFT * unit(ip - mcp)
    nail = trapezium_frame(np.array([1.0, 0.0, 0.0]))[:, 1]
    centred = [cmc]
    for centre, along, share in (
        (mcp, ip - cmc, 0.45),
        (ip, fingertip(source, finger) - mcp, 0.42),
    ):
        dorsal = unit(nail - nail @ unit(along) * unit(along))
        back, palm = _skin(mesh, centre, dorsal), _skin(mesh, centre, -dorsal)
        side = np.cross(unit(along), dorsal)
        left, right = _skin(mesh, centre, side), _skin(mesh, centre, -side)
        sideways = 0.0 if share > 0.44 else ((left + right) / 2 - centre) @ side
        centred.append(back + share * (palm - back) + sideways * side)
    return np.stack(centred)
