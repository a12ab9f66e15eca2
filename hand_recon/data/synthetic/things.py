"""Things that hide parts of a hand: held in the grasp, or in front of it."""

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
"""Landmarks around what a hand holds."""

_SMALLEST, _LARGEST = 0.008, 0.055


def _profile(random: np.random.Generator, radius: float) -> Float[np.ndarray, "point 2"]:
    """Outline of a bar, bottle, cup or ball of about that radius, metres."""
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
        turn = np.linspace(-np.pi / 2, np.pi / 2, 11)
        points = [(float(np.cos(t)), float(radius * np.sin(t))) for t in turn]
    outline = np.array(points, dtype=float)
    outline[:, 0] *= radius
    return outline


def held_thing(
    random: np.random.Generator,
    landmarks: Float[np.ndarray, "landmark=21 3"],
    vertices: Float[np.ndarray, "vertex 3"],
) -> Surface | None:
    """Something round across the palm, as thick as the grasp leaves room for.

    Args:
        random: Source of randomness.
        landmarks: Hand's frame, metres.
        vertices: The hand's surface in the same frame.

    Returns:
        Nothing when the hand leaves no room.
    """
    centre = landmarks[_GRASP].mean(axis=0) + random.normal(scale=0.004, size=3)
    across = np.array([0.0, 0.0, 1.0]) + random.normal(scale=0.15, size=3)
    across /= np.linalg.norm(across)
    offsets = vertices - centre
    beside = offsets - (offsets @ across)[:, None] * across
    room = float(np.linalg.norm(beside, axis=1).min()) + 0.002
    if room < _SMALLEST:
        return None
    thing = revolved(_profile(random, min(room, _LARGEST)))
    return _moved(thing, _to_axis(across), centre)


def front_thing(
    random: np.random.Generator, landmarks: Float[np.ndarray, "landmark=21 3"]
) -> Surface:
    """A bar, box or ball between the camera and a random landmark.

    Args:
        random: Source of randomness.
        landmarks: Camera's frame, metres.
    """
    target = landmarks[random.integers(len(landmarks))]
    nearest = landmarks[:, 2].min() - 0.03
    depth = max(random.uniform(0.75, 0.95) * nearest, 0.05)
    extent = float(np.ptp(landmarks[:, :2], axis=0).max()) * depth / target[2]
    centre = target * depth / target[2] + np.append(random.normal(scale=0.1, size=2) * extent, 0)
    kind = random.integers(3)
    if kind == 0:
        size = extent * np.array([random.uniform(0.08, 0.18), random.uniform(0.3, 0.7), 0.05])
        thing = box(size)
    elif kind == 1:
        radius = extent * random.uniform(0.04, 0.09)
        thing = revolved(np.array([[0, -1.2], [radius, -1.2], [radius, 1.2], [0, 1.2]]))
    else:
        thing = revolved(_profile(random, extent * random.uniform(0.08, 0.16)) * [1, 0.5])
    turn = axis_rotation(_unit(random), random.uniform(0, np.pi))
    if kind == 1:
        # A long bar that points at the camera would cover the picture.
        heading = random.uniform(0, np.pi)
        turn = _to_axis(np.array([np.cos(heading), np.sin(heading), 0.0]))
    return _moved(thing, turn, centre)


def _unit(random: np.random.Generator) -> Float[np.ndarray, " 3"]:
    direction = random.normal(size=3)
    return np.asarray(direction / np.linalg.norm(direction))


def _to_axis(axis: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 3"]:
    """A rotation that takes z to the axis."""
    helper = np.eye(3)[int(np.abs(axis).argmin())]
    first = np.cross(helper, axis)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first), axis], axis=1)


def _moved(
    surface: Surface, rotation: Float[np.ndarray, "3 3"], centre: Float[np.ndarray, " 3"]
) -> Surface:
    vertices = surface.vertices @ rotation.T + centre
    return Surface(vertices, surface.faces, surface.texture, surface.material)
