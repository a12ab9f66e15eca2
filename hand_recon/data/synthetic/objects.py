"""Objects that occlude a hand: held in the grasp, or between camera and hand."""

import numpy as np
from jaxtyping import Float

from hand_recon.data.synthetic.surface import Surface, box, revolved
from hand_recon.data.synthetic.view import axis_rotation
from hand_recon.hand.skeleton import LANDMARKS

_GRASP = [
    LANDMARKS.index(name)
    for name in (
        "thumb tip", "thumb IP", "index DIP", "middle DIP", "ring DIP", "index MCP", "middle MCP",
        "little MCP",
    )
]  # fmt: skip
"""Landmarks around a held object."""

_SMALLEST, _LARGEST = 0.008, 0.055


def _profile(random: np.random.Generator, radius: float) -> Float[np.ndarray, "point 2"]:
    """Outline of a bar, bottle, cup or ball with about the given radius, metres."""
    points: list[tuple[float, float]]
    kind = random.integers(4)
    half = random.uniform(0.05, 0.12)
    if kind == 0:
        points = [(0, -half), (1, -half), (1, -half), (1, half), (1, half), (0, half)]
    elif kind == 1:
        neck = random.uniform(0.3, 0.5)
        points = [(0, -half), (1, -half), (1, -half), (1, 0.3 * half), (0.9, 0.5 * half),
                  (neck, 0.8 * half), (neck, 1.3 * half), (neck, 1.3 * half), (0, 1.3 * half)]  # fmt: skip
    elif kind == 2:
        rim = random.uniform(1.1, 1.4)
        points = [(0, -half), (1, -half), (1, -half), (rim, half), (rim, half), (0, half)]
    else:
        angles = np.linspace(-np.pi / 2, np.pi / 2, 11)
        points = [(float(np.cos(t)), float(radius * np.sin(t))) for t in angles]
    outline = np.array(points, dtype=float)
    outline[:, 0] *= radius
    return outline


def held_object(
    random: np.random.Generator,
    landmarks: Float[np.ndarray, "landmark=21 3"],
    vertices: Float[np.ndarray, "vertex 3"],
) -> Surface | None:
    """Make a solid of revolution across the palm, as thick as the grasp allows.

    Args:
        random: Source of randomness.
        landmarks: Hand's frame, metres.
        vertices: Vertices of the hand in the same frame.

    Returns:
        The object, or None if the grasp leaves no room.
    """
    centre = landmarks[_GRASP].mean(axis=0) + random.normal(scale=0.004, size=3)
    across = np.array([0.0, 0.0, 1.0]) + random.normal(scale=0.15, size=3)
    across /= np.linalg.norm(across)
    offsets = vertices - centre
    beside = offsets - (offsets @ across)[:, None] * across
    room = float(np.linalg.norm(beside, axis=1).min()) + 0.002
    if room < _SMALLEST:
        return None
    solid = revolved(_profile(random, min(room, _LARGEST)))
    return _transformed(solid, _to_axis(across), centre)


def front_object(
    random: np.random.Generator, landmarks: Float[np.ndarray, "landmark=21 3"]
) -> Surface:
    """Make a bar, box or other solid between the camera and a random landmark.

    Args:
        random: Source of randomness.
        landmarks: Camera frame, metres.
    """
    target = landmarks[random.integers(len(landmarks))]
    nearest = landmarks[:, 2].min() - 0.03
    depth = max(random.uniform(0.75, 0.95) * nearest, 0.05)
    extent = float(np.ptp(landmarks[:, :2], axis=0).max()) * depth / target[2]
    centre = target * depth / target[2] + np.append(random.normal(scale=0.1, size=2) * extent, 0)
    kind = random.integers(3)
    if kind == 0:
        size = extent * np.array([random.uniform(0.08, 0.18), random.uniform(0.3, 0.7), 0.05])
        solid = box(size)
    elif kind == 1:
        radius = extent * random.uniform(0.04, 0.09)
        solid = revolved(np.array([[0, -1.2], [radius, -1.2], [radius, 1.2], [0, 1.2]]))
    else:
        solid = revolved(_profile(random, extent * random.uniform(0.08, 0.16)) * [1, 0.5])
    rotation = axis_rotation(_unit(random), random.uniform(0, np.pi))
    if kind == 1:
        # A long bar that points at the camera would cover the whole image.
        heading = random.uniform(0, np.pi)
        rotation = _to_axis(np.array([np.cos(heading), np.sin(heading), 0.0]))
    return _transformed(solid, rotation, centre)


def _unit(random: np.random.Generator) -> Float[np.ndarray, " 3"]:
    direction = random.normal(size=3)
    return np.asarray(direction / np.linalg.norm(direction))


def _to_axis(axis: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 3"]:
    """Rotation that takes the z axis to the given axis."""
    helper = np.eye(3)[int(np.abs(axis).argmin())]
    first = np.cross(helper, axis)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first), axis], axis=1)


def _transformed(
    surface: Surface, rotation: Float[np.ndarray, "3 3"], centre: Float[np.ndarray, " 3"]
) -> Surface:
    vertices = surface.vertices @ rotation.T + centre
    return Surface(vertices, surface.faces, surface.texture, surface.material)
