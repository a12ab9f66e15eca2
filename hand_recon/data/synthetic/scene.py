"""Generation of one synthetic hand: image, labels and ground truth from an index."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8

from hand_recon.camera import project_array
from hand_recon.data.synthetic.gestures import sample_pose
from hand_recon.data.synthetic.independent import independent_pose
from hand_recon.data.synthetic.labels import depth_behind_surface, sample_labels
from hand_recon.data.synthetic.objects import front_object, held_object
from hand_recon.data.synthetic.painter import render_image
from hand_recon.data.synthetic.plausible import deepest_overlap
from hand_recon.data.synthetic.recipe import Recipe
from hand_recon.data.synthetic.surface import (
    SKIN,
    Forearm,
    Surface,
    merged,
    sleeve,
    with_forearm,
)
from hand_recon.data.synthetic.view import View, sample_view
from hand_recon.hand.model import HandModel
from hand_recon.hand.open_hand import open_hand
from hand_recon.hand.skeleton import ROOT_JOINT
from hand_recon.rendering.rays import RayScene
from hand_recon.schema import HandGeometry

_OVERLAP_ALLOWED = 0.004
"""Accepted penetration depth of the bones' capsules, metres; flesh is soft."""

_TRIES = 12


@dataclass(frozen=True)
class SyntheticView:
    """Labels and ground truth of one view; names as in `HandSample` and `HandParameters`."""

    landmarks_2d: Float[np.ndarray, "landmark=21 2"]
    """Labels, pixels of the crop; NaN without a label; exact projections if `Recipe.clean_labels`."""
    labelled: Bool[np.ndarray, " landmark=21"]
    """True for landmarks that have a label."""
    label_noise: Float[np.ndarray, " landmark=21"]
    """Standard deviation of the labels' noise, pixels of the crop."""
    confidence: Float[np.ndarray, " landmark=21"]
    """Detector confidence of each landmark, 0–1."""
    occluded: Bool[np.ndarray, " landmark=21"]
    """True for landmarks that are occluded or outside the image."""
    landmarks_3d: Float[np.ndarray, "landmark=21 3"]
    """Ground truth, camera frame, metres."""
    intrinsics: Float[np.ndarray, "3 3"]
    """Camera matrix, pixels of the crop."""
    joint_angles: Float[np.ndarray, "joint=15 axis=3"]
    """Bend, splay and twist, radians."""
    shape: Float[np.ndarray, " direction=10"]
    """Coefficients of the shape directions, standard deviations."""
    root_rotation: Float[np.ndarray, "3 3"]
    """Rotation from the hand's frame to the camera's."""
    translation: Float[np.ndarray, " 3"]
    """Position of the hand's origin in the camera's frame, metres."""


@dataclass(frozen=True)
class SyntheticHand(SyntheticView):
    """One image with its labels and ground truth."""

    image: UInt8[np.ndarray, "height width 3"]
    """RGB."""
    mask: Bool[np.ndarray, "height width"]
    """True for pixels that show skin of the hand or forearm."""


@cache
def _model(landmark_set: str) -> HandModel:
    return open_hand(landmark_set)


@dataclass(frozen=True)
class _Scene:
    """All surfaces in the camera's frame, and their structure for ray casting."""

    surfaces: tuple[Surface, ...]
    rays: RayScene


def synthetic_hand(recipe: Recipe, index: int, appearance: int = 0) -> SyntheticHand:
    """Generate one image; the result depends on the arguments only.

    Args:
        recipe: Recipe of the set.
        index: Index of the image.
        appearance: Index of the appearance; others show the same hand with another background and paints.
    """
    view, scene = _view_and_scene(recipe, index)
    image, mask = render_image(
        recipe, (index, appearance), scene.surfaces, scene.rays, view.intrinsics
    )
    return SyntheticHand(**vars(view), image=image, mask=mask)


def synthetic_view(recipe: Recipe, index: int) -> SyntheticView:
    """Generate labels and ground truth of one view without rendering its image."""
    return _view_and_scene(recipe, index)[0]


def _view_and_scene(recipe: Recipe, index: int) -> tuple[SyntheticView, _Scene]:
    angles, shape, geometry = _sample_hand(recipe, index)
    landmarks = geometry.landmarks.numpy().astype(float)
    view = sample_view(recipe.random(index, "view"), recipe.level, recipe.crop_size, landmarks)
    landmarks_3d = view.to_camera(landmarks).astype(np.float32)
    surfaces = scene_surfaces(recipe, index, geometry, view)
    scene = RayScene(*merged(surfaces))
    clean = project_array(landmarks_3d.astype(float), view.intrinsics)
    depth = depth_behind_surface(scene, landmarks_3d.astype(float), recipe.landmark_set)
    labels = sample_labels(
        recipe.random(index, "labels"), recipe.level, clean, depth, recipe.crop_size
    )
    outside = ((clean < 0) | (clean > recipe.crop_size)).any(axis=1)
    exact = recipe.clean_labels
    known = SyntheticView(
        landmarks_2d=clean if exact else labels.landmarks_2d,
        labelled=np.ones_like(labels.labelled) if exact else labels.labelled,
        label_noise=np.zeros_like(labels.label_noise) if exact else labels.label_noise,
        confidence=np.ones_like(labels.confidence) if exact else labels.confidence,
        occluded=(depth > 0) | outside,
        landmarks_3d=landmarks_3d,
        intrinsics=view.intrinsics,
        joint_angles=angles,
        shape=shape,
        root_rotation=view.root_rotation,
        translation=view.translation,
    )
    return known, _Scene(surfaces, scene)


def _sample_hand(
    recipe: Recipe, index: int
) -> tuple[Float[np.ndarray, "joint=15 axis=3"], Float[np.ndarray, " direction=10"], HandGeometry]:
    """Draw a shape and a pose: the first of `_TRIES` poses without penetration, or the least bad."""
    random = recipe.random(index, "pose")
    spread = recipe.level.shape_deviation * (1.25 if recipe.held_out else 1.0)
    shape = np.clip(recipe.random(index, "shape").normal(scale=spread, size=10), -3, 3)
    model, least = _model(recipe.landmark_set), np.inf
    for _ in range(_TRIES):
        tried = _sample_angles(recipe, random)
        with torch.inference_mode():
            hand = model(torch.from_numpy(tried).float(), torch.from_numpy(shape).float())
        overlap = deepest_overlap(hand.landmarks.numpy())
        if overlap < least:
            least, angles, geometry = overlap, tried, hand
        if overlap < _OVERLAP_ALLOWED:
            break
    return angles, shape, geometry


def _sample_angles(
    recipe: Recipe, random: np.random.Generator
) -> Float[np.ndarray, "joint=15 axis=3"]:
    level = recipe.level
    # No draw where the level has no such poses: the images of the other levels stay the same.
    if level.independent_fingers and random.random() < level.independent_fingers:
        return independent_pose(random)
    return level.pose_scale * sample_pose(random, held_out=recipe.held_out, noise=level.pose_noise)


def scene_surfaces(
    recipe: Recipe, index: int, geometry: HandGeometry, view: View
) -> tuple[Surface, ...]:
    """Surfaces of hand, forearm, sleeve and objects, in the camera's frame."""
    random, level = recipe.random(index, "things"), recipe.level
    model = _model(recipe.landmark_set)
    vertices = geometry.vertices.numpy().astype(float)
    landmarks = geometry.landmarks.numpy().astype(float)
    rest = model.template.numpy().astype(float) - model.joints_template.numpy()[ROOT_JOINT]
    ring = model.wrist_ring.numpy()
    flexion, deviation = random.normal(scale=[0.3, 0.15])
    forearm = Forearm(flexion, deviation, random.uniform(0.9, 1.15))
    hand = Surface(vertices, model.faces.numpy(), rest, SKIN)
    surfaces = [with_forearm(hand, ring, forearm)]
    if random.random() < level.sleeve:
        begin, width = random.uniform(0.01, 0.1), random.uniform(1.15, 1.5)
        surfaces.append(sleeve(vertices[ring].mean(axis=0), forearm, begin, width))
    if random.random() < level.held_object:
        held = held_object(random, landmarks, vertices)
        surfaces += [] if held is None else [held]
    surfaces = [replace(surface, vertices=view.to_camera(surface.vertices)) for surface in surfaces]
    if random.random() < level.front_object:
        surfaces.append(front_object(random, view.to_camera(landmarks)))
    return tuple(surfaces)
