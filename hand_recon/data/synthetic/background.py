"""Procedural backgrounds: gradients, noise, stripes, shapes and clutter; sRGB in 0–1.

Images are three planes, since NumPy is many times faster with long rows than with three numbers at a time.
"""

import cv2
import numpy as np
from jaxtyping import Float

from hand_recon.data.synthetic.levels import Level
from hand_recon.data.synthetic.planes import mixed

Image = Float[np.ndarray, "3 height width"]
Canvas = Float[np.ndarray, "height width 3"]
Share = Float[np.ndarray, "height width"]


def sample_background(
    random: np.random.Generator, level: Level, size: int, *, held_out: bool
) -> Image:
    """Draw a background.

    Args:
        random: Source of randomness.
        level: Level with the probabilities of calm and cluttered backgrounds.
        size: Side, pixels.
        held_out: True adds tiles and cells, which occur in the test split only.
    """
    if random.random() < level.calm_background:
        return _gradient(random, size, calm=True)
    if random.random() < level.clutter:
        return _clutter(random, size)
    kinds = [_gradient, _noise, _stripes, _shapes]
    if held_out:
        kinds += [_cells, _tiles]
    return kinds[random.integers(len(kinds))](random, size)


def _colours(random: np.random.Generator, count: int) -> Float[np.ndarray, "colour 3"]:
    """Draw variations of one base colour, so that a background looks like one place."""
    base = random.uniform(0.1, 0.9, size=3)
    base = base.mean() + (base - base.mean()) * random.uniform(0.05, 0.6)
    return np.clip(
        base
        + random.normal(scale=random.uniform(0.03, 0.15), size=(count, 3))
        + random.normal(scale=random.uniform(0.03, 0.2), size=(count, 1)),
        0,
        1,
    )


def _gradient(random: np.random.Generator, size: int, *, calm: bool = False) -> Image:
    """Smooth gradient between two colours with grain, like light that falls off along a wall."""
    ends = _colours(random, 2)
    if calm:
        ends[1] = ends[0] + 0.25 * (ends[1] - ends[0])
    corners = random.uniform(0, 1, size=(2, 2)).astype(np.float32)
    share = cv2.resize(corners, (size, size), interpolation=cv2.INTER_LINEAR)
    image = mixed(ends[0], ends[1], share)
    image += 0.012 * random.standard_normal((size, size), dtype=np.float32)
    return np.clip(image, 0, 1, out=image)


def _smooth_noise(random: np.random.Generator, size: int) -> Share:
    """Sum of octaves of smooth noise, 0–1."""
    total = np.zeros((size, size), dtype=np.float32)
    cells, weight = int(random.integers(2, 5)), 1.0
    for _ in range(4):
        coarse = random.standard_normal((cells, cells), dtype=np.float32)
        total += weight * cv2.resize(coarse, (size, size), interpolation=cv2.INTER_CUBIC)
        cells, weight = cells * 2, weight * random.uniform(0.4, 0.8)
    return 0.5 + 0.5 * np.tanh(total * 0.6)


def _noise(random: np.random.Generator, size: int) -> Image:
    """Two colours mixed by smooth noise, like foliage, stone or carpet."""
    colours = _colours(random, 2)
    image = mixed(colours[0], colours[1], _smooth_noise(random, size))
    return np.clip(image, 0, 1, out=image)


def _stripes(random: np.random.Generator, size: int) -> Image:
    """Stripes of two colours at a random angle, like blinds, boards or cloth."""
    colours = _colours(random, 2)
    angle, waves = random.uniform(0, np.pi), random.uniform(2, 12)
    grid = np.linspace(0, 1, size, dtype=np.float32)
    along = np.cos(angle) * grid[None, :] + np.sin(angle) * grid[:, None]
    sharp = random.uniform(0.7, 6)
    share = 0.5 + 0.5 * np.tanh(sharp * np.sin(2 * np.pi * waves * along))
    return mixed(colours[0], colours[1], share) * _light(random, size)


def _shapes(random: np.random.Generator, size: int) -> Image:
    """Blurred shapes on a gradient, like furniture out of focus."""
    canvas = _canvas(_gradient(random, size))
    _draw(random, canvas, int(random.integers(4, 14)), _colours(random, 6))
    return _blurred(canvas, random.uniform(0.3, 4) * size / 224)


def _clutter(random: np.random.Generator, size: int) -> Image:
    """Many shapes on noise, some in the colours of skin."""
    canvas = _canvas(_noise(random, size))
    skins = np.array([[0.93, 0.75, 0.63], [0.75, 0.52, 0.38], [0.45, 0.30, 0.22]])
    colours = np.concatenate([random.uniform(0, 1, size=(8, 3)), skins])
    _draw(random, canvas, int(random.integers(15, 45)), colours)
    return _blurred(canvas, random.uniform(0.2, 2.5) * size / 224)


def _canvas(image: Image) -> Canvas:
    """Copy of an image with the channels last, as OpenCV draws on it."""
    return np.ascontiguousarray(image.transpose(1, 2, 0), dtype=np.float32)


def _blurred(canvas: Canvas, deviation: float) -> Image:
    """The canvas, blurred, as three planes."""
    blurred = cv2.GaussianBlur(canvas, (0, 0), max(deviation, 0.2))
    planes = np.ascontiguousarray(blurred.transpose(2, 0, 1))
    return np.clip(planes, 0, 1, out=planes)


def _draw(
    random: np.random.Generator,
    canvas: Canvas,
    count: int,
    colours: Float[np.ndarray, "colour 3"],
) -> None:
    """Draw random ellipses and polygons on the canvas."""
    size = len(canvas)
    for _ in range(count):
        colour = [float(c) for c in colours[random.integers(len(colours))]]
        centre = random.uniform(-0.1, 1.1, size=2) * size
        reach = size * random.uniform(0.04, 0.3)
        if random.random() < 0.4:
            axes = (int(reach) + 1, int(reach * random.uniform(0.2, 1)) + 1)
            spot = (int(centre[0]), int(centre[1]))
            cv2.ellipse(canvas, spot, axes, random.uniform(0, 180), 0, 360, colour, -1, cv2.LINE_AA)
        else:
            angles = np.sort(random.uniform(0, 2 * np.pi, size=int(random.integers(3, 7))))
            outline = centre + reach * np.stack([np.cos(angles), np.sin(angles)], axis=1)
            cv2.fillPoly(canvas, [outline.astype(np.int32)], colour, cv2.LINE_AA)


def _light(random: np.random.Generator, size: int) -> Share:
    """Smooth brightness map, 0.6–1, as a factor for uneven light."""
    corners = random.uniform(0.6, 1, size=(3, 3)).astype(np.float32)
    return np.asarray(cv2.resize(corners, (size, size), interpolation=cv2.INTER_LINEAR))


def _cells(random: np.random.Generator, size: int) -> Image:
    """Voronoi cells in related colours, like pebbles; in the test split only."""
    points = random.uniform(0, 1, size=(int(random.integers(10, 30)), 2)).astype(np.float32)
    colours = _colours(random, len(points))
    grid = np.linspace(0, 1, size, dtype=np.float32)
    distance = (grid[:, None, None] - points[:, 0]) ** 2 + (grid[None, :, None] - points[:, 1]) ** 2
    return colours.T[:, distance.argmin(axis=2)] * _light(random, size)


def _tiles(random: np.random.Generator, size: int) -> Image:
    """Checkerboard of two colours, like a tiled floor; in the test split only."""
    colours = _colours(random, 2)
    count = random.uniform(3, 10)
    grid = np.linspace(0, 1, size, dtype=np.float32) * count
    odd = (np.floor(grid)[:, None] + np.floor(grid)[None, :]) % 2
    return colours.T[:, odd.astype(int)] * _light(random, size)
