"""Shaded meshes on parts of a large image, with a depth test between them.

Rays are cast only inside the box of each mesh, and no more than `MOST_SAMPLES` of them: two by two in a pixel
where the boxes are small, one for several pixels, enlarged smoothly, where they are large.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from hand_recon.rendering.mesh import BLUE, brightness, vertex_normals
from hand_recon.rendering.rays import RayScene

MOST_SAMPLES: Final = 2_500_000
"""Most rays that are cast for the meshes of an image; about a second of one core."""

_NEAREST: Final = 1e-3
_RAYS_AT_ONCE: Final = 1 << 18
_ROWS_AT_ONCE: Final = 256


@dataclass(frozen=True)
class PlacedMesh:
    """A mesh in front of the camera of an image."""

    vertices: Float[np.ndarray, "vertex 3"]
    """Camera frame, metres."""
    faces: Int[np.ndarray, "face 3"]
    """Triangles, in either winding."""
    intrinsics: Float[np.ndarray, "3 3"]
    """Camera matrix of the image, pixels; pixel i covers [i, i + 1)."""
    colour: tuple[float, float, float] = BLUE
    """RGB, 0–255."""

    @property
    def distance(self) -> float:
        """Mean depth divided by the focal length: comparable for meshes under different assumed cameras."""
        return float(self.vertices[:, 2].mean() / self.intrinsics[0, 0])


@dataclass(frozen=True)
class ShadedWindow:
    """The visible part of a mesh in a rectangle of an image."""

    left: int
    """First column of the rectangle."""
    top: int
    """First row of the rectangle."""
    light: Float[np.ndarray, "height width"]
    """Brightness, 0 to 1, already multiplied by the coverage."""
    coverage: Float[np.ndarray, "height width"]
    """Share of each pixel that is covered, 0 to 1."""
    colour: tuple[float, float, float]
    """RGB, 0–255."""

    def blend_into(self, image: UInt8[np.ndarray, "_ _ 3"], opacity: float = 1.0) -> None:
        """Draw the mesh on an image, changing it.

        Args:
            image: RGB; it contains the rectangle.
            opacity: 0 to 1.
        """
        height, width = self.light.shape
        colour = np.array(self.colour, dtype=np.float32) * np.float32(opacity)
        for start in range(0, height, _ROWS_AT_ONCE):
            rows = slice(start, min(start + _ROWS_AT_ONCE, height))
            part = image[
                self.top + rows.start : self.top + rows.stop, self.left : self.left + width
            ]
            below = part * (1 - np.float32(opacity) * self.coverage[rows])[..., None]
            part[:] = (below + self.light[rows][..., None] * colour).round().clip(0, 255)


def shade_in_image(
    meshes: Sequence[PlacedMesh], width: int, height: int, most_samples: int = MOST_SAMPLES
) -> list[ShadedWindow]:
    """Render meshes that hide each other where one is nearer; far ones first.

    Meshes without a visible pixel are left out, as are those behind the camera or with vertices that are not
    finite.

    Args:
        meshes: Meshes, all in front of the same image.
        width: Width of the image, pixels.
        height: Height of the image, pixels.
        most_samples: Most rays that are cast; fewer make a coarser drawing in less time.
    """
    boxes = [(mesh, box) for mesh in meshes if (box := _box(mesh, width, height)) is not None]
    boxes.sort(key=lambda entry: -entry[0].distance)
    pixels = sum((box.right - box.left) * (box.bottom - box.top) for _, box in boxes)
    grid = _grid(pixels, most_samples)
    traced = [_trace(mesh, box, grid) for mesh, box in boxes]
    windows = []
    for index, part in enumerate(traced):
        others = [other for place, other in enumerate(traced) if place != index]
        if (visible := _visible(part, others)).any():
            windows.append(_in_pixels(part, visible, grid, (width, height)))
    return windows


@dataclass(frozen=True)
class _Box:
    """A rectangle of pixels or of samples."""

    left: int
    top: int
    right: int
    bottom: int


@dataclass(frozen=True)
class _Grid:
    """Positions of rays: `fine` a pixel in each direction, or one for `coarse` pixels."""

    fine: int
    coarse: int

    def samples(self, box: _Box) -> _Box:
        """The samples of a rectangle of pixels."""
        return _Box(
            box.left * self.fine // self.coarse,
            box.top * self.fine // self.coarse,
            -(-box.right * self.fine // self.coarse),
            -(-box.bottom * self.fine // self.coarse),
        )


@dataclass(frozen=True)
class _Traced:
    """A mesh seen along the rays of its box."""

    mesh: PlacedMesh
    samples: _Box
    light: Float[np.ndarray, "row column"]
    depth: Float[np.ndarray, "row column"]
    """Depth divided by the focal length; infinite beside the mesh."""


def _box(mesh: PlacedMesh, width: int, height: int) -> _Box | None:
    """The pixels that a mesh may cover; None if there are none."""
    depth = mesh.vertices[:, 2]
    if not np.isfinite(mesh.vertices).all() or (depth < _NEAREST).all():
        return None
    if (depth < _NEAREST).any():
        # The projection of what reaches behind the camera has no box.
        return _Box(0, 0, width, height)
    pixels = mesh.vertices @ mesh.intrinsics.T
    pixels = pixels[:, :2] / pixels[:, 2:]
    low = np.floor(pixels.min(axis=0)).clip(0, (width, height))
    high = np.ceil(pixels.max(axis=0)).clip(0, (width, height))
    if (high <= low).any():
        return None
    return _Box(int(low[0]), int(low[1]), int(high[0]), int(high[1]))


def _grid(pixels: int, most_samples: int) -> _Grid:
    if 4 * pixels <= most_samples:
        return _Grid(2, 1)
    return _Grid(1, math.ceil(math.sqrt(pixels / most_samples)))


def _trace(mesh: PlacedMesh, box: _Box, grid: _Grid) -> _Traced:
    samples, pixels = grid.samples(box), grid.coarse / grid.fine
    columns = (np.arange(samples.left, samples.right) + 0.5) * pixels
    rows = (np.arange(samples.top, samples.bottom) + 0.5) * pixels
    light = np.zeros((len(rows), len(columns)), dtype=np.float32)
    depth = np.full_like(light, np.inf)
    scene = RayScene(mesh.vertices, mesh.faces)
    normals = vertex_normals(mesh.vertices, mesh.faces)
    inverse = np.linalg.inv(mesh.intrinsics).T
    block = max(1, _RAYS_AT_ONCE // len(columns))
    for start in range(0, len(rows), block):
        u, v = np.meshgrid(columns, rows[start : start + block])
        rays = (np.stack([u, v, np.ones_like(u)], axis=-1) @ inverse).reshape(-1, 3)
        hits = scene.nearest(np.zeros_like(rays), rays)
        # Rays have length one along the optical axis, so that distances are depths.
        place = start * len(columns) + hits.ray
        light.reshape(-1)[place] = brightness(hits, rays, normals, mesh.faces)
        depth.reshape(-1)[place] = hits.distance / mesh.intrinsics[0, 0]
    return _Traced(mesh, samples, light, depth)


def _visible(part: _Traced, others: Sequence[_Traced]) -> Bool[np.ndarray, "row column"]:
    visible = np.isfinite(part.depth)
    own = part.samples
    for other in others:
        its = other.samples
        left, right = max(own.left, its.left), min(own.right, its.right)
        top, bottom = max(own.top, its.top), min(own.bottom, its.bottom)
        if left >= right or top >= bottom:
            continue
        here = (slice(top - own.top, bottom - own.top), slice(left - own.left, right - own.left))
        there = (slice(top - its.top, bottom - its.top), slice(left - its.left, right - its.left))
        visible[here] &= part.depth[here] <= other.depth[there]
    return visible


def _in_pixels(
    part: _Traced, visible: Bool[np.ndarray, "row column"], grid: _Grid, size: tuple[int, int]
) -> ShadedWindow:
    both = np.stack([part.light * visible, visible.astype(np.float32)], axis=-1)
    rows, columns = visible.shape
    shape = columns * grid.coarse // grid.fine, rows * grid.coarse // grid.fine
    if grid.fine > 1:
        both = np.asarray(cv2.resize(both, shape, interpolation=cv2.INTER_AREA))
    elif grid.coarse > 1:
        both = np.asarray(cv2.resize(both, shape, interpolation=cv2.INTER_LINEAR))
    left = part.samples.left * grid.coarse // grid.fine
    top = part.samples.top * grid.coarse // grid.fine
    both = both[: size[1] - top, : size[0] - left]
    return ShadedWindow(left, top, both[..., 0], both[..., 1], part.mesh.colour)
