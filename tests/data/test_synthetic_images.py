"""Single synthetic images: labels, occlusion, light and projection."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch

from hand_recon.data.synthetic.gestures import gesture_library
from hand_recon.data.synthetic.labels import depth_behind_surface, sample_labels
from hand_recon.data.synthetic.levels import DIFFICULTIES, FEATURES
from hand_recon.data.synthetic.light import sky_visibility
from hand_recon.data.synthetic.recipe import Recipe, level_named
from hand_recon.data.synthetic.scene import synthetic_hand
from hand_recon.data.synthetic.skin import plainer, sample_tone
from hand_recon.data.synthetic.surface import box, revolved, vertex_normals
from hand_recon.data.synthetic.view import FACING, axis_rotation, sample_view
from hand_recon.hand.open_hand import open_hand
from hand_recon.hand.skeleton import LANDMARKS, TIPS
from hand_recon.rendering.rays import RayScene

SIZE = 64


def recipe(split: str = "train", level: str = "easy", seed: int = 0, size: int = SIZE) -> Recipe:
    return Recipe(split, level_named(level), size, seed)


def test_the_same_index_gives_the_same_image() -> None:
    first, second = (synthetic_hand(recipe(level="hard"), 5) for _ in range(2))
    assert (first.image == second.image).all()
    np.testing.assert_array_equal(first.landmarks_2d, second.landmarks_2d)


def test_another_index_seed_or_split_gives_another_hand() -> None:
    angles = [
        synthetic_hand(r, i).joint_angles
        for r, i in [(recipe(), 0), (recipe(), 1), (recipe(seed=1), 0), (recipe("val"), 0)]
    ]
    for i, first in enumerate(angles):
        assert all(np.abs(first - second).max() > 0.01 for second in angles[i + 1 :])


def test_the_hand_does_not_depend_on_the_resolution() -> None:
    small, large = synthetic_hand(recipe(size=64), 2), synthetic_hand(recipe(size=128), 2)
    np.testing.assert_allclose(small.landmarks_3d, large.landmarks_3d, atol=1e-5)


@pytest.mark.parametrize("level", sorted(DIFFICULTIES))
def test_test_labels_are_the_projections_of_the_ground_truth(level: str) -> None:
    hand = synthetic_hand(recipe("test", level), 3)
    points = hand.landmarks_3d.astype(float) @ hand.intrinsics.T
    np.testing.assert_allclose(hand.landmarks_2d, points[:, :2] / points[:, 2:], atol=1e-9)
    assert (hand.label_noise == 0).all()
    assert hand.labelled.all()


def test_easy_landmarks_fill_the_crop_as_their_level_says() -> None:
    for index in range(4):
        hand = synthetic_hand(recipe("test"), index)
        side = np.ptp(hand.landmarks_2d, axis=0).max() / SIZE
        assert 0.66 < side < 0.84


def test_easy_hands_show_the_palm_with_fingers_up() -> None:
    random = np.random.default_rng(0)
    fist = np.random.default_rng(1).normal(scale=0.05, size=(21, 3))
    for _ in range(30):
        view = sample_view(random, DIFFICULTIES["easy"], SIZE, fist)
        palm_normal = view.root_rotation @ [0.0, -1.0, 0.0]
        assert -palm_normal[2] >= np.cos(np.radians(40)) - 1e-9
        assert (view.root_rotation @ [-1.0, 0.0, 0.0])[1] < 0


def test_facing_is_the_rotation_that_points_the_palm_to_the_camera() -> None:
    assert np.linalg.det(FACING) == pytest.approx(1)
    np.testing.assert_allclose(FACING @ [0.0, -1.0, 0.0], [0.0, 0.0, -1.0])
    np.testing.assert_allclose(FACING @ [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0])


def test_skin_lies_under_the_visible_landmarks() -> None:
    hits, asked = 0, 0
    for index in range(6):
        hand = synthetic_hand(recipe("test"), index)
        seen = hand.landmarks_2d[~hand.occluded]
        inside = seen[((seen > 1) & (seen < SIZE - 1)).all(axis=1)].astype(int)
        hits += hand.mask[inside[:, 1], inside[:, 0]].sum()
        asked += len(inside)
    assert hits / asked > 0.9


def test_a_fist_hides_its_tips_from_behind_and_not_from_the_front() -> None:
    fist = next(g for g in gesture_library() if g.name == "letter_a").joint_angles
    model = open_hand()
    hand = model(torch.from_numpy(fist).float(), torch.zeros(10))
    behind = axis_rotation(np.array([0.0, 1.0, 0.0]), np.pi) @ FACING
    fingers = list(TIPS[1:])
    hidden = {}
    for name, rotation in {"front": FACING, "behind": behind}.items():
        vertices, landmarks = (
            points.numpy() @ rotation.T + [0.0, 0.0, 0.5]
            for points in (hand.vertices, hand.landmarks)
        )
        scene = RayScene(vertices, model.faces.numpy())
        depth = depth_behind_surface(scene, landmarks, "knuckle")
        hidden[name] = depth > 0
    assert hidden["behind"][fingers].all()
    assert not hidden["front"][[LANDMARKS.index(f"{f} PIP") for f in ("index", "middle")]].any()
    assert not hidden["behind"][[LANDMARKS.index(f"{f} MCP") for f in ("index", "middle")]].any()


def test_label_noise_has_its_stated_deviation() -> None:
    level = replace(DIFFICULTIES["hard"], missing=0.0)
    depth = np.where(np.arange(21) % 2 == 0, -0.01, 0.02)
    random, clean = np.random.default_rng(0), np.zeros((21, 2))
    drawn = [sample_labels(random, level, clean, depth, 224) for _ in range(3000)]
    scaled = np.stack([d.landmarks_2d / d.label_noise[:, None] for d in drawn])
    assert scaled.std() == pytest.approx(1.0, abs=0.01)
    usual = np.median([d.label_noise for d in drawn], axis=0)
    assert usual[0] == level.noise_visible
    assert usual[1] == pytest.approx(np.mean(level.noise_hidden))


def test_missing_labels_are_nan_and_never_zero() -> None:
    level = replace(DIFFICULTIES["hard"], missing=0.5)
    labels = sample_labels(np.random.default_rng(0), level, np.ones((21, 2)), np.zeros(21), 224)
    assert 0 < labels.labelled.sum() < 21
    assert np.isnan(labels.landmarks_2d[~labels.labelled]).all()
    assert np.isfinite(labels.landmarks_2d[labels.labelled]).all()


def test_other_appearances_show_the_same_hand_before_another_background() -> None:
    first, second = (synthetic_hand(recipe(), 1, appearance=a) for a in (0, 1))
    assert (first.mask == second.mask).all()
    np.testing.assert_array_equal(first.landmarks_3d, second.landmarks_3d)
    outside = ~first.mask
    assert np.abs(first.image[outside].astype(int) - second.image[outside]).mean() > 5


def test_normals_of_a_box_and_a_ball_point_outwards() -> None:
    angles = np.linspace(-np.pi / 2, np.pi / 2, 9)
    ball = revolved(np.stack([np.cos(angles), np.sin(angles)], axis=1))
    for solid in (box(np.array([1.0, 2.0, 3.0])), ball):
        normals = vertex_normals(solid.vertices, solid.faces)
        assert ((normals * solid.vertices).sum(axis=1) > -1e-9).all()


def test_the_sky_is_visible_on_top_of_a_box_and_not_inside_it() -> None:
    solid = box(np.array([0.02, 0.02, 0.02]))
    scene = RayScene(solid.vertices, solid.faces)
    outwards = np.array([[0.0, 0.0, 1.0]])
    assert sky_visibility(scene, np.array([[0.0, 0.0, 0.0101]]), outwards)[0] == 1
    assert sky_visibility(scene, np.zeros((1, 3)), outwards)[0] == 0


@pytest.mark.parametrize("feature", list(FEATURES))
def test_images_can_lack_a_feature_and_show_the_same_hands(feature: str) -> None:
    """Skin, nails and light change the skin; the background changes everything but it."""
    # A clean sensor, so that a change does not spread over the image.
    clean = [] if feature == "sensor" else ["sensor"]
    with_it, without = (
        [
            synthetic_hand(Recipe("train", level_named("any_pose", one), SIZE, 3), i)
            for i in range(8)
        ]
        for one in (clean, [*clean, feature])
    )
    in_skin, elsewhere = [], []
    for first, second in zip(with_it, without, strict=True):
        np.testing.assert_array_equal(first.landmarks_2d, second.landmarks_2d)
        change = np.abs(first.image.astype(int) - second.image).max(axis=-1)
        skin = cv2.dilate(first.mask.astype(np.uint8), np.ones((9, 9))) > 0
        in_skin.append(change[first.mask].max(initial=0))
        elsewhere.append(change[~skin].max(initial=0))
    # An object or a painted nail is not in every image; JPEG's rounding is within 12 of 255.
    if feature in ("skin_tones", "skin_texture", "nails"):
        assert max(in_skin) > 12 >= max(elsewhere)
    elif feature == "background":
        assert max(elsewhere) > 40
    else:
        assert max(in_skin + elsewhere) > 12


def test_skin_of_one_tone_is_that_of_everybody() -> None:
    plain = level_named("any_pose", ["skin_tones", "skin_texture", "nails"])
    tones = [
        plainer(sample_tone(np.random.default_rng(seed), held_out=False), plain)
        for seed in range(5)
    ]
    for tone in tones:
        np.testing.assert_array_equal(tone.back, tones[0].back)
        np.testing.assert_array_equal(tone.palm, tones[0].palm)
        assert (tone.blush, tone.mottle, tone.creases, tone.nails) == (0, 0, 0, False)
    every = level_named("any_pose")
    assert level_named("any_pose", ["nails", "nails"]).name == "any_pose-no-nails"
    tone = sample_tone(np.random.default_rng(1), held_out=False)
    assert plainer(tone, every) is tone


def test_invalid_recipes_are_refused() -> None:
    with pytest.raises(
        ValueError, match=r"Found without=\['fog'\]; images can lack \['background'"
    ):
        level_named("easy", ["nails", "fog"])
    with pytest.raises(ValueError, match="Unknown split 'all'"):
        recipe("all")
    with pytest.raises(ValueError, match="Unknown level 'extreme'"):
        level_named("extreme")
    with pytest.raises(ValueError, match="at least 16"):
        recipe(size=8)
