"""Triangle meshes for the renderer: hand with forearm, sleeve and objects.

All arrays are NumPy's, since images are rendered one at a time in worker processes.
"""

from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from hand_recon.data.synthetic.planes import cross, length

SKIN, CLOTH, OBJECT = 0, 1, 2
FOREARM_LENGTH: Final = 0.26
FOREARM_RINGS: Final = 12
ELLIPSE: Final = (0.023, 0.030)
"""Half thickness and half width of the forearm near the wrist, metres."""


@dataclass(frozen=True)
class Surface:
    """Triangle mesh with texture coordinates and a material."""

    vertices: Float[np.ndarray, "vertex 3"]
    """Vertices, metres, in the frame that the caller chooses."""
    faces: Int[np.ndarray, "face 3"]
    """Triangles, counter-clockwise from outside."""
    texture: Float[np.ndarray, "vertex 3"]
    """3D texture coordinates, metres; for skin, positions in the rest pose."""
    material: int
    """`SKIN`, `CLOTH` or `OBJECT`."""


def vertex_normals(
    vertices: Float[np.ndarray, "vertex 3"], faces: Int[np.ndarray, "face 3"]
) -> Float[np.ndarray, "vertex 3"]:
    """Unit normals, weighted by the area of the triangles around each vertex."""
    first, second, third = (vertices.T[:, corner] for corner in faces.T)
    normals = np.repeat(cross(second - first, third - first), 3, axis=1)
    index = faces.ravel()
    sums = np.stack([np.bincount(index, plane, minlength=len(vertices)) for plane in normals])
    return np.ascontiguousarray((sums / np.maximum(length(sums), 1e-12)).T)


def merged(
    surfaces: tuple[Surface, ...],
) -> tuple[Float[np.ndarray, "vertex 3"], Int[np.ndarray, "face 3"]]:
    """Concatenate the vertices and faces of surfaces."""
    starts = np.cumsum([0, *(len(surface.vertices) for surface in surfaces)])
    faces = [s.faces + start for s, start in zip(surfaces, starts[:-1], strict=True)]
    return np.concatenate([s.vertices for s in surfaces]), np.concatenate(faces)


@cache
def tube_faces(rings: int, around: int, start: int = 0) -> Int[np.ndarray, "face 3"]:
    """Triangles between consecutive rings of a tube whose rings are stored one after another.

    The array is shared by all callers and cannot be written to.
    """
    ring, step = np.meshgrid(np.arange(rings - 1), np.arange(around), indexing="ij")
    here = start + ring * around + step
    beside = start + ring * around + (step + 1) % around
    near = np.stack([here, beside, beside + around], axis=-1)
    far = np.stack([here, beside + around, here + around], axis=-1)
    faces = np.concatenate([near.reshape(-1, 3), far.reshape(-1, 3)])
    faces.flags.writeable = False
    return faces


@dataclass(frozen=True)
class Forearm:
    """Direction and thickness of the forearm."""

    flexion: float
    """Flexion of the wrist, radians, positive towards the palm."""
    deviation: float
    """Deviation of the wrist, radians, positive towards the thumb."""
    girth: float
    """Thickness relative to `ELLIPSE`."""

    def centres(self, along: Float[np.ndarray, " ring"]) -> Float[np.ndarray, "ring 3"]:
        """Points of the centre line, from the wrist at 0, hand's axes, metres."""
        fine = np.linspace(0, along.max(), 64)
        steps = _direction(*self._wrist_angles(fine))
        steps[:, 1:] *= fine[1:] - fine[:-1]
        steps[:, 0] = 0
        line = np.cumsum(steps, axis=1)
        return np.stack([np.interp(along, fine, plane) for plane in line], axis=1)

    def axes(
        self, along: Float[np.ndarray, " ring"]
    ) -> tuple[Float[np.ndarray, "ring 3"], Float[np.ndarray, "ring 3"]]:
        """Dorsal direction and direction towards the thumb at points along the forearm."""
        flexion, deviation = self._wrist_angles(along)
        direction = _direction(flexion, deviation)
        back = cross(np.array([[0.0], [0.0], [1.0]]), direction)
        back /= length(back)
        return back.T, cross(direction, back).T

    def _wrist_angles(
        self, along: Float[np.ndarray, " ring"]
    ) -> tuple[Float[np.ndarray, " ring"], Float[np.ndarray, " ring"]]:
        """Flexion and deviation along the forearm, which increase over the first five centimetres."""
        share = np.clip(along / 0.05, 0, 1)
        return self.flexion * share, self.deviation * share


def _direction(
    flexion: Float[np.ndarray, " ring"], deviation: Float[np.ndarray, " ring"]
) -> Float[np.ndarray, "3 ring"]:
    """Unit vector towards the elbow; palmar flexion moves the elbow to the palmar side."""
    return np.stack(
        [
            np.cos(flexion) * np.cos(deviation),
            -np.sin(flexion) * np.cos(deviation),
            np.sin(deviation),
        ]
    )


def with_forearm(hand: Surface, ring: Int[np.ndarray, " ring"], forearm: Forearm) -> Surface:
    """Attach a forearm to the open wrist of a hand.

    Args:
        hand: Surface in the hand's frame.
        ring: Open boundary, as `HandAsset.wrist_ring`.
        forearm: Direction and thickness of the forearm.
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
    """Make a sleeve around the forearm, with a rolled hem.

    Args:
        wrist: Centre of the wrist's boundary, hand's frame, metres.
        forearm: The forearm inside.
        begin: Distance of the hem from the wrist, metres.
        width: Width relative to the forearm, more than one.
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
    """Make a solid of revolution about z: a ball, bottle, cup or bar.

    Args:
        profile: Radius and height along the outline, bottom first, metres. A repeated point makes a
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
    return Surface(points, tube_faces(len(profile), around), points, OBJECT)


def box(size: Float[np.ndarray, " 3"]) -> Surface:
    """Make a box around the origin; sides do not share vertices, so that its edges are sharp.

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
    return Surface(vertices, faces, vertices, OBJECT)
