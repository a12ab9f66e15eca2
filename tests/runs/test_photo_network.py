"""Networks that look at photographs: what they see of each hand."""

import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from hand_recon.camera import project
from hand_recon.detection.detector import DetectedHand
from hand_recon.hand.open_hand import open_hand
from hand_recon.runs.photo_network import PhotoNetwork, has_landmarks
from hand_recon.schema import HandEstimate
from hand_recon.uncertainty import soft_bound
from tests.support.photo_checkpoint import IMAGES, PHOTOS, loaded, write_run
from tests.support.tolerance import assert_close

K = np.array([[500.0, 0.0, 120.0], [0.0, 500.0, 100.0], [0.0, 0.0, 1.0]])
"""Camera of a photograph of 240 × 200."""


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs of three untrained networks."""
    folder = tmp_path_factory.mktemp("runs")
    write_run(folder / "photos", *PHOTOS, sharpness=1e4)
    write_run(folder / "dots", *PHOTOS)
    write_run(folder / "images", *IMAGES)
    return folder


@pytest.fixture
def pixels() -> np.ndarray:
    """A photograph of smooth noise."""
    noise = np.random.default_rng(5).integers(0, 255, (10, 12, 3)).astype(np.uint8)
    return cv2.resize(noise, (240, 200), interpolation=cv2.INTER_CUBIC)


@pytest.fixture
def found() -> tuple[DetectedHand, DetectedHand]:
    """A right and a left hand of a detector."""
    random = np.random.default_rng(6)
    return (
        DetectedHand(random.uniform((20, 30), (110, 150), (21, 2)), "right", 0.9, 1.0),
        DetectedHand(random.uniform((130, 40), (220, 160), (21, 2)), "left", 0.9, 1.0),
    )


def boxed(hand: DetectedHand, margin: float = 5.0) -> DetectedHand:
    """The box of a hand in place of its landmarks."""
    low, high = hand.landmarks_2d.min(axis=0) - margin, hand.landmarks_2d.max(axis=0) + margin
    return replace(hand, landmarks_2d=np.full((21, 2), np.nan), box=np.concatenate([low, high]))


def placed(
    network: PhotoNetwork, pixels: np.ndarray, *hands: DetectedHand, camera: np.ndarray = K
) -> tuple[tuple[DetectedHand, ...], HandEstimate]:
    first, which = network.find(pixels, hands)
    return network.place(pixels, first, which, camera)


def test_landmarks_of_another_set_are_not_shown_to_the_network(
    runs: Path,
    pixels: np.ndarray,
    found: tuple[DetectedHand, ...],
    caplog: pytest.LogCaptureFixture,
) -> None:
    other = loaded(runs / "photos", "landmark_set=knuckle")
    assert (
        "trained on landmarks of the set mediapipe, and the detector's are of knuckle"
        in caplog.text
    )
    assert "landmark_set=mediapipe" in caplog.text
    moved = replace(found[0], landmarks_2d=found[0].landmarks_2d[::-1].copy())
    first, second = (placed(other, pixels, one)[1] for one in (found[0], moved))
    assert torch.equal(first.parameters.translation, second.parameters.translation)
    # Its own landmarks could not be fitted beside the detector's.
    assert not other.finds_landmarks
    hands, estimate = placed(other, pixels, boxed(found[0]))
    assert np.isnan(hands[0].landmarks_2d).all()
    assert estimate.log_sigma.isnan().all()


def test_the_network_sees_crop_and_landmarks(
    runs: Path, pixels: np.ndarray, found: tuple[DetectedHand, ...]
) -> None:
    network = loaded(runs / "photos")
    exchanged = replace(found[0], landmarks_2d=found[0].landmarks_2d[::-1].copy())
    dark = (pixels // 3).astype(np.uint8)
    sure = replace(found[0], confidence=np.linspace(0.1, 0.9, 21))
    estimates = [
        placed(network, image, hand)[1].parameters.joint_angles
        for image, hand in (
            (pixels, found[0]),
            (pixels, exchanged),
            (dark, found[0]),
            (pixels, sure),
        )
    ]
    for number, one in enumerate(estimates):
        for other in estimates[:number]:
            assert float((one - other).abs().max()) > 1e-5
    # The detector's landmarks are what the hand is fitted to.
    hands, _ = placed(network, pixels, *found)
    assert hands == found


def test_the_pose_in_pixels_does_not_depend_on_the_landmarks(
    runs: Path,
    pixels: np.ndarray,
    found: tuple[DetectedHand, ...],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    network = loaded(runs / "photos")
    # An untrained network finds every landmark elsewhere, and its pose is not believed.
    doubted = placed(network, pixels, found[0])[1].seen_pose
    assert doubted is not None
    assert doubted.isnan().all()
    monkeypatch.setattr("hand_recon.fitting.seen_pose.AGREES", 1e6)
    random = np.random.default_rng(7)
    # The same box, and so the same crop.
    within = random.uniform(0.2, 0.8, (21, 2)) * 90 + (20, 30)
    within[:2] = (20.0, 30.0), (110.0, 150.0)
    other = within[random.permutation(21)]
    one, two = (
        placed(network, pixels, replace(found[0], landmarks_2d=points))[1]
        for points in (within, other)
    )
    assert one.seen_pose is not None
    assert two.seen_pose is not None
    assert_close(one.seen_pose, two.seen_pose)
    assert (one.parameters.joint_angles - two.parameters.joint_angles).abs().max() > 1e-4
    # Where the network has pixels alone, that is all that it sees.
    alone = placed(network, pixels, boxed(found[0]))[1]
    assert alone.seen_pose is not None
    assert torch.equal(alone.seen_pose, alone.parameters.joint_angles)


def test_a_network_of_images_sees_the_crop_alone(
    runs: Path, pixels: np.ndarray, found: tuple[DetectedHand, ...]
) -> None:
    network = loaded(runs / "images")
    exchanged = replace(found[0], landmarks_2d=found[0].landmarks_2d[::-1].copy())
    first, second = (placed(network, pixels, one)[1].parameters for one in (found[0], exchanged))
    assert torch.equal(first.joint_angles, second.joint_angles)
    dark = placed(network, (pixels // 3).astype(np.uint8), found[0])[1].parameters
    assert not torch.equal(first.joint_angles, dark.joint_angles)


@pytest.mark.parametrize("run", ["photos", "images"])
def test_estimates_are_before_the_camera_of_the_photograph(
    runs: Path, run: str, pixels: np.ndarray, found: tuple[DetectedHand, ...]
) -> None:
    """The hand projects to the same pixels whatever the focal length is, as near as its depth allows."""
    network = loaded(runs / run)
    hand = open_hand("mediapipe").landmarks_only()
    seen = []
    for focal in (2000.0, 4000.0):
        camera = np.array([[focal, 0.0, 120.0], [0.0, focal, 100.0], [0.0, 0.0, 1.0]])
        _, estimate = placed(network, pixels, found[0], camera=camera)
        points = hand.to_camera(estimate.parameters).landmarks
        seen.append(project(points, torch.from_numpy(camera).float()[None])[0])
        assert float(estimate.parameters.translation[0, 2]) > focal / 2000
    assert float((seen[0] - seen[1]).abs().max()) < 1.0
    # Near the hand, not somewhere else in the image.
    middle = torch.from_numpy(found[0].landmarks_2d.mean(axis=0)).float()
    assert float((seen[0].mean(dim=0) - middle).norm()) < 60


@pytest.mark.parametrize("run", ["photos", "images"])
def test_a_left_hand_is_seen_as_the_right_one_of_the_mirrored_photograph(
    runs: Path, run: str, pixels: np.ndarray, found: tuple[DetectedHand, ...]
) -> None:
    network = loaded(runs / run)
    left = found[1]
    points = left.landmarks_2d * (-1.0, 1.0) + (240.0, 0.0)
    right = replace(left, side="right", landmarks_2d=points)
    mirrored = np.ascontiguousarray(pixels[:, ::-1])
    for shown, other in ((left, right), (boxed(left), boxed(right))):
        first_hands, first = placed(network, pixels, shown)
        second_hands, second = placed(network, mirrored, other)
        # The camera is in the middle, so that its mirror image is itself.
        assert_close(first.parameters.joint_angles, second.parameters.joint_angles)
        assert_close(first.parameters.translation, second.parameters.translation)
        assert_close(first.parameters.root_rotation, second.parameters.root_rotation)
        back = second_hands[0].landmarks_2d * (-1.0, 1.0) + (240.0, 0.0)
        # OpenCV 4 takes pixels at multiples of 1/32: the mirrored crop is not quite the crop mirrored.
        tolerance = 1e-3 if int(cv2.__version__.split(".")[0]) >= 5 else 5e-3
        np.testing.assert_allclose(first_hands[0].landmarks_2d, back, atol=tolerance)


def test_hands_in_one_photograph_do_not_depend_on_each_other(
    runs: Path, pixels: np.ndarray, found: tuple[DetectedHand, ...]
) -> None:
    """Boxes beside landmarks, in any order."""
    network = loaded(runs / "photos")
    mixed = (boxed(found[0]), found[1], boxed(found[1]), found[0])
    hands, together = placed(network, pixels, *mixed)
    for place, one in enumerate(mixed):
        alone_hands, alone = placed(network, pixels, one)
        assert_close(together.parameters.translation[place], alone.parameters.translation[0])
        np.testing.assert_allclose(
            hands[place].landmarks_2d, alone_hands[0].landmarks_2d, atol=1e-3
        )


def test_landmarks_in_a_box_are_those_that_the_crop_shows(
    runs: Path, pixels: np.ndarray, found: tuple[DetectedHand, ...]
) -> None:
    """A photograph of twice the size has them at twice the place, with twice the σ."""
    network = loaded(runs / "dots")
    (hand,), _ = placed(network, pixels, boxed(found[0]))
    assert hand.sigma is not None
    assert has_landmarks(hand)
    large = np.repeat(np.repeat(pixels, 2, axis=0), 2, axis=1)
    twice = boxed(found[0])
    assert twice.box is not None
    (larger,), _ = placed(network, large, replace(twice, box=2 * twice.box), camera=2 * K)
    assert larger.sigma is not None
    np.testing.assert_allclose(larger.landmarks_2d, 2 * hand.landmarks_2d, atol=0.5)
    np.testing.assert_allclose(larger.sigma, 2 * hand.sigma, rtol=0.05)


def test_sigma_is_in_pixels_of_the_photograph(
    tmp_path: Path, pixels: np.ndarray, found: tuple[DetectedHand, ...]
) -> None:
    """σ of the start is e^1.5 pixels of a 224-pixel crop; the crop shows 1.5 · 100 pixels of the image."""
    run = write_run(tmp_path / "run", *IMAGES)
    content = torch.load(run / "checkpoints" / "best.ckpt", weights_only=True)
    for name in ("weight", "bias"):
        content["state_dict"][f"regressor.decoders.log_sigma.{name}"].zero_()
    torch.save(content, run / "checkpoints" / "best.ckpt")
    box = np.array([30.0, 40.0, 130.0, 90.0])
    hand = replace(boxed(found[0]), box=box)
    network = replace(loaded(run), crop=replace(loaded(run).crop, around="box"))
    (seen,), estimate = placed(network, pixels, hand)
    expected = float(soft_bound(torch.tensor(1.5)).exp()) * 150 / 224
    assert seen.sigma is not None
    np.testing.assert_allclose(seen.sigma, expected, rtol=1e-5)
    assert_close(estimate.log_sigma.float(), torch.full((1, 21, 2), math.log(expected)))


def test_the_second_crop_is_about_the_landmarks_of_the_first(
    runs: Path, pixels: np.ndarray, found: tuple[DetectedHand, ...]
) -> None:
    network = loaded(runs / "photos")
    hand = boxed(found[0], margin=30.0)
    (first,), which = network.find(pixels, (hand,))
    assert which == {0}
    low, high = first.landmarks_2d.min(axis=0), first.landmarks_2d.max(axis=0)
    assert first.box is not None
    np.testing.assert_allclose(first.box, np.concatenate([low, high]))
    # Landmarks close together are no hand's: the box stays; so it does if the training cut about boxes.
    assert hand.box is not None
    for other in (
        loaded(runs / "dots"),
        replace(network, crop=replace(network.crop, around="box")),
    ):
        (kept,), _ = other.find(pixels, (hand,))
        assert kept.box is not None
        np.testing.assert_array_equal(kept.box, hand.box)


def test_a_hand_with_neither_landmarks_nor_a_box_has_no_estimate(
    runs: Path, pixels: np.ndarray, found: tuple[DetectedHand, ...]
) -> None:
    network = loaded(runs / "photos")
    few = found[0].landmarks_2d.copy()
    few[3:] = np.nan
    hands, estimate = placed(network, pixels, replace(found[0], landmarks_2d=few), found[1])
    assert estimate.log_sigma.isnan().all(dim=(1, 2)).tolist() == [True, False]
    assert hands[0].sigma is None
    assert placed(network, pixels)[0] == ()
    same = replace(found[0], landmarks_2d=np.full((21, 2), 7.0))
    assert not has_landmarks(same)


def test_a_network_that_diverged_is_an_error(
    tmp_path: Path, pixels: np.ndarray, found: tuple[DetectedHand, ...]
) -> None:
    run = write_run(tmp_path / "run", *IMAGES)
    content = torch.load(run / "checkpoints" / "best.ckpt", weights_only=True)
    content["state_dict"]["regressor.decoders.shape.bias"][:] = torch.nan
    torch.save(content, run / "checkpoints" / "best.ckpt")
    with pytest.raises(ValueError, match="numbers that are not finite: its training diverged"):
        placed(loaded(run), pixels, found[0])
