"""Triangle surfaces for the renderer: hand with forearm, sleeve, and things to hold.

NumPy throughout: pictures are made in worker processes, one at a time.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float, Int

SKIN, CLOTH, THING = 0, 1, 2
FOREARM_LENGTH: Final = 0.26
FOREARM_RINGS: Final = 12
ELLIPSE: Final = (0.023, 0.030)
"""Half thickness and half breadth of the forearm near the wrist, metres."""


@dataclass(frozen=True)
class Surface:
    """Triangles with what shading needs at their corners."""

    vertices: Float[np.ndarray, "vertex 3"]
    """Metres; the frame is the caller's."""
    faces: Int[np.ndarray, "face 3"]
    """Counter-clockwise from outside."""
    texture: Float[np.ndarray, "vertex 3"]
    """Where a solid texture is looked up, metres: the rest pose's position for skin."""
    material: int
    """`SKIN`, `CLOTH` or `THING`."""


def vertex_normals(
    vertices: Float[np.ndarray, "vertex 3"], faces: Int[np.ndarray, "face 3"]
) -> Float[np.ndarray, "vertex 3"]:
    """Unit normals, weighted by the area of the triangles around each vertex."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    index = faces.ravel()
    spread = np.repeat(normals, 3, axis=0)
    sums = np.stack(
        [np.bincount(index, spread[:, axis], minlength=len(vertices)) for axis in range(3)], axis=1
    )
    return sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-12)


def merged(
    surfaces: tuple[Surface, ...],
) -> tuple[Float[np.ndarray, "vertex 3"], Int[np.ndarray, "face 3"]]:
    """Vertices and faces of all surfaces, one after another."""
    starts = np.cumsum([0, *(len(surface.vertices) for surface in surfaces)])
    faces = [s.faces + start for s, start in zip(surfaces, starts[:-1], strict=True)]
    return np.concatenate([s.vertices for s in surfaces]), np.concatenate(faces)


def tube_faces(rings: int, around: int, start: int = 0) -> Int[np.ndarray, "face 3"]:
    """Triangles between consecutive rings of a tube whose rings are stored one after another."""
    ring, step = np.meshgrid(np.arange(rings - 1), np.arange(around), indexing="ij")
    here = start + ring * around + step
    beside = start + ring * around + (step + 1) % around
    near = np.stack([here, beside, beside + around], axis=-1)
    far = np.stack([here, beside + around, here + around], axis=-1)
    return np.concatenate([near.reshape(-1, 3), far.reshape(-1, 3)])


@dataclass(frozen=True)
class Forearm:
    """How the forearm goes on from the wrist."""

    flexion: float
    """Of the wrist, radians, positive towards the palm."""
    deviation: float
    """Of the wrist, radians, positive towards the thumb."""
    girth: float
    """Breadth relative to `ELLIPSE`."""

    def centres(self, along: Float[np.ndarray, " ring"]) -> Float[np.ndarray, "ring 3"]:
        """Points of the centre line, from the wrist at 0, hand's axes, metres."""
        fine = np.linspace(0, along.max(), 64)
        steps = np.diff(fine, prepend=0.0)[:, None] * _direction(*self._turned(fine))
        line = np.cumsum(steps, axis=0)
        return np.stack([np.interp(along, fine, line[:, axis]) for axis in range(3)], axis=1)

    def axes(
        self, along: Float[np.ndarray, " ring"]
    ) -> tuple[Float[np.ndarray, "ring 3"], Float[np.ndarray, "ring 3"]]:
        """Directions across the forearm: to the back of the hand and to the thumb."""
        flexion, deviation = self._turned(along)
        direction = _direction(flexion, deviation)
        thumb = np.broadcast_to([0.0, 0.0, 1.0], direction.shape)
        back = np.cross(thumb, direction)
        back /= np.linalg.norm(back, axis=1, keepdims=True)
        return back, np.cross(direction, back)

    def _turned(
        self, along: Float[np.ndarray, " ring"]
    ) -> tuple[Float[np.ndarray, " ring"], Float[np.ndarray, " ring"]]:
        """The wrist bends over its first five centimetres."""
        share = np.clip(along / 0.05, 0, 1)
        return self.flexion * share, self.deviation * share


def _direction(
    flexion: Float[np.ndarray, " ring"], deviation: Float[np.ndarray, " ring"]
) -> Float[np.ndarray, "ring 3"]:
    """Towards the elbow; flexing the wrist to the palm leaves the elbow on the palm's side."""
    return np.stack(
        [
            np.cos(flexion) * np.cos(deviation),
            -np.sin(flexion) * np.cos(deviation),
            np.sin(deviation),
        ],
        axis=1,
    )


def with_forearm(hand: Surface, ring: Int[np.ndarray, " ring"], forearm: Forearm) -> Surface:
    """The hand with a forearm grown from its open wrist.

    Args:
        hand: In the hand's frame.
        ring: Its open boundary, as `HandAsset.wrist_ring`.
        forearm: How it goes on.
    """
    start = hand.vertices[ring]
    wrist = start.mean(axis=0)
    along = np.linspace(0, 1, FOREARM_RINGS + 1)[1:] ** 1.5 * FOREARM_LENGTH
    offsets = start - wrist
    angle = np.arctan2(offsets[:, 2] / ELLIPSE[1], offsets[:, 1] / ELLIPSE[0])
    back, thumb = forearm.axes(along)
    size = forearm.girth * (1 + 0.9 * along)[:, None, None]
    round_ring = size * (
        ELLIPSE[0] * np.cos(angle)[:, None] * back[:, None]
        + ELLIPSE[1] * np.sin(angle)[:, None] * thumb[:, None]
    )
    own_ring = offsets[:, 1, None] * back[:, None] + offsets[:, 2, None] * thumb[:, None]
    share = np.clip(along / 0.06, 0, 1)[:, None, None]
    share = share * share * (3 - 2 * share)
    rings = own_ring * (1 - share) + round_ring * share
    points = (wrist + forearm.centres(along)[:, None] + rings).reshape(-1, 3)
    vertices = np.concatenate([hand.vertices, points])
    first = len(hand.vertices)
    seam = tube_faces(2, len(ring))
    joined = np.concatenate([ring, first + np.arange(len(ring))])
    faces = np.concatenate(
        [hand.faces, joined[seam], tube_faces(FOREARM_RINGS, len(ring), start=first)]
    )
    return Surface(vertices, faces, np.concatenate([hand.texture, points]), SKIN)


def sleeve(wrist: Float[np.ndarray, " 3"], forearm: Forearm, begin: float, width: float) -> Surface:
    """A sleeve around the forearm, with a rolled hem.

    Args:
        wrist: Centre of the wrist's boundary, hand's frame, metres.
        forearm: What it covers.
        begin: Where it ends towards the hand, metres from the wrist.
        width: Relative to the forearm, more than one.
    """
    along = np.concatenate([[begin + 0.004], np.linspace(begin, FOREARM_LENGTH + 0.05, 10)])
    centres = forearm.centres(along)
    back, thumb = forearm.axes(along)
    angle = np.linspace(0, 2 * np.pi, 28, endpoint=False)
    size = (width * forearm.girth * (1 + 0.9 * along))[:, None, None]
    rings = size * (
        ELLIPSE[0] * 1.1 * np.cos(angle)[:, None] * back[:, None]
        + ELLIPSE[1] * np.sin(angle)[:, None] * thumb[:, None]
    )
    points = (wrist + centres[:, None] + rings).reshape(-1, 3)
    texture = np.stack(
        np.broadcast_arrays(along[:, None], 0.03 * np.cos(angle), 0.03 * np.sin(angle)), axis=-1
    ).reshape(-1, 3)
    return Surface(points, tube_faces(len(along), len(angle)), texture, CLOTH)


def revolved(profile: Float[np.ndarray, "point 2"], around: int = 24) -> Surface:
    """A solid of revolution about z: balls, bottles, cups, bars.

    Args:
        profile: Radius and height of the outline from the bottom up, metres. A repeated point makes a
            sharp edge.
        around: Number of facets.
    """
    angle = np.linspace(0, 2 * np.pi, around, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = np.concatenate(
        [
            profile[:, None, :1] * circle,
            np.broadcast_to(profile[:, None, 1:], (len(profile), around, 1)),
        ],
        axis=2,
    ).reshape(-1, 3)
    return Surface(points, tube_faces(len(profile), around), points, THING)


def box(size: Float[np.ndarray, " 3"]) -> Surface:
    """A box around the origin with sharp edges: every side has corners of its own.

    Args:
        size: Edge lengths, metres.
    """
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2
    sides = []
    for axis in range(3):
        for sign in (-1, 1):
            side = np.insert(square[::sign], axis, sign / 2, axis=1)
            sides.append(side if axis != 1 else side[::-1])
    vertices = np.concatenate(sides) * size
    quad = np.array([[0, 1, 2], [0, 2, 3]])
    faces = np.concatenate([quad + 4 * side for side in range(6)])
    return Surface(vertices, faces, vertices, THING)
