"""Skin features on the rest pose of a hand: sides, redness, nails and creases."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from hand_recon.data.synthetic.surface import vertex_normals
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import ARTICULATED, LANDMARKS, TIPS

NAIL: Final = np.array([0.0055, 0.0047], dtype=np.float32)
"""Half length and half width of the middle finger's nail, metres."""

CREASE: Final = np.float32(0.0009)
"""Distance from a crease's middle at which its strength is 1/e, metres."""

CREASE_REACH: Final = np.array([0.0038, 0.013, 0.012], dtype=np.float32)
"""Half size of the box around a joint that holds its crease, metres: along the finger, dorsal, across.

Along the finger, a crease that is farther from its middle changes no albedo in single precision.
"""

NAIL_BED: Final = np.float32(-0.0035)
"""Least height of a nail's points above its centre, metres."""

_NAIL_SIZES: Final = np.array([1.2, 1.0, 1.0, 0.95, 0.8], dtype=np.float32)

_MARGIN: Final = 1e-5
"""Distance, metres, that covers all errors of rounding."""


@dataclass(frozen=True)
class SkinMap:
    """Positions of skin features on the rest pose of one hand asset."""

    dorsal: Float[np.ndarray, " vertex"]
    """Side of each vertex, from 1 on the dorsal to −1 on the palmar side of its segment."""
    knuckle: Float[np.ndarray, " vertex"]
    """Redness, 0–1, over the backs of joints and on the pads of the fingertips."""
    nail_frames: Float[np.ndarray, "finger=5 3 3"]
    """Axes of each nail in rows: towards the tip, dorsal, across."""
    nail_centres: Float[np.ndarray, "finger=5 3"]
    """Centre of each nail, metres."""
    nail_size: Float[np.ndarray, " finger=5"]
    """Size relative to the middle finger's nail."""
    nail_of: Int[np.ndarray, " vertex"]
    """Finger of the nearest nail."""
    nailed: Bool[np.ndarray, " vertex"]
    """True for vertices that begin a triangle which a nail may cover."""
    joints: Float[np.ndarray, "crease=9 3"]
    """Centre of each crease, metres."""
    frames: Float[np.ndarray, "crease=9 3 3"]
    """Axes of each crease in rows: towards the wrist, dorsal, across."""
    crease_of: Int[np.ndarray, " vertex"]
    """Index of the nearest crease."""
    creased: Bool[np.ndarray, " vertex"]
    """True for vertices that begin a triangle which a crease may cross."""


def skin_map(model: HandModel) -> SkinMap:
    """Compute the skin map from a hand's rest pose."""
    rest_vertices, rest_joints = (
        tensor.numpy().astype(float)
        for tensor in model.rest(model.template.new_zeros(model.shape_directions.shape[-1]))
    )
    frames = model.frames.numpy().astype(float)
    normals = _normals(model, rest_vertices)
    owner = model.skinning_weights.argmax(dim=1).numpy()
    back = np.concatenate([[[0.0, 1.0, 0.0]], frames[:, :, 1]])[owner]
    dorsal = (normals * back).sum(axis=1)
    tips = _tips(model, rest_vertices, rest_joints)
    red = np.concatenate([rest_joints[1:], tips])
    distance = np.linalg.norm(rest_vertices[:, None] - red, axis=2)
    strength = np.where(np.arange(len(red)) < len(ARTICULATED), 1.0, 0.8)
    over = np.clip(dorsal, 0, 1)[:, None] * (np.arange(len(red)) < len(ARTICULATED))
    over = over + (np.arange(len(red)) >= len(ARTICULATED))
    knuckle = (np.exp(-((distance / 0.009) ** 2)) * strength * over).max(axis=1)
    last = [ARTICULATED.index(_last_joint(tip)) for tip in TIPS]
    nail_frames = np.stack([frames[j].T * [[-1.0], [1.0], [1.0]] for j in last])
    thickness = np.array(
        [_thickness(rest_vertices, t, f) for t, f in zip(tips, nail_frames, strict=True)]
    )
    centres = tips - 0.0065 * nail_frames[:, 0] + thickness[:, None] * nail_frames[:, 1]
    bent = [i for i, name in enumerate(ARTICULATED) if not name.endswith(("MCP", "CMC"))]
    joints, crease_frames = rest_joints[1:][bent], frames[bent].transpose(0, 2, 1)
    nail_of, crease_of = _nearest(rest_vertices, centres), _nearest(rest_vertices, joints)
    sides = NAIL * _NAIL_SIZES[nail_of, None]
    nail_box = np.stack([sides[:, 0], np.full(len(sides), np.inf), sides[:, 1]], axis=1)
    nail_low = np.stack([-sides[:, 0], np.full(len(sides), NAIL_BED), -sides[:, 1]], axis=1)
    mesh = rest_vertices, model.faces.numpy()
    return SkinMap(
        dorsal,
        knuckle,
        nail_frames.astype(np.float32),
        centres.astype(np.float32),
        _NAIL_SIZES,
        nail_of,
        _begins_in_box(mesh, centres[nail_of], nail_frames[nail_of], (nail_low, nail_box)),
        joints.astype(np.float32),
        crease_frames.astype(np.float32),
        crease_of,
        _begins_in_box(
            mesh, joints[crease_of], crease_frames[crease_of], (-CREASE_REACH, CREASE_REACH)
        ),
    )


def _begins_in_box(
    mesh: tuple[Float[np.ndarray, "vertex 3"], Int[np.ndarray, "face 3"]],
    origins: Float[np.ndarray, "vertex 3"],
    frames: Float[np.ndarray, "vertex 3 3"],
    box: tuple[Float[np.ndarray, "*vertex 3"], Float[np.ndarray, "*vertex 3"]],
) -> Bool[np.ndarray, " vertex"]:
    """Find the vertices that begin a triangle which reaches into their box.

    Args:
        mesh: Vertices, metres, and triangles.
        origins: Origin of each vertex's frame, metres.
        frames: Axes of each vertex's frame in rows.
        box: Lowest and highest coordinates of each vertex's box, in its frame.
    """
    vertices, faces = mesh
    first = faces[:, 0]
    local = np.einsum("fij,fcj->fci", frames[first], vertices[faces] - origins[first][:, None])
    low, high = (np.broadcast_to(end, vertices.shape)[first] for end in box)
    # A coordinate is linear over a triangle: its extremes are at the corners.
    reaches = (local.min(axis=1) < high + _MARGIN) & (local.max(axis=1) > low - _MARGIN)
    found = np.zeros(len(vertices), dtype=bool)
    found[first[reaches.all(axis=1)]] = True
    return found


def _nearest(
    points: Float[np.ndarray, "point 3"], targets: Float[np.ndarray, "target 3"]
) -> Int[np.ndarray, " point"]:
    return np.asarray(np.linalg.norm(points[:, None] - targets, axis=2).argmin(axis=1))


def _thickness(
    vertices: Float[np.ndarray, "vertex 3"],
    tip: Float[np.ndarray, " 3"],
    frame: Float[np.ndarray, "3 3"],
) -> float:
    """Height of the dorsal surface of a fingertip above its landmark, metres."""
    local = (vertices - tip) @ frame.T
    near = (np.abs(local[:, 0] + 0.006) < 0.006) & (np.abs(local[:, 2]) < 0.008)
    near &= np.abs(local[:, 1]) < 0.015
    return float(local[near, 1].max()) if near.any() else 0.004


def _last_joint(tip: int) -> str:
    return LANDMARKS[tip - 1]


def _tips(
    model: HandModel,
    vertices: Float[np.ndarray, "vertex 3"],
    joints: Float[np.ndarray, "joint=16 3"],
) -> Float[np.ndarray, "finger=5 3"]:
    regressor = model.landmark_regressor.numpy().astype(float)
    return np.asarray((regressor @ np.concatenate([vertices, joints]))[list(TIPS)])


def _normals(
    model: HandModel, vertices: Float[np.ndarray, "vertex 3"]
) -> Float[np.ndarray, "vertex 3"]:
    return vertex_normals(vertices, model.faces.numpy())
