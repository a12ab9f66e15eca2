"""Ray-cast, shaded images of a hand mesh, without a display or graphics driver."""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from hand_recon.rendering.rays import Hits, RayScene

BLUE: Final = (120.0, 170.0, 225.0)
"""RGB colour of a hand, 0–255, where light falls on it straight."""

_LIGHT: Final = np.array([-0.35, -0.6, -0.72])
_SUPERSAMPLING: Final = 2
_FROM_THE_SIDE: Final = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
_FROM_ABOVE: Final = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


@dataclass(frozen=True)
class Shaded:
    """Image of a mesh without a background."""

    colour: Float[np.ndarray, "height width 3"]
    """RGB, 0–255, already multiplied by the coverage."""
    coverage: Float[np.ndarray, "height width 1"]
    """Share of each pixel that the mesh covers, 0–1."""

    def over(
        self, background: UInt8[np.ndarray, "height width 3"], opacity: float = 1.0
    ) -> UInt8[np.ndarray, "height width 3"]:
        """Blend the mesh over an image of the same size."""
        below = background.astype(np.float64) * (1 - opacity * self.coverage)
        blended: UInt8[np.ndarray, "height width 3"] = (
            (below + opacity * self.colour).round().clip(0, 255).astype(np.uint8)
        )
        return blended


def shade(
    vertices: Float[np.ndarray, "vertex 3"],
    faces: Int[np.ndarray, "face 3"],
    intrinsics: Float[np.ndarray, "3 3"],
    size: int,
    colour: tuple[float, float, float] = BLUE,
) -> Shaded:
    """Render a mesh.

    Args:
        vertices: Camera frame, metres.
        faces: Triangles.
        intrinsics: Camera matrix of a square image, pixels; pixel i covers [i, i + 1).
        size: Side of the image, pixels.
        colour: RGB, 0–255.
    """
    fine = size * _SUPERSAMPLING
    centres = (np.arange(fine) + 0.5) / _SUPERSAMPLING
    pixels = np.stack([*np.meshgrid(centres, centres), np.ones((fine, fine))], axis=-1)
    rays = (pixels @ np.linalg.inv(intrinsics).T).reshape(-1, 3)
    hits = RayScene(vertices, faces).nearest(np.zeros_like(rays), rays)
    lit = brightness(hits, rays, vertex_normals(vertices, faces), faces)
    image = np.zeros((fine * fine, 4))
    image[hits.ray, :3] = lit[:, None] * np.array(colour)
    image[hits.ray, 3] = 1.0
    small = cv2.resize(image.reshape(fine, fine, 4), (size, size), interpolation=cv2.INTER_AREA)
    return Shaded(small[..., :3], small[..., 3:])


def brightness(
    hits: Hits,
    rays: Float[np.ndarray, "ray 3"],
    normals: Float[np.ndarray, "vertex 3"],
    faces: Int[np.ndarray, "face 3"],
) -> Float[np.ndarray, " hit"]:
    """Share of the light that each hit sends back, 0 to 1, with normals smoothed over each triangle.

    Args:
        hits: Where rays meet the mesh.
        rays: Directions of all rays.
        normals: Unit normals of the vertices, of either sign.
        faces: Triangles.
    """
    smooth = np.einsum("hc,hcx->hx", hits.weights, normals[faces[hits.face]])
    smooth /= np.linalg.norm(smooth, axis=1, keepdims=True).clip(min=1e-12)
    # Normals face the camera for either winding, because the inside is visible through the open wrist.
    smooth *= np.where((smooth * rays[hits.ray]).sum(axis=1, keepdims=True) > 0, -1.0, 1.0)
    return 0.35 + 0.65 * (smooth @ (_LIGHT / np.linalg.norm(_LIGHT))).clip(min=0)


def from_the_side(
    vertices: Float[np.ndarray, "vertex 3"],
    faces: Int[np.ndarray, "face 3"],
    size: int,
    colour: tuple[float, float, float] = BLUE,
) -> UInt8[np.ndarray, "height width 3"]:
    """Render the mesh rotated by 90° about the vertical axis, scaled to fill a white image.

    This view shows errors in depth, which the projection to the image hides: depth goes to the right.

    Args:
        vertices: Camera frame, metres.
        faces: Triangles.
        size: Side of the image, pixels.
        colour: RGB, 0–255.
    """
    return _rotated(vertices, _FROM_THE_SIDE, size, faces, colour=colour)


def from_above(
    vertices: Float[np.ndarray, "vertex 3"],
    faces: Int[np.ndarray, "face 3"],
    size: int,
    colour: tuple[float, float, float] = BLUE,
) -> UInt8[np.ndarray, "height width 3"]:
    """Render the mesh seen from above, scaled to fill a white image: depth goes upwards.

    Args:
        vertices: Camera frame, metres.
        faces: Triangles.
        size: Side of the image, pixels.
        colour: RGB, 0–255.
    """
    return _rotated(vertices, _FROM_ABOVE, size, faces, colour=colour)


def _rotated(
    vertices: Float[np.ndarray, "vertex 3"],
    rotation: Float[np.ndarray, "3 3"],
    size: int,
    faces: Int[np.ndarray, "face 3"],
    *,
    colour: tuple[float, float, float],
) -> UInt8[np.ndarray, "height width 3"]:
    centred = vertices - (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    rotated = centred @ rotation.T
    focal, distance = 4.0 * size, 1.0
    # The extent is over all three axes, so that a hand seen end-on does not reach the camera.
    extent = np.abs(rotated).max() / 0.45
    rotated = rotated / extent * 0.25 + np.array([0.0, 0.0, distance])
    intrinsics = np.array([[focal, 0, size / 2], [0, focal, size / 2], [0, 0, 1.0]])
    white = np.full((size, size, 3), 255, dtype=np.uint8)
    return shade(rotated, faces, intrinsics, size, colour).over(white)


def vertex_normals(
    vertices: Float[np.ndarray, "vertex 3"], faces: Int[np.ndarray, "face 3"]
) -> Float[np.ndarray, "vertex 3"]:
    """Unit normals of the vertices, means of the adjacent triangles' normals weighted by area.

    Args:
        vertices: Vertices, any unit.
        faces: Triangles; normals point to the side from which they run anticlockwise.
    """
    corners = vertices[faces]
    weighted = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], weighted)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True).clip(min=1e-12)
