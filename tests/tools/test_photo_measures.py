"""Measures of networks for photographs: groups, ways to a hand, scores and tables."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from hand_recon.hand.open_hand import open_hand
from hand_recon.regressor.error_feedback import Regressor
from hand_recon.regressor.landmark_encoder import LandmarkEncoder
from hand_recon.regressor.lifted import start_from_lifter
from hand_recon.regressor.photo_encoder import PhotoEncoder
from hand_recon.runs.lifters import load_named
from photos.drawing import PER_LINE, SIDE, page
from photos.methods import WAYS, Refinement, look, methods, refined
from photos.scores import score
from photos.sets import PhotoSet, _frames, _gesture, _lightness, _palm_width
from photos.tables import as_json, group_table, main_table
from tests.support.views import known_hands, views


@pytest.mark.parametrize(
    ("name", "gesture"),
    [
        ("gestures/rock_1a2b-3c.jpg", "rock"),
        ("gestures/two_up_inverted_9f.jpg", "two_up_inverted"),
        ("digits/7_IMG_1118.jpg", "7"),
        ("rps/testing_paper.0095_png.rf.f7_00578.jpg", "paper"),
        ("rps/training_scissors.egohands-1_2.jpg", "scissors"),
    ],
)
def test_the_gesture_in_a_name(name: str, gesture: str) -> None:
    assert _gesture(Path(name)) == gesture


@pytest.fixture(scope="module")
def network() -> Regressor:
    """The packaged lifter behind maps with random weights."""
    hand = open_hand("mediapipe")
    lifter = load_named("default", hand)
    encoder = PhotoEncoder(
        "efficientnet_lite0", "none", landmarks=LandmarkEncoder(512, 2, 0.0), width=8
    )
    network = Regressor(encoder, hand, width=512, dropout=0.0, activation=True, reprojection=True)
    start_from_lifter(network, lifter)
    return network.eval()


@pytest.fixture(scope="module")
def seen(network: Regressor) -> PhotoSet:
    """Eight hands before grey backgrounds."""
    torch.manual_seed(0)
    batch = views(network.hand, known_hands(network.hand, 8))
    image = torch.full((8, 3, 64, 64), 119, dtype=torch.uint8)
    image[4:] = 20
    small = replace(
        batch,
        image=image,
        landmarks_2d=batch.landmarks_2d * 64 / 224,
        intrinsics=None,
        vertices=None,
    )
    groups: dict[str, tuple[str, ...]] = {"gesture": ("a", "b") * 4}
    groups |= {"view": ("side", "", "", "", "", "", "", "")}
    return PhotoSet("photographs", small, groups, tuple("abcdefgh"))


def test_lightness_is_that_of_the_palm(seen: PhotoSet) -> None:
    # L* of the grey 119 is 50.0, of the grey 20 it is 6.3 (CIE 1976, sRGB); OpenCV rounds to 0.4.
    lightness = _lightness(seen.batch)
    assert lightness[:4] == pytest.approx([50.0] * 4, abs=0.5)
    assert lightness[4:] == pytest.approx([6.3] * 4, abs=0.5)


def test_the_width_of_a_palm() -> None:
    points = torch.zeros(1, 21, 2)
    points[0, 9] = torch.tensor([0.0, -10.0])
    points[0, 5], points[0, 17] = torch.tensor([-3.0, -9.0]), torch.tensor([3.0, -9.0])
    assert _palm_width(points) == pytest.approx([0.6])


def test_given_landmarks_are_seen_and_the_fit_comes_nearer(
    network: Regressor, seen: PhotoSet
) -> None:
    batch = seen.batch
    pixels = look(network, batch, with_landmarks=False)
    both = look(network, batch, with_landmarks=True)
    # Random maps see no pose that a fit could be kept near.
    refinement = Refinement.of(network, ("seen_pose_weight=0",))
    fitted = refined(network, refinement, batch, with_landmarks=True)
    errors = [
        float((one.landmarks_2d - batch.landmarks_2d).norm(dim=-1).mean()) * 224 / 64
        for one in (pixels, both, fitted)
    ]
    # They see no landmarks either; the lifter is some pixels off; the fit explains exact landmarks.
    assert errors[0] > 20 > 12 > errors[1] > errors[2]
    assert errors[2] < 2


def test_hands_of_one_person_share_a_shape(network: Regressor, seen: PhotoSet) -> None:
    assert "both + fit, one person" not in methods(network)
    ways = methods(network, one_person=True)
    assert tuple(ways) == WAYS
    alone, together = (ways[name](seen).parameters.shape for name in WAYS[-2:])
    assert float(alone.std(dim=0).max()) > 1e-3
    assert float(together.std(dim=0).max()) < 1e-6


def test_pixels_alone_are_fitted_to_what_the_network_found(
    network: Regressor, seen: PhotoSet
) -> None:
    found = look(network, seen.batch, with_landmarks=False)
    hidden = replace(seen.batch, landmarks_2d=torch.full_like(seen.batch.landmarks_2d, 7.0))
    first, second = (
        refined(network, Refinement.of(network), batch, with_landmarks=False)
        for batch in (seen.batch, hidden)
    )
    assert torch.equal(first.landmarks_3d, second.landmarks_3d)
    assert found.located_2d is not None
    nearer = (first.landmarks_2d - found.located_2d).norm(dim=-1).mean()
    assert float(nearer) < float((found.landmarks_2d - found.located_2d).norm(dim=-1).mean())


def test_tables_say_what_was_scored(network: Regressor, seen: PhotoSet) -> None:
    scored = [
        score(seen, name, way(seen), network.hand)
        for name, way in methods(network).items()
        if name in ("pixels", "both")
    ]
    error = (scored[1].prediction.landmarks_2d - seen.batch.landmarks_2d).norm(dim=-1).mean(dim=-1)
    assert scored[1].mean("E_2D").value == pytest.approx(float(error.mean()) * 3.5, rel=1e-5)
    whole = main_table(scored)
    assert f"| both | {scored[1].mean('E_2D')} |" in whole
    assert "PA-MPJPE" in whole
    groups = group_table(scored, unseen=["b"])
    left_out = float(error[1::2].mean() / error.mean())
    mean = scored[1].mean("E_2D", torch.arange(1, 8, 2))
    assert f"| gestures left out | 4 | {mean} | {left_out:.2f} |" in groups
    assert "| view: side | 1 |" in groups
    entry = as_json(scored)["scores"][1]
    assert (entry["set"], entry["method"], entry["hands"]) == ("photographs", "both", 8)
    assert (
        0 <= entry["calibration"]["coverage_1sigma"] <= entry["calibration"]["coverage_2sigma"] <= 1
    )


def test_a_network_without_the_likelihood_has_no_calibration(
    network: Regressor, seen: PhotoSet
) -> None:
    found = score(seen, "row 1", look(network, seen.batch, with_landmarks=False), network.hand)
    line = main_table([replace(found, calibration={})]).splitlines()[4]
    assert line.endswith("| — | — | — |")
    assert line.count("|") == main_table([found]).splitlines()[4].count("|")


def test_a_page_has_every_method_in_two_views(network: Regressor, seen: PhotoSet) -> None:
    scored = [score(seen, "both", look(network, seen.batch, with_landmarks=True), network.hand)]
    drawn = page([*scored, *scored], photographs=6)
    assert drawn.shape == (3 * SIDE, 2 * SIDE * PER_LINE, 3)
    # The photograph is flat; the mesh over it is not, and its view from the side is on white.
    assert drawn[:SIDE, :SIDE].std() == 0
    assert drawn[SIDE : 2 * SIDE, :SIDE].std() > 1
    assert (drawn[SIDE : 2 * SIDE, SIDE : 2 * SIDE] == 255).mean() > 0.3


def test_frames_of_a_video_by_number(tmp_path: Path) -> None:
    path = tmp_path / "clip.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10, (32, 32))
    for value in (40, 120, 200):
        writer.write(np.full((32, 32, 3), (value, 60, 60), np.uint8))
    writer.release()
    first, last = _frames(path, [0, 2])
    # RGB: OpenCV's blue is the last channel.
    assert abs(float(first[..., 2].mean()) - 40) < 6
    assert abs(float(last[..., 2].mean()) - 200) < 6
    with pytest.raises(ValueError, match="3 frames"):
        _frames(path, [3])
