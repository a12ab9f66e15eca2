"""Light on surfaces: a key and a fill light, a sky, occlusion of the sky, and a sheen."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from hand_recon.rendering.rays import RayScene

_LIFT: Final = 0.002
"""Where secondary rays start above the surface, metres: coarse triangles must not shadow themselves."""

_WRAP: Final = np.array([0.32, 0.18, 0.14], dtype=np.float32)
"""How far light creeps around skin's terminator, by channel: red scatters farthest."""


def _sky_directions(count: int) -> Float[np.ndarray, "ray 3"]:
    """Directions of a cosine-weighted hemisphere about z, by the golden angle."""
    share = (np.arange(count) + 0.5) / count
    radius, angle = np.sqrt(share), np.pi * (1 + 5**0.5) * np.arange(count)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - share)], axis=1)


_SKY: Final = _sky_directions(12)


@dataclass(frozen=True)
class Lights:
    """The lights of one picture; directions point to them, in the camera's frame."""

    key_direction: Float[np.ndarray, " 3"]
    """Unit vector."""
    key_colour: Float[np.ndarray, " 3"]
    """Linear, 1 is white paper in full light."""
    fill_direction: Float[np.ndarray, " 3"]
    """Unit vector."""
    fill_colour: Float[np.ndarray, " 3"]
    """Linear."""
    sky: Float[np.ndarray, " 3"]
    """Light from above, linear."""
    ground: Float[np.ndarray, " 3"]
    """Light from below, linear."""
    sheen: float
    """Strength of the highlight on skin."""
    shadows: bool
    """Whether the key light casts shadows."""


def sample_lights(random: np.random.Generator, cast_shadows: float) -> Lights:
    """Lights of a room or of a day.

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


def open_sky(
    scene: RayScene,
    points: Float[np.ndarray, "vertex 3"],
    normals: Float[np.ndarray, "vertex 3"],
    reach: float = 0.05,
) -> Float[np.ndarray, " vertex"]:
    """Share of the hemisphere over each point that nothing near covers: ambient occlusion.

    Args:
        scene: What can cover it.
        points: On the surface, metres.
        normals: Unit vectors.
        reach: How near counts, metres.
    """
    helper = np.where(np.abs(normals[:, :1]) < 0.7, [[1.0, 0, 0]], [[0, 1.0, 0]])
    first = np.cross(helper, normals)
    first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-12)
    frames = np.stack([first, np.cross(normals, first), normals], axis=1)
    directions = _SKY @ frames
    origins = np.broadcast_to((points + 1.5 * _LIFT * normals)[:, None], directions.shape)
    blocked = scene.blocked(origins.reshape(-1, 3), directions.reshape(-1, 3), reach)
    return 1 - blocked.reshape(len(points), -1).mean(axis=1)


def shade(
    lights: Lights,
    scene: RayScene,
    points: Float[np.ndarray, "hit 3"],
    normals: Float[np.ndarray, "hit 3"],
    sky_share: Float[np.ndarray, " hit"],
) -> tuple[Float[np.ndarray, "hit 3"], Float[np.ndarray, " hit"]]:
    """Light that arrives at points of matt surfaces, and the sheen that skin adds.

    Args:
        lights: The lights.
        scene: What casts shadows.
        points: Camera's frame, metres.
        normals: Unit vectors.
        sky_share: Of `open_sky`.

    Returns:
        Irradiance (linear, for an albedo of one) and the highlight's strength.
    """
    facing = normals @ lights.key_direction
    lit = np.ones(len(points))
    if lights.shadows:
        asked = np.flatnonzero(facing > 0)
        towards = np.broadcast_to(lights.key_direction, (len(asked), 3))
        lit[asked] = 1 - scene.blocked(points[asked] + _LIFT * normals[asked], towards)
    wrapped = np.clip((facing[:, None] + _WRAP) / (1 + _WRAP), 0, None)
    # Contact darkens the direct light a little too, which stands in for soft shadows.
    direct = lights.key_colour * wrapped * (lit * (0.55 + 0.45 * sky_share))[:, None]
    fill = np.clip(normals @ lights.fill_direction + 0.2, 0, None)[:, None] * lights.fill_colour
    up = (0.5 - 0.5 * normals[:, 1])[:, None]
    ambient = (lights.ground * (1 - up) + lights.sky * up) * (sky_share**1.4)[:, None]
    to_eye = -points / np.linalg.norm(points, axis=1, keepdims=True)
    half = to_eye + lights.key_direction
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    glint = np.clip((normals * half).sum(axis=1), 0, None) ** 22 * lit * lights.sheen
    return direct + (fill * sky_share[:, None]) + ambient, glint
