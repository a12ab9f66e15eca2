"""Mirrors and crops: a fit in the crop of a right hand, converted to the image of a left hand."""

from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from hand_recon.camera import default_intrinsics, project, six_d_to_rotation
from hand_recon.data.crop import around_landmarks, crop_intrinsics, crop_matrix, crop_points
from hand_recon.data.landmarks.crops import LandmarkCrops, to_crops, uncrop_prediction
from hand_recon.data.landmarks.image_landmarks import (
    ImageLandmarks,
    mirror,
    mirror_left,
    mirror_matrices,
)
from hand_recon.hand.model import HandModel
from hand_recon.schema import HandParameters, HandPrediction
from tests.support.tolerance import assert_close

HANDS = 4
LEFT = torch.tensor([True, False, True, False])
MIRROR = torch.diag(torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64))
seeds = st.integers(0, 10_000)


def hands_in_view(seed: int) -> torch.Tensor:
    """21 points per hand, half a metre in front of the camera."""
    generator = torch.Generator().manual_seed(seed)
    place = torch.rand(HANDS, 1, 3, generator=generator, dtype=torch.float64) - 0.5
    spread = torch.rand(HANDS, 21, 3, generator=generator, dtype=torch.float64) - 0.5
    return place * 0.3 + spread * 0.2 + torch.tensor([0, 0, 0.6], dtype=torch.float64)


def cameras(skew: float = 0.0) -> torch.Tensor:
    """Different camera matrices."""
    matrices = torch.eye(3, dtype=torch.float64).repeat(HANDS, 1, 1)
    matrices[:, 0, 0] = torch.tensor([600.0, 900, 1400, 2000])
    matrices[:, 1, 1] = matrices[:, 0, 0] * 1.02
    matrices[:, :2, 2] = torch.tensor([[320.0, 240], [700, 400], [950, 500], [1200, 1500]])
    matrices[:, 0, 1] = skew
    return matrices


def seen(
    seed: int, *, calibrated: bool = True, hidden: int = 0, skew: float = 0.0
) -> ImageLandmarks:
    pixels = project(hands_in_view(seed), cameras(skew))
    labelled = torch.ones(HANDS, 21, dtype=torch.bool)
    labelled[:, 21 - hidden :] = False
    pixels[~labelled] = torch.nan
    return ImageLandmarks(
        landmarks_2d=pixels,
        labelled=labelled,
        left=LEFT,
        names=("a", "b", "c", "d"),
        sigma=torch.full((HANDS, 21), 3.0, dtype=torch.float64),
        intrinsics=cameras(skew) if calibrated else None,
    )


def assert_equal_sets(actual: ImageLandmarks, expected: ImageLandmarks) -> None:
    assert torch.equal(actual.left, expected.left)
    assert torch.equal(actual.labelled, expected.labelled)
    torch.testing.assert_close(
        actual.landmarks_2d, expected.landmarks_2d, equal_nan=True, rtol=1e-12, atol=1e-9
    )
    if expected.intrinsics is not None:
        assert actual.intrinsics is not None
        assert_close(actual.intrinsics, expected.intrinsics)


# --- the set ------------------------------------------------------------------------------------


def test_selecting_takes_everything_of_a_hand_along() -> None:
    landmarks = seen(0)
    for chosen in (slice(1, 3), torch.tensor([1, 2]), torch.tensor([False, True, True, False])):
        some = landmarks.select(chosen)
        assert some.names == ("b", "c")
        assert some.images == (None, None)
        assert some.left.tolist() == [False, True]
        assert torch.equal(some.landmarks_2d, landmarks.landmarks_2d[1:3])
        assert some.intrinsics is not None
        assert torch.equal(some.intrinsics, cameras()[1:3])
    assert [part.names for part in landmarks.parts(3)] == [("a", "b", "c"), ("d",)]


def test_a_hand_needs_four_landmarks_in_more_than_one_place() -> None:
    landmarks = seen(0)
    landmarks.labelled[0, 3:] = False
    landmarks.labelled[1, 4:] = False
    landmarks.landmarks_2d[2] = 100.0
    assert landmarks.usable.tolist() == [False, True, False, True]


def test_names_and_images_must_be_as_many_as_hands() -> None:
    with pytest.raises(ValueError, match="4 hands have 4 names and 1 images; expected one of each"):
        ImageLandmarks(
            seen(0).landmarks_2d, seen(0).labelled, LEFT, tuple("abcd"), images=(Path("a.png"),)
        )


# --- mirrors ------------------------------------------------------------------------------------


@given(seeds, st.booleans(), st.integers(0, 15), st.floats(-5, 5))
def test_twice_in_the_mirror_is_as_before(
    seed: int, calibrated: bool, hidden: int, skew: float
) -> None:
    landmarks = seen(seed, calibrated=calibrated, hidden=hidden, skew=skew)
    assert_equal_sets(mirror(mirror_left(landmarks), LEFT), landmarks)


def test_only_left_hands_are_mirrored_and_all_come_out_right() -> None:
    landmarks = seen(3)
    right = mirror_left(landmarks)
    assert not right.left.any()
    assert torch.equal(right.landmarks_2d[~LEFT], landmarks.landmarks_2d[~LEFT])
    assert (right.landmarks_2d[LEFT] != landmarks.landmarks_2d[LEFT])[..., 0].any()


@given(seeds, st.floats(-5, 5))
def test_a_mirrored_hand_projects_to_its_mirrored_landmarks(seed: int, skew: float) -> None:
    right = mirror_left(seen(seed, skew=skew))
    points = hands_in_view(seed)
    points[LEFT] = points[LEFT] @ MIRROR
    assert right.intrinsics is not None
    assert_close(project(points, right.intrinsics), right.landmarks_2d)


def test_without_skew_the_mirrored_camera_is_the_same_one() -> None:
    right = mirror_left(seen(1))
    assert right.intrinsics is not None
    assert_close(right.intrinsics, cameras())


def test_u_is_mirrored_about_the_principal_point_or_the_middle_of_the_box() -> None:
    # By hand: 100 → 2·320 − 100 = 540 with a camera; a box from 100 to 180 swaps its ends without.
    pixels = torch.full((1, 21, 2), 120.0, dtype=torch.float64)
    pixels[0, 0, 0], pixels[0, 1, 0] = 100.0, 180.0
    labelled = torch.ones(1, 21, dtype=torch.bool)
    yes = torch.tensor([True])
    known = ImageLandmarks(pixels, labelled, yes, ("a",), intrinsics=cameras()[:1])
    unknown = ImageLandmarks(pixels, labelled, yes, ("a",))
    assert mirror_left(known).landmarks_2d[0, :2, 0].tolist() == [540.0, 460.0]
    assert mirror_left(unknown).landmarks_2d[0, :2, 0].tolist() == [180.0, 100.0]
    assert mirror_left(known).landmarks_2d[0, 0, 1] == 120.0


# --- crops --------------------------------------------------------------------------------------


@given(seeds, st.floats(1.0, 3.0), st.integers(0, 15))
def test_crops_are_those_that_images_get(seed: int, expansion: float, hidden: int) -> None:
    landmarks = mirror_left(seen(seed, hidden=hidden))
    crops = to_crops(landmarks, expansion)
    assert crops.batch.intrinsics is not None
    assert landmarks.intrinsics is not None
    assert crops.batch.label_noise is not None
    for hand in range(HANDS):
        pixels = landmarks.landmarks_2d[hand].numpy()
        matrix = crop_matrix(around_landmarks(pixels, expansion), 224)
        np.testing.assert_allclose(crops.matrices[hand].numpy(), matrix, rtol=1e-9, atol=1e-9)
        expected = torch.from_numpy(crop_points(pixels, matrix))
        torch.testing.assert_close(
            crops.batch.landmarks_2d[hand].double(), expected, equal_nan=True, rtol=1e-5, atol=1e-4
        )
        camera = crop_intrinsics(landmarks.intrinsics[hand].numpy(), matrix)
        assert_close(crops.batch.intrinsics[hand], torch.from_numpy(camera))
        assert_close(crops.batch.label_noise[hand, 0], torch.tensor(3.0 * matrix[0, 0]))


@given(seeds, st.floats(-5, 5))
def test_projecting_with_the_crops_camera_is_projecting_and_then_cropping(
    seed: int, skew: float
) -> None:
    landmarks = seen(seed, skew=skew)
    crops = to_crops(landmarks)
    points = hands_in_view(seed)
    points[LEFT] = points[LEFT] @ MIRROR
    assert crops.batch.intrinsics is not None
    in_crop = project(points.float(), crops.batch.intrinsics)
    torch.testing.assert_close(in_crop, crops.batch.landmarks_2d, rtol=0, atol=0.01)


def test_a_left_hand_and_its_mirror_image_give_one_crop() -> None:
    landmarks = seen(2, calibrated=False)
    mirrored = mirror(landmarks, torch.ones(HANDS, dtype=torch.bool))
    assert_close(to_crops(landmarks).batch.landmarks_2d, to_crops(mirrored).batch.landmarks_2d)


def test_the_crop_of_an_uncalibrated_hand_has_no_camera_and_is_a_batch_without_images() -> None:
    batch = to_crops(seen(0, calibrated=False)).batch
    assert batch.intrinsics is None
    assert len(batch) == HANDS
    assert batch.crop_size == 224
    assert batch.source == ("a", "b", "c", "d")


def test_a_hand_without_a_box_keeps_its_place_in_the_batch() -> None:
    landmarks = seen(0, calibrated=False)
    landmarks.labelled[0] = False
    landmarks.landmarks_2d[0] = torch.nan
    landmarks.landmarks_2d[1] = 50.0
    crops = to_crops(landmarks)
    assert crops.matrices.isfinite().all()
    assert (crops.batch.landmarks_2d[1] == 112.0).all()
    assert crops.batch.landmarks_2d[0].isnan().all()
    assert torch.equal(
        crops.batch.landmarks_2d[2:], to_crops(landmarks.select(slice(2, 4))).batch.landmarks_2d
    )


def test_an_expansion_that_shows_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match=r"expansion 0\.0 shows nothing"):
        to_crops(seen(0), 0.0)


# --- back to the image -----------------------------------------------------------------------------------


def found_in(crops: LandmarkCrops, hand: HandModel, seed: int) -> HandPrediction:
    """Any right hands, projected with the cameras of the crops."""
    generator = torch.Generator().manual_seed(seed)
    angles = torch.rand(HANDS, 15, 3, generator=generator) * torch.tensor([1.2, 0.2, 0.0])
    rotation = six_d_to_rotation(torch.randn(HANDS, 6, generator=generator))
    place = torch.randn(HANDS, 3, generator=generator) * 0.02 + torch.tensor([0.0, 0.0, 0.6])
    shape = torch.randn(HANDS, 10, generator=generator)
    parameters = HandParameters(angles, shape, rotation, place)
    posed = hand.to_camera(parameters)
    camera = crops.batch.intrinsics
    if camera is None:
        camera = default_intrinsics(224, place).expand(HANDS, 3, 3)
    pixels = project(posed.landmarks, camera)
    log_sigma = torch.full((HANDS, 21, 2), 2.0).log()
    correlation = torch.full((HANDS, 21), 0.5)
    return HandPrediction(
        parameters,
        posed.vertices,
        posed.joints,
        posed.landmarks,
        pixels,
        log_sigma,
        camera,
        correlation,
    )


@pytest.mark.parametrize("calibrated", [True, False])
def test_what_was_found_projects_to_the_same_pixels_in_the_image(
    hand: HandModel, calibrated: bool
) -> None:
    landmarks = seen(5, calibrated=calibrated, skew=2.0)
    crops = to_crops(landmarks)
    found = found_in(crops, hand, 0)
    back = uncrop_prediction(crops, found)
    projected = project(back.landmarks_3d.double(), back.intrinsics)
    torch.testing.assert_close(projected, back.landmarks_2d, rtol=0, atol=0.02)
    # And through the crop's matrix they come out where they were.
    again = torch.cat([back.landmarks_2d, torch.ones(HANDS, 21, 1)], dim=-1) @ crops.matrices.mT
    assert_close(again[..., :2].float(), found.landmarks_2d)
    if calibrated:
        torch.testing.assert_close(back.intrinsics, cameras(2.0), rtol=1e-5, atol=1e-3)
    else:
        assert (back.intrinsics[:, [0, 1], [0, 1]] > 0).all()


def test_sigma_grows_with_the_image_and_a_mirror_turns_correlations_round(hand: HandModel) -> None:
    crops = to_crops(seen(5))
    back = uncrop_prediction(crops, found_in(crops, hand, 0))
    scale = crops.matrices[:, 1, 1].float()
    assert_close(back.log_sigma.exp(), (2.0 / scale)[:, None, None].expand(HANDS, 21, 2))
    assert back.correlation is not None
    assert back.correlation[:, 0].tolist() == [-0.5, 0.5, -0.5, 0.5]


def test_a_left_hand_is_the_mirrored_model_turned_and_moved_as_it_says(hand: HandModel) -> None:
    crops = to_crops(seen(5))
    found = found_in(crops, hand, 1)
    back = uncrop_prediction(crops, found)
    kept = back.parameters
    model = hand(kept.joint_angles, kept.shape).landmarks
    sign = torch.where(LEFT[:, None, None], MIRROR.float(), torch.eye(3))
    placed = model @ sign @ kept.root_rotation.mT + kept.translation[:, None]
    assert_close(placed, back.landmarks_3d)
    assert_close(torch.linalg.det(kept.root_rotation), torch.ones(HANDS))
    assert torch.equal(back.vertices[~LEFT], found.vertices[~LEFT])
    assert torch.equal(back.vertices[LEFT, :, 0], -found.vertices[LEFT, :, 0])


def test_mirror_matrices_are_their_own_inverse() -> None:
    matrices = mirror_matrices(seen(0, calibrated=False), LEFT)
    assert_close(matrices @ matrices, torch.eye(3, dtype=torch.float64).expand(HANDS, 3, 3))
