"""2D labels as people and detectors give them: worse where a joint is hidden."""

from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from hand_recon.camera import REFERENCE_SIZE
from hand_recon.data.synthetic.levels import Level
from hand_recon.hand.model import HandModel
from hand_recon.hand.open_hand import open_hand
from hand_recon.hand.skeleton import JOINT_OF_LANDMARK
from hand_recon.rendering.rays import RayScene

_THINNEST: Final = 0.0075
"""Metres of flesh over the tips, whose landmarks lie too close to the end to measure it."""

_DEEP: Final = 0.04
"""Metres in front of a joint at which its label is worst."""

_HALF_SURE: Final = 5.0
"""Reference pixels of noise at which a detector's confidence is ½."""

_MISJUDGED: Final = 0.3
"""Standard deviation of the logarithm of the noise that a detector believes in, over the true one."""


@dataclass(frozen=True)
class Labels:
    """The labels of one picture."""

    landmarks_2d: Float[np.ndarray, "landmark=21 2"]
    """Pixels of the crop; NaN without a label."""
    labelled: Bool[np.ndarray, " landmark=21"]
    """Which landmarks have one."""
    label_noise: Float[np.ndarray, " landmark=21"]
    """Standard deviation that the label was drawn with, pixels of the crop."""
    confidence: Float[np.ndarray, " landmark=21"]
    """A detector's score, 0–1: it follows the noise loosely, and knows nothing of outliers."""


@cache
def flesh_thickness(landmarks: str) -> Float[np.ndarray, " landmark=21"]:
    """How much of its own flesh lies over each landmark at most, metres.

    Measured on the mean hand at rest, along and across the back of each segment.
    """
    model = open_hand(landmarks)
    vertices, joints = model.rest(model.template.new_zeros(model.shape_directions.shape[-1]))
    points = model.landmarks_of(vertices, joints).numpy()
    scene = RayScene(vertices.numpy(), model.faces.numpy())
    axes = _across(model)
    thickness = np.zeros(len(points))
    for direction in (axes, -axes):
        hits = scene.nearest(points, direction)
        thickness[hits.ray] = np.maximum(thickness[hits.ray], hits.distance)
    return np.clip(thickness, _THINNEST, 0.025)


def _across(model: HandModel) -> Float[np.ndarray, "landmark=21 3"]:
    """The direction to the back of the segment of each landmark; tips share their last joint's."""
    backs = np.concatenate([[[0.0, 1.0, 0.0]], model.frames.numpy()[:, :, 1]])
    joints = [JOINT_OF_LANDMARK.get(i, JOINT_OF_LANDMARK.get(i - 1, 0)) for i in range(21)]
    return backs[joints]


def depth_behind_surface(
    scene: RayScene, landmarks_3d: Float[np.ndarray, "landmark=21 3"], landmarks: str
) -> Float[np.ndarray, " landmark=21"]:
    """How much more than its own flesh lies before each landmark: positive where it is hidden.

    Args:
        scene: Everything in the picture, camera's frame.
        landmarks_3d: Camera's frame, metres.
        landmarks: Name of the landmark set.

    Returns:
        Metres between the nearest surface and the landmark, less 1.4 times the flesh that a landmark
        has over itself on a mean hand: large hands and slanting views see through more.
    """
    distance = np.linalg.norm(landmarks_3d, axis=1)
    rays = landmarks_3d / distance[:, None]
    hits = scene.nearest(np.zeros_like(rays), rays)
    gap = np.zeros(len(distance))
    gap[hits.ray] = distance[hits.ray] - hits.distance
    return gap - 1.4 * flesh_thickness(landmarks)


def sample_labels(
    random: np.random.Generator,
    level: Level,
    clean: Float[np.ndarray, "landmark=21 2"],
    depth: Float[np.ndarray, " landmark=21"],
    crop_size: int,
) -> Labels:
    """Projections with noise that grows where a joint is hidden.

    Args:
        random: Source of randomness.
        level: How large the noise is.
        clean: True projections, pixels of the crop.
        depth: Of `depth_behind_surface`, metres.
        crop_size: Side of the crop, pixels.
    """
    shallow, deep = level.noise_hidden
    hidden = shallow + (deep - shallow) * np.clip(depth / _DEEP, 0, 1)
    expected = np.where(depth > 0, hidden, level.noise_visible)
    outlier = random.random(len(clean)) < level.outliers
    deviation = np.where(outlier, level.noise_outlier, expected) * crop_size / REFERENCE_SIZE
    labelled = random.random(len(clean)) >= level.missing
    noisy = clean + deviation[:, None] * random.normal(size=clean.shape)
    believed = expected * np.exp(_MISJUDGED * random.normal(size=len(clean)))
    confidence = 1 / (1 + (believed / _HALF_SURE) ** 2)
    return Labels(np.where(labelled[:, None], noisy, np.nan), labelled, deviation, confidence)
