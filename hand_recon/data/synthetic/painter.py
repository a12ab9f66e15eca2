"""Ray-cast rendering of a scene: surfaces, textures, light, background and sensor."""

from dataclasses import dataclass
from functools import cache
from typing import Final

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from hand_recon.camera import project_array
from hand_recon.data.synthetic.background import sample_background
from hand_recon.data.synthetic.light import CLOUDED, sample_lights, shade, sky_visibility
from hand_recon.data.synthetic.planes import length
from hand_recon.data.synthetic.recipe import Recipe
from hand_recon.data.synthetic.sensor import develop
from hand_recon.data.synthetic.skin import (
    SkinSpots,
    linear,
    paint_albedo,
    plainer,
    sample_paint,
    sample_tone,
    skin_albedo,
)
from hand_recon.data.synthetic.skin_map import SkinMap, skin_map
from hand_recon.data.synthetic.surface import OBJECT, SKIN, Surface, merged, vertex_normals
from hand_recon.hand.open_hand import open_hand
from hand_recon.rendering.rays import Hits, RayScene

_FAR: Final = 10.0
"""Depth of pixels without a surface, metres."""

_STEP: Final = 0.006
"""Depth difference between neighbouring pixels above which they are an outline, metres."""

_QUARTERS: Final = 0.25 * np.array([[-1, -1], [1, -1], [-1, 1], [1, 1]])
"""Middles of the quarters of a pixel, from its middle, pixels."""

_NORMAL, _SKY, _TEXTURE, _DORSAL, _KNUCKLE = slice(0, 3), 3, slice(4, 7), 7, 8


@cache
def _skin_map(landmark_set: str) -> SkinMap:
    return skin_map(open_hand(landmark_set))


@dataclass(frozen=True)
class _Features:
    """Vertex attributes of all surfaces, which are interpolated over the triangles."""

    corners: Float[np.ndarray, "vertex feature=9"]
    """Normal, sky visibility, texture coordinates, dorsal side and knuckle redness of each vertex."""
    faces: Int[np.ndarray, "face 3"]
    """Indices of the vertices of each triangle."""
    material: Int[np.ndarray, " face"]
    """Material of each triangle."""

    def at(self, hits: Hits) -> Float[np.ndarray, "hit feature=9"]:
        """Interpolate the features at ray hits."""
        corners = self.corners[self.faces[hits.face]]
        values = (hits.weights[:, None] @ corners)[:, 0]
        normals = np.ascontiguousarray(values[:, _NORMAL].T)
        values[:, _NORMAL] = (normals / np.maximum(length(normals), 1e-9)).T
        return values


def _features(
    surfaces: tuple[Surface, ...],
    scene: RayScene,
    skin: SkinMap,
    seen: Int[np.ndarray, " hit"],
) -> _Features:
    """Attributes of all vertices; the sky visibility is computed only where a triangle is seen."""
    vertices, faces = merged(surfaces)
    material = np.concatenate([np.full(len(s.faces), s.material) for s in surfaces])
    normals = vertex_normals(vertices, faces)
    shown, needed = np.zeros(len(faces), dtype=bool), np.zeros(len(vertices), dtype=bool)
    shown[seen] = True
    needed[faces[shown]] = True
    sky = np.zeros(len(vertices))
    sky[needed] = sky_visibility(scene, vertices[needed], normals[needed])
    dorsal, knuckle = np.zeros(len(vertices)), np.zeros(len(vertices))
    dorsal[: len(skin.dorsal)], knuckle[: len(skin.knuckle)] = skin.dorsal, skin.knuckle
    # The forearm has the colours of the back of the hand except on its palmar side.
    arm = slice(len(skin.dorsal), len(surfaces[0].vertices))
    dorsal[arm] = np.clip(surfaces[0].texture[arm, 1] / 0.02, -1, 1)
    texture = np.concatenate([s.texture for s in surfaces])
    columns = (normals, sky[:, None], texture, dorsal[:, None], knuckle[:, None])
    return _Features(np.concatenate(columns, axis=1).astype(np.float32), faces, material)


def render_image(
    recipe: Recipe,
    names: tuple[int, int],
    surfaces: tuple[Surface, ...],
    scene: RayScene,
    intrinsics: Float[np.ndarray, "3 3"],
) -> tuple[UInt8[np.ndarray, "height width 3"], Bool[np.ndarray, "height width"]]:
    """Render the surfaces; returns the image and a mask of the pixels that show skin.

    Args:
        recipe: Level, size and seed.
        names: Index of the image and index of its appearance.
        surfaces: Camera frame; the first is the hand with its forearm.
        scene: The same surfaces, for ray casting.
        intrinsics: Camera matrix, pixels of the crop.
    """
    index, appearance = names
    random = recipe.random(index, f"appearance {appearance}")
    size, level = recipe.crop_size, recipe.level
    samples = _cast_rays(scene, merged(surfaces)[0], intrinsics, size)
    colour, is_skin = _colours(random, recipe, index, surfaces, (scene, samples))
    behind = linear(sample_background(random, level, size, held_out=recipe.held_out))
    image = (1 - samples.sum_per_pixel(np.ones(len(is_skin)), size)) * behind
    for plane, light in zip(image, colour, strict=True):
        plane += samples.sum_per_pixel(light, size)
    return develop(random, level, image), samples.sum_per_pixel(is_skin, size) > 0.5


@dataclass(frozen=True)
class _Samples:
    """Surface samples of an image: one ray per pixel, four per pixel at outlines."""

    hits: Hits
    """Hits of the rays on surfaces."""
    points: Float[np.ndarray, "3 hit"]
    """Points of the hits in the camera's frame, metres."""
    pixel: Int[np.ndarray, " hit"]
    """Index of each hit's pixel, row by row."""
    weight: Float[np.ndarray, " hit"]
    """Weight of each hit in its pixel."""

    def sum_per_pixel(
        self, values: Float[np.ndarray, " hit"] | Bool[np.ndarray, " hit"], size: int
    ) -> Float[np.ndarray, "height width"]:
        """Weighted sum of the hits' values in each pixel of a square image."""
        sums = np.bincount(self.pixel, self.weight * values, minlength=size * size)
        return np.asarray(sums.reshape(size, size), dtype=np.float32)


def _cast_rays(
    scene: RayScene,
    vertices: Float[np.ndarray, "vertex 3"],
    intrinsics: Float[np.ndarray, "3 3"],
    size: int,
) -> _Samples:
    """Cast a ray through every pixel that may show the vertices, and four at depth discontinuities."""
    pixels, rays, columns = _camera_rays(vertices, intrinsics, size)
    centre = scene.nearest(np.zeros_like(rays), rays)
    depth = np.full(len(rays), _FAR, dtype=np.float32)
    depth[centre.ray] = centre.distance
    grid, window = depth.reshape(-1, columns), np.ones((3, 3), dtype=np.uint8)
    outline = (cv2.dilate(grid, window) - cv2.erode(grid, window) > _STEP).ravel()
    edge = np.flatnonzero(outline)
    finer = _finer(rays[edge], intrinsics)
    fine = scene.nearest(np.zeros_like(finer), finer)
    inside = np.flatnonzero(~outline[centre.ray])
    ray = centre.ray[inside]
    hits = Hits(
        np.concatenate([ray, fine.ray]),
        np.concatenate([centre.face[inside], fine.face]),
        np.concatenate([centre.weights[inside], fine.weights]),
        np.concatenate([centre.distance[inside], fine.distance]),
    )
    directions = np.concatenate([rays[ray], finer[fine.ray]])
    return _Samples(
        hits,
        np.ascontiguousarray(directions.T) * hits.distance,
        pixels[np.concatenate([ray, edge[fine.ray // len(_QUARTERS)]])],
        np.concatenate([np.ones(len(ray)), np.full(len(fine.ray), 1 / len(_QUARTERS))]),
    )


def _finer(
    rays: Float[np.ndarray, "ray 3"], intrinsics: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "quarter 3"]:
    """Rays through the middles of the quarters of pixels; those of one pixel follow each other."""
    finer = np.ones((len(rays), len(_QUARTERS), 3), dtype=np.float32)
    for axis in range(2):
        steps = (_QUARTERS[:, axis] / intrinsics[axis, axis]).astype(np.float32)
        finer[..., axis] = rays[:, axis, None] + steps
    return finer.reshape(-1, 3)


def _colours(
    random: np.random.Generator,
    recipe: Recipe,
    index: int,
    surfaces: tuple[Surface, ...],
    seen: tuple[RayScene, _Samples],
) -> tuple[Float[np.ndarray, "3 hit"], Bool[np.ndarray, " hit"]]:
    """Linear light that each hit reflects to the camera, and a mask of hits on skin."""
    scene, samples = seen
    hits = samples.hits
    skin, person = _skin_map(recipe.landmark_set), recipe.random(index, "skin and light")
    level = recipe.level
    tone = plainer(sample_tone(person, held_out=recipe.held_out), level)
    lights = sample_lights(person, level.cast_shadows) if level.varied_light else CLOUDED
    paints = {material: sample_paint(random) for material in range(SKIN + 1, OBJECT + 1)}
    features = _features(surfaces, scene, skin, hits.face)
    values, material = features.at(hits), features.material[hits.face]
    albedo = np.empty((3, len(material)), dtype=np.float32)
    is_skin = material == SKIN
    chosen = np.flatnonzero(is_skin)
    own, vertex = np.ascontiguousarray(values[chosen].T), features.faces[hits.face[chosen], 0]
    vertex = np.where(vertex < len(skin.dorsal), vertex, 0)
    spots = SkinSpots(own[_TEXTURE], own[_DORSAL], own[_KNUCKLE], vertex)
    albedo[:, chosen] = skin_albedo(tone, skin, spots)
    for which, paint in paints.items():
        chosen = np.flatnonzero(material == which)
        albedo[:, chosen] = paint_albedo(paint, values[chosen][:, _TEXTURE])
    sky = np.ascontiguousarray(values[:, _SKY])
    light, glint = shade(lights, scene, samples.points, values[:, _NORMAL], sky)
    light *= albedo
    light += glint * is_skin
    return light, is_skin


def _camera_rays(
    vertices: Float[np.ndarray, "vertex 3"], intrinsics: Float[np.ndarray, "3 3"], size: int
) -> tuple[Int[np.ndarray, " ray"], Float[np.ndarray, "ray 3"], int]:
    """Rays through the pixels in the bounding box of the projected vertices.

    Returns:
        Pixel index of each ray, row by row; direction with unit depth; number of rays in a row.
    """
    low, high = np.zeros(2), np.full(2, float(size))
    if vertices[:, 2].min() > 0.01:
        shown = project_array(vertices, intrinsics)
        low = np.clip(np.floor(shown.min(axis=0)) - 1, 0, size - 1)
        high = np.clip(np.ceil(shown.max(axis=0)) + 1, low + 1, size)
    columns, rows = np.arange(int(low[0]), int(high[0])), np.arange(int(low[1]), int(high[1]))
    grid = np.empty((len(rows), len(columns), 3), dtype=np.float32)
    # Pixel centres are at integers plus 0.5, so the image spans 0 to its size.
    grid[..., 0] = (columns + 0.5 - intrinsics[0, 2]) / intrinsics[0, 0]
    grid[..., 1] = ((rows + 0.5 - intrinsics[1, 2]) / intrinsics[1, 1])[:, None]
    grid[..., 2] = 1
    return (rows[:, None] * size + columns).ravel(), grid.reshape(-1, 3), len(columns)
