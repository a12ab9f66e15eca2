"""Ray-cast, shaded images of a hand mesh, without a display or graphics driver."""

from dataclasses import dataclass
from typing import Final, Self

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from hand_recon.rendering.rays import Hits, RayScene

BLUE: Final = (120.0, 170.0, 225.0)
"""RGB colour of a hand, 0–255, where light falls on it straight."""

_LIGHT: Final = np.array([-0.35, -0.6, -0.72])
_SUPERSAMPLING: Final = 2
_FOCAL: Final = 4.0
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
    return RotatedView.from_the_side(vertices).render(vertices, faces, size, colour)


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
    return RotatedView.from_above(vertices).render(vertices, faces, size, colour)


@dataclass(frozen=True)
class RotatedView:
    """View of a mesh from another direction, scaled so that the mesh fills a square image."""

    matrix: Float[np.ndarray, "3 3"]
    """Rotation to the view's axes times the scale, 1 / metre."""
    centre: Float[np.ndarray, "3"]
    """Middle of the mesh's box, camera frame, metres."""

    @classmethod
    def of(
        cls, vertices: Float[np.ndarray, "vertex 3"], rotation: Float[np.ndarray, "3 3"]
    ) -> Self:
        """View in which a mesh fills the image.

        Args:
            vertices: Camera frame, metres.
            rotation: From the camera's axes to the view's.
        """
        centre = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
        # The extent is over all three axes, so that a hand seen end-on does not reach the camera.
        extent = np.abs((vertices - centre) @ rotation.T).max() / 0.45
        return cls(0.25 / extent * rotation, centre)

    @classmethod
    def from_the_side(cls, vertices: Float[np.ndarray, "vertex 3"]) -> Self:
        """View of `from_the_side`."""
        return cls.of(vertices, _FROM_THE_SIDE)

    @classmethod
    def from_above(cls, vertices: Float[np.ndarray, "vertex 3"]) -> Self:
        """View of `from_above`."""
        return cls.of(vertices, _FROM_ABOVE)

    def render(
        self,
        vertices: Float[np.ndarray, "vertex 3"],
        faces: Int[np.ndarray, "face 3"],
        size: int,
        colour: tuple[float, float, float] = BLUE,
    ) -> UInt8[np.ndarray, "height width 3"]:
        """Render a mesh on white; arguments as of `from_the_side`."""
        focal = _FOCAL * size
        intrinsics = np.array([[focal, 0, size / 2], [0, focal, size / 2], [0, 0, 1.0]])
        white = np.full((size, size, 3), 255, dtype=np.uint8)
        return shade(self._placed(vertices), faces, intrinsics, size, colour).over(white)

    def project(
        self, points: Float[np.ndarray, "point 3"], size: int
    ) -> Float[np.ndarray, "point 2"]:
        """Pixels of points in the rendered image, pixel i covering [i, i + 1).

        Args:
            points: Camera frame, metres.
            size: Side of the image, pixels.
        """
        placed = self._placed(points)
        return _FOCAL * size * placed[:, :2] / placed[:, 2:] + size / 2

    def project_covariance(
        self,
        points: Float[np.ndarray, "point 3"],
        covariance: Float[np.ndarray, "point 3 3"],
        size: int,
    ) -> Float[np.ndarray, "point 2 2"]:
        """Covariances of the pixels of points, to first order.

        Args:
            points: Camera frame, metres.
            covariance: Covariance of each point, camera's axes, square metres.
            size: Side of the image, pixels.
        """
        placed = self._placed(points)
        slope = np.zeros((len(points), 2, 3))
        slope[:, [0, 1], [0, 1]] = 1.0
        slope[:, :, 2] = -placed[:, :2] / placed[:, 2:]
        slope = _FOCAL * size / placed[:, 2, None, None] * slope @ self.matrix
        return slope @ covariance @ slope.transpose(0, 2, 1)

    def _placed(self, points: Float[np.ndarray, "point 3"]) -> Float[np.ndarray, "point 3"]:
        """Points in the frame of the view's camera, which is one unit away."""
        placed: Float[np.ndarray, "point 3"] = (points - self.centre) @ self.matrix.T
        return placed + np.array([0.0, 0.0, 1.0])


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
