"""Sets of hands that depth is measured on: recorded poses before made-up cameras, and two cameras."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
import torch

from depth.sets import WEBXR_ROWS, half_of, headset_poses, synthetic_views
from depth.stereo import BASES, BLOCK, stereo_clip
from hand_recon.hand.model import HandModel

NAMES = ("rest", "fist", "asl a", "love")


def joints(seed: int) -> np.ndarray:
    """25 joints in WebXR's axes, millimetres, with a palm of a natural length."""
    points = np.random.default_rng(seed).uniform(-80, 80, (25, 3))
    points[0] = 0
    points[11] = [0, 10, -90]
    return points.round()


@pytest.fixture
def handy(tmp_path: Path) -> Path:
    """Four named poses of both sides, the last one of the left without a palm."""
    for first, side in enumerate(("left", "right")):
        rows = [
            {"names": [name, "other name"], "jointPositions": joints(10 * first + place).tolist()}
            for place, name in enumerate(NAMES)
        ]
        if side == "left":
            rows[-1]["jointPositions"] = [[0.0, 0.0, 0.0]] * 25
        (tmp_path / f"poses_{side}.json").write_text(json.dumps(rows))
    return tmp_path


def test_landmarks_leave_out_the_bases_of_the_metacarpals() -> None:
    """WebXR has wrist, four joints of the thumb and five of each finger, metacarpal first."""
    assert len(WEBXR_ROWS) == 21
    assert set(range(25)) - set(WEBXR_ROWS) == {5, 10, 15, 20}


def test_every_pose_is_seen_from_both_sides_of_the_file_and_twice(handy: Path) -> None:
    poses = headset_poses(handy)
    assert len(poses) == (4 + 3) * 2
    assert poses.landmarks.names[:3] == ("rest_right_0", "rest_right_1", "fist_right_0")
    assert poses.landmarks.names[-1] == "asl a_left_1"
    assert poses.landmarks.left.tolist() == [False] * 8 + [True] * 6
    assert poses.groups[0] == poses.groups[1] == poses.groups[8] == "rest"


def test_poses_keep_their_distances_half_a_metre_before_the_camera(handy: Path) -> None:
    poses = headset_poses(handy, noise=0.0)
    expected = joints(10)[list(WEBXR_ROWS)] / 1000
    for view in range(2):
        found = poses.ground_truth[view].numpy()
        for one, other in ((0, 9), (4, 20), (5, 17)):
            length = np.linalg.norm(expected[one] - expected[other])
            assert np.linalg.norm(found[one] - found[other]) == pytest.approx(length)
        assert found[9, 2] == pytest.approx(0.5)
        assert np.abs(found[9, :2]).max() <= 0.05
        # Turned, not mirrored: the volume of four points keeps its sign, WebXR's axes being turned by 180°.
        volumes = [np.linalg.det(points[[4, 8, 20]] - points[0]) for points in (found, expected)]
        assert volumes[0] == pytest.approx(volumes[1])
        pixels = 500 * found[:, :2] / found[:, 2:] + 112
        np.testing.assert_allclose(poses.landmarks.landmarks_2d[view], pixels, atol=0.006)
    assert poses.landmarks.intrinsics is not None
    np.testing.assert_array_equal(poses.landmarks.intrinsics[0, 0], [500, 0, 112])


def test_the_first_view_follows_from_the_generator_of_the_seed(handy: Path) -> None:
    """Draws: a quaternion, two shifts, then the noise of every landmark."""
    random = np.random.default_rng(7)
    quaternion = random.normal(size=4)
    shifts = random.uniform(-0.05, 0.05, size=2)
    noise = random.normal(size=(21, 2))
    poses = headset_poses(handy, seeds=[7], noise=2.0)
    clean = 500 * poses.ground_truth[0, :, :2] / poses.ground_truth[0, :, 2:] + 112
    np.testing.assert_allclose(poses.landmarks.landmarks_2d[0] - clean, 2 * noise, atol=0.006)
    np.testing.assert_allclose(poses.ground_truth[0, 9, :2], shifts)
    # The rotation of a quaternion has the trace 4 w² − 1.
    w = quaternion[0] / np.linalg.norm(quaternion)
    flipped = joints(10)[list(WEBXR_ROWS)] / 1000 * [1, -1, -1]
    found = poses.ground_truth[0].numpy()
    rotation = np.linalg.lstsq(flipped - flipped[9], found - found[9], rcond=None)[0].T
    assert np.trace(rotation) == pytest.approx(4 * w**2 - 1)


def test_the_halves_part_the_poses_by_name_without_changing_a_view(handy: Path) -> None:
    both = headset_poses(handy)
    halves = [headset_poses(handy, half=half) for half in "ab"]
    names = [name for half in halves for name in half.landmarks.names]
    assert sorted(names) == sorted(both.landmarks.names)
    for half, poses in zip("ab", halves, strict=True):
        assert {half_of(name) for name in poses.groups} == {half}
        for place, name in enumerate(poses.landmarks.names):
            there = both.landmarks.names.index(name)
            assert torch.equal(poses.ground_truth[place], both.ground_truth[there])


def test_the_half_of_a_name_is_the_parity_of_its_checksum() -> None:
    """CRC-32 of "123456789" is cbf43926, an even number (the check value of its definition)."""
    assert half_of("123456789") == "a"


def test_seeds_give_further_views_of_the_same_poses(handy: Path) -> None:
    poses = headset_poses(handy, seeds=[0, 1])
    assert len(poses) == 28
    assert len(set(poses.landmarks.names)) == 28
    assert torch.equal(poses.ground_truth[:14], headset_poses(handy).ground_truth)
    assert not torch.equal(poses.ground_truth[14:], poses.ground_truth[:14])


def test_a_folder_without_poses_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"No poses_right\.json.*handy"):
        headset_poses(tmp_path)


def test_synthetic_views_can_hide_their_cameras(tmp_path: Path) -> None:
    shown, hidden = (synthetic_views(4, tmp_path, camera=camera) for camera in (True, False))
    np.testing.assert_array_equal(shown.landmarks.landmarks_2d, hidden.landmarks.landmarks_2d)
    assert shown.landmarks.intrinsics is not None
    assert hidden.landmarks.intrinsics is None
    assert len(set(shown.groups)) == 4


ROTATION = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])


@pytest.fixture
def clip(tmp_path: Path, hand: HandModel) -> Path:
    """Fifty frames in units of 40 mm by two cameras at a right angle, one lost and one badly seen."""
    still = hand(hand.neutral_angles(), torch.zeros(10)).landmarks.double().numpy()
    points = still / 0.04 + np.linspace(0, 1, 50)[:, None, None] * [1.0, 0, 0]
    cameras, tracks = {}, {"points": points.copy(), "error": np.ones(50)}
    for name, rotation, place in (("cam0", np.eye(3), [0, 0, 15]), ("cam1", ROTATION, [0, 0, 20])):
        K = np.array([[900.0, 0, 360], [0, 900, 350], [0, 0, 1]])
        seen = points @ rotation.T + place
        tracks[name] = (seen / seen[..., 2:] @ K.T)[..., :2]
        cameras[name] = {
            "K": K.tolist(), "distortion": [0.0] * 5, "R": rotation.tolist(), "t": place,
        }  # fmt: skip
    tracks["cam0"][3] = tracks["points"][3] = np.nan
    tracks["error"][5] = 9.0
    (tmp_path / "calibration.json").write_text(json.dumps(cameras))
    np.savez(tmp_path / "landmarks.npz", **tracks)
    return tmp_path


def test_frames_that_are_lost_or_badly_triangulated_are_left_out(clip: Path) -> None:
    frames = stereo_clip(clip)
    assert len(frames) == 48
    assert frames.landmarks.names[3:5] == ("frame 4", "frame 6")
    assert frames.groups[BLOCK - 3 : BLOCK - 1] == ("0", "1")


def test_the_unit_of_the_clip_is_that_of_a_hand_of_mean_size(clip: Path) -> None:
    frames = stereo_clip(clip)
    lengths = (frames.ground_truth[:, BASES] - frames.ground_truth[:, :1]).norm(dim=-1)
    points = np.load(clip / "landmarks.npz")["points"][0]
    expected = 0.04 * np.linalg.norm(points[list(BASES)] - points[0], axis=-1)
    np.testing.assert_allclose(lengths[0], expected, rtol=1e-6)


def test_ground_truth_projects_to_the_landmarks_of_both_cameras(clip: Path) -> None:
    frames = stereo_clip(clip)
    camera, second = frames.landmarks.intrinsics, frames.second
    assert camera is not None
    assert second is not None
    elsewhere = frames.ground_truth @ second.rotation.mT + second.translation
    for points, matrix, seen in (
        (frames.ground_truth, camera[0], frames.landmarks.landmarks_2d),
        (elsewhere, second.intrinsics, second.landmarks_2d),
    ):
        pixels = (points / points[..., 2:] @ matrix.mT)[..., :2]
        np.testing.assert_allclose(pixels, seen, atol=1e-6)


def test_a_folder_without_a_clip_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"No calibration\.json.*stereo clip"):
        stereo_clip(tmp_path)


def test_the_published_clip_is_read_without_distortion() -> None:
    material = os.environ.get("HAND_RECON_MATERIAL")
    folder = Path(material or "") / "video" / "stereo"
    if material is None or not folder.is_dir():
        pytest.skip("HAND_RECON_MATERIAL names no folder with video/stereo")
    frames = stereo_clip(folder)
    camera = frames.landmarks.intrinsics
    assert camera is not None
    points = frames.ground_truth
    pixels = (points / points[..., 2:] @ camera[0].mT)[..., :2]
    # The triangulation's own reprojection error has a median of 1.6 px.
    assert (pixels - frames.landmarks.landmarks_2d).norm(dim=-1).median() < 2.0
