"""Shading: key light, fill light, sky with ambient occlusion, and specular highlights."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from hand_recon.data.synthetic.planes import cross, length, mixed
from hand_recon.rendering.rays import RayScene

_LIFT: Final = 0.002
"""Offset of secondary rays above the surface, metres, so that coarse triangles do not shadow themselves."""

_WRAP: Final = np.array([0.32, 0.18, 0.14], dtype=np.float32)
"""Wrap lighting of skin by channel: subsurface scattering carries red light farthest past the terminator."""


def _sky_directions(count: int) -> Float[np.ndarray, "ray 3"]:
    """Cosine-weighted directions of the hemisphere about z, spread by the golden angle."""
    share = (np.arange(count) + 0.5) / count
    radius, angle = np.sqrt(share), np.pi * (1 + 5**0.5) * np.arange(count)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - share)], axis=1)


_SKY: Final = _sky_directions(12)


@dataclass(frozen=True)
class Lights:
    """Lights of one image; directions point towards the light, in the camera's frame."""

    key_direction: Float[np.ndarray, " 3"]
    """Direction of the key light, unit vector."""
    key_colour: Float[np.ndarray, " 3"]
    """Colour of the key light, linear; 1 is fully lit white paper."""
    fill_direction: Float[np.ndarray, " 3"]
    """Direction of the fill light, unit vector."""
    fill_colour: Float[np.ndarray, " 3"]
    """Colour of the fill light, linear."""
    sky: Float[np.ndarray, " 3"]
    """Ambient light from above, linear."""
    ground: Float[np.ndarray, " 3"]
    """Ambient light from below, linear."""
    sheen: float
    """Strength of the specular highlight on skin."""
    shadows: bool
    """True if the key light casts shadows."""


CLOUDED: Final = Lights(
    key_direction=np.array([0.0, -0.6, -0.8], dtype=np.float32),
    key_colour=np.full(3, 0.6, dtype=np.float32),
    fill_direction=np.array([0.0, 0.0, -1.0], dtype=np.float32),
    fill_colour=np.full(3, 0.15, dtype=np.float32),
    sky=np.full(3, 0.3, dtype=np.float32),
    ground=np.full(3, 0.18, dtype=np.float32),
    sheen=0.05,
    shadows=False,
)
"""White light from above and from the camera, without shadows."""


def sample_lights(random: np.random.Generator, cast_shadows: float) -> Lights:
    """Draw lights with warm or cool tints, as indoors or outdoors.

    Args:
        random: Source of randomness.
        cast_shadows: Probability that the key light casts shadows.
    """
    warm = random.uniform(-0.12, 0.12)
    tint = np.array([1 + warm, 1.0, 1 - warm])
    key = random.uniform(0.45, 0.95)
    ambient = random.uniform(0.16, 0.42)
    warm_tint, cool = tint.astype(np.float32), tint[::-1].astype(np.float32)
    return Lights(
        key_direction=_unit(random.uniform([-1, -1, -1], [1, 0.35, -0.25])),
        key_colour=key * warm_tint,
        fill_direction=_unit(random.uniform([-1, -0.6, -1], [1, 0.8, -0.1])),
        fill_colour=random.uniform(0.05, 0.3) * cool,
        sky=ambient * cool,
        ground=ambient * random.uniform(0.35, 0.8) * warm_tint,
        sheen=random.uniform(0.02, 0.14),
        shadows=random.random() < cast_shadows,
    )


def _unit(vector: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 3"]:
    return np.asarray(vector / np.linalg.norm(vector), dtype=np.float32)


def sky_visibility(
    scene: RayScene,
    points: Float[np.ndarray, "vertex 3"],
    normals: Float[np.ndarray, "vertex 3"],
    reach: float = 0.05,
) -> Float[np.ndarray, " vertex"]:
    """Unoccluded share of the hemisphere over each point (ambient occlusion), 0–1.

    Args:
        scene: Surfaces that occlude.
        points: Points on the surface, metres.
        normals: Unit vectors.
        reach: Largest distance of an occluder, metres.
    """
    helper = np.where(np.abs(normals[:, 0]) < 0.7, [[1.0], [0.0], [0.0]], [[0.0], [1.0], [0.0]])
    first = cross(helper, normals.T)
    first /= np.maximum(length(first), 1e-12)
    frames = np.stack([first, cross(normals.T, first), normals.T])
    directions = _SKY @ np.ascontiguousarray(frames.transpose(2, 0, 1))
    origins = np.broadcast_to((points + 1.5 * _LIFT * normals)[:, None], directions.shape)
    blocked = scene.blocked(origins.reshape(-1, 3), directions.reshape(-1, 3), reach)
    return 1 - blocked.reshape(len(points), -1).mean(axis=1)


def shade(
    lights: Lights,
    scene: RayScene,
    points: Float[np.ndarray, "3 hit"],
    normals: Float[np.ndarray, "hit 3"],
    sky_share: Float[np.ndarray, " hit"],
) -> tuple[Float[np.ndarray, "3 hit"], Float[np.ndarray, " hit"]]:
    """Compute the light on matt surfaces and the specular highlight of skin.

    Args:
        lights: The lights.
        scene: Surfaces that cast shadows.
        points: Camera frame, metres.
        normals: Unit vectors.
        sky_share: Result of `sky_visibility`.

    Returns:
        Irradiance (linear, for an albedo of one) and the highlight's strength.
    """
    facing, filled = normals @ lights.key_direction, normals @ lights.fill_direction
    normals = np.ascontiguousarray(normals.T)
    lit = np.ones(len(facing))
    if lights.shadows:
        asked = np.flatnonzero(facing > 0)
        towards = np.broadcast_to(lights.key_direction, (len(asked), 3))
        lifted = points[:, asked] + _LIFT * normals[:, asked]
        lit[asked] = 1 - scene.blocked(lifted.T, towards)
    wrap = _WRAP[:, None]
    wrapped = np.maximum((facing + wrap) / (1 + wrap), 0)
    # Ambient occlusion also darkens the direct light, as an approximation of soft shadows.
    light = lights.key_colour[:, None] * wrapped * (lit * (0.55 + 0.45 * sky_share))
    light += np.maximum(filled + 0.2, 0) * lights.fill_colour[:, None] * sky_share
    light += mixed(lights.ground, lights.sky, 0.5 - 0.5 * normals[1]) * sky_share**1.4
    half = lights.key_direction[:, None] - points / length(points)
    half /= length(half)
    normals *= half
    glint = np.maximum(normals[0] + normals[1] + normals[2], 0) ** 22 * lit * lights.sheen
    return light, glint
