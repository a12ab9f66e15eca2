"""Simulated 2D labels, with noise that is larger for occluded landmarks, and detector confidence."""

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

_LEAST_FLESH: Final = 0.0075
"""Least thickness of flesh, metres; at the tips, landmarks lie too close to the surface to measure it."""

_FULL_DEPTH: Final = 0.04
"""Depth behind a surface from which on the label noise is largest, metres."""

_HALF_CONFIDENCE_NOISE: Final = 5.0
"""Label noise at which the confidence is ½, reference pixels."""

_NOISE_ERROR: Final = 0.3
"""Standard deviation of log(noise assumed by the detector / actual noise)."""


@dataclass(frozen=True)
class Labels:
    """Labels of one image."""

    landmarks_2d: Float[np.ndarray, "landmark=21 2"]
    """Labels, pixels of the crop; NaN without a label."""
    labelled: Bool[np.ndarray, " landmark=21"]
    """True for landmarks that have a label."""
    label_noise: Float[np.ndarray, " landmark=21"]
    """Standard deviation of the label's noise, pixels of the crop."""
    confidence: Float[np.ndarray, " landmark=21"]
    """Detector confidence, 0–1; it correlates with the noise and does not depend on outliers."""


@cache
def flesh_thickness(landmark_set: str) -> Float[np.ndarray, " landmark=21"]:
    """Thickness of flesh over each landmark, metres: the larger of the dorsal and palmar sides.

    It is measured on the mean hand at rest.
    """
    model = open_hand(landmark_set)
    vertices, joints = model.rest(model.template.new_zeros(model.shape_directions.shape[-1]))
    points = model.landmarks_of(vertices, joints).numpy()
    scene = RayScene(vertices.numpy(), model.faces.numpy())
    axes = _across(model)
    thickness = np.zeros(len(points))
    for direction in (axes, -axes):
        hits = scene.nearest(points, direction)
        thickness[hits.ray] = np.maximum(thickness[hits.ray], hits.distance)
    return np.clip(thickness, _LEAST_FLESH, 0.025)


def _across(model: HandModel) -> Float[np.ndarray, "landmark=21 3"]:
    """Dorsal direction of each landmark's segment; tips use their last joint's."""
    backs = np.concatenate([[[0.0, 1.0, 0.0]], model.frames.numpy()[:, :, 1]])
    joints = [JOINT_OF_LANDMARK.get(i, JOINT_OF_LANDMARK.get(i - 1, 0)) for i in range(21)]
    return backs[joints]


def depth_behind_surface(
    scene: RayScene, landmarks_3d: Float[np.ndarray, "landmark=21 3"], landmark_set: str
) -> Float[np.ndarray, " landmark=21"]:
    """Depth of each landmark behind the first visible surface, minus its own flesh: positive if occluded.

    Args:
        scene: All surfaces, camera frame.
        landmarks_3d: Camera frame, metres.
        landmark_set: Name of the landmark set.

    Returns:
        Distance from the nearest surface to the landmark minus 1.4 times the flesh thickness of a mean hand,
        metres. The factor allows for large hands and slanted views.
    """
    distance = np.linalg.norm(landmarks_3d, axis=1)
    rays = landmarks_3d / distance[:, None]
    hits = scene.nearest(np.zeros_like(rays), rays)
    gap = np.zeros(len(distance))
    gap[hits.ray] = distance[hits.ray] - hits.distance
    return gap - 1.4 * flesh_thickness(landmark_set)


def sample_labels(
    random: np.random.Generator,
    level: Level,
    clean: Float[np.ndarray, "landmark=21 2"],
    depth: Float[np.ndarray, " landmark=21"],
    crop_size: int,
) -> Labels:
    """Add noise to projections, more of it to occluded landmarks, and draw missing labels.

    Args:
        random: Source of randomness.
        level: Level with the noise of visible and occluded landmarks, outliers and missing labels.
        clean: Exact projections, pixels of the crop.
        depth: Result of `depth_behind_surface`, metres.
        crop_size: Side of the crop, pixels.
    """
    shallow, deep = level.noise_hidden
    hidden = shallow + (deep - shallow) * np.clip(depth / _FULL_DEPTH, 0, 1)
    expected = np.where(depth > 0, hidden, level.noise_visible)
    outlier = random.random(len(clean)) < level.outliers
    deviation = np.where(outlier, level.noise_outlier, expected) * crop_size / REFERENCE_SIZE
    labelled = random.random(len(clean)) >= level.missing
    noisy = clean + deviation[:, None] * random.normal(size=clean.shape)
    assumed = expected * np.exp(_NOISE_ERROR * random.normal(size=len(clean)))
    confidence = 1 / (1 + (assumed / _HALF_CONFIDENCE_NOISE) ** 2)
    return Labels(np.where(labelled[:, None], noisy, np.nan), labelled, deviation, confidence)
