"""One synthetic hand: from an index to pixels, labels and truth."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8

from hand_recon.camera import project_array
from hand_recon.data.synthetic.gestures import sample_pose
from hand_recon.data.synthetic.labels import depth_behind_surface, sample_labels
from hand_recon.data.synthetic.painter import paint_picture
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
from hand_recon.data.synthetic.things import front_thing, held_thing
from hand_recon.data.synthetic.view import View, sample_view
from hand_recon.hand.model import HandModel
from hand_recon.hand.open_hand import open_hand
from hand_recon.hand.skeleton import ROOT_JOINT
from hand_recon.rendering.rays import RayScene
from hand_recon.schema import HandGeometry

_MOST_OVERLAP = 0.004
"""Metres by which the bones' capsules may press into each other; flesh gives way."""

_TRIES = 12


@dataclass(frozen=True)
class SyntheticView:
    """What is known of one view of a hand without its pixels; names as in `HandSample`, `HandParameters`."""

    landmarks_2d: Float[np.ndarray, "landmark=21 2"]
    """Labels, pixels of the crop; NaN without a label; true projections where the recipe says so."""
    labelled: Bool[np.ndarray, " landmark=21"]
    """Which landmarks have a label."""
    label_noise: Float[np.ndarray, " landmark=21"]
    """Standard deviation of the labels, pixels of the crop."""
    confidence: Float[np.ndarray, " landmark=21"]
    """A detector's score for each landmark, 0–1."""
    occluded: Bool[np.ndarray, " landmark=21"]
    """Which landmarks are hidden or outside the picture."""
    landmarks_3d: Float[np.ndarray, "landmark=21 3"]
    """Camera's frame, metres."""
    intrinsics: Float[np.ndarray, "3 3"]
    """Pixels of the crop."""
    joint_angles: Float[np.ndarray, "joint=15 axis=3"]
    """Radians."""
    shape: Float[np.ndarray, " direction=10"]
    """Standard deviations."""
    root_rotation: Float[np.ndarray, "3 3"]
    """Hand's frame to camera's."""
    translation: Float[np.ndarray, " 3"]
    """Metres."""


@dataclass(frozen=True)
class SyntheticHand(SyntheticView):
    """Everything that is known of one picture."""

    image: UInt8[np.ndarray, "height width 3"]
    """RGB."""
    mask: Bool[np.ndarray, "height width"]
    """Pixels that show the hand or its forearm's skin."""


@cache
def _model(landmarks: str) -> HandModel:
    return open_hand(landmarks)


@dataclass(frozen=True)
class _Scene:
    """What stands before the camera."""

    surfaces: tuple[Surface, ...]
    rays: RayScene


def synthetic_hand(recipe: Recipe, index: int, appearance: int = 0) -> SyntheticHand:
    """The picture of that index, the same wherever and whenever it is made.

    Args:
        recipe: Of the whole set.
        index: Which picture.
        appearance: Other numbers give the same hand with another light, skin and background.
    """
    view, scene = _view_and_scene(recipe, index)
    image, mask = paint_picture(
        recipe, (index, appearance), scene.surfaces, scene.rays, view.intrinsics
    )
    return SyntheticHand(**vars(view), image=image, mask=mask)


def synthetic_view(recipe: Recipe, index: int) -> SyntheticView:
    """The same without its pixels: what a landmark detector would leave of it, and the truth."""
    return _view_and_scene(recipe, index)[0]


def _view_and_scene(recipe: Recipe, index: int) -> tuple[SyntheticView, _Scene]:
    angles, shape, geometry = _sample_hand(recipe, index)
    landmarks = geometry.landmarks.numpy().astype(float)
    view = sample_view(recipe.random(index, "view"), recipe.level, recipe.crop_size, landmarks)
    landmarks_3d = view.to_camera(landmarks).astype(np.float32)
    surfaces = scene_surfaces(recipe, index, geometry, view)
    scene = RayScene(*merged(surfaces))
    clean = project_array(landmarks_3d.astype(float), view.intrinsics)
    depth = depth_behind_surface(scene, landmarks_3d.astype(float), recipe.landmarks)
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
    """A shape and the first of a few poses whose fingers do not run through each other."""
    random = recipe.random(index, "pose")
    spread = recipe.level.shape_deviation * (1.25 if recipe.held_out else 1.0)
    shape = np.clip(recipe.random(index, "shape").normal(scale=spread, size=10), -3, 3)
    model, least = _model(recipe.landmarks), np.inf
    for _ in range(_TRIES):
        tried = recipe.level.pose_scale * sample_pose(
            random, held_out=recipe.held_out, noise=recipe.level.pose_noise
        )
        with torch.no_grad():
            hand = model(torch.from_numpy(tried).float(), torch.from_numpy(shape).float())
        overlap = deepest_overlap(hand.landmarks.numpy())
        if overlap < least:
            least, angles, geometry = overlap, tried, hand
        if overlap < _MOST_OVERLAP:
            break
    return angles, shape, geometry


def scene_surfaces(
    recipe: Recipe, index: int, geometry: HandGeometry, view: View
) -> tuple[Surface, ...]:
    """Hand, forearm, sleeve and things, in the camera's frame."""
    random, level = recipe.random(index, "things"), recipe.level
    model = _model(recipe.landmarks)
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
        held = held_thing(random, landmarks, vertices)
        surfaces += [] if held is None else [held]
    surfaces = [replace(surface, vertices=view.to_camera(surface.vertices)) for surface in surfaces]
    if random.random() < level.front_object:
        surfaces.append(front_thing(random, view.to_camera(landmarks)))
    return tuple(surfaces)
