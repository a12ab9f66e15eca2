"""Made-up clips and scores of the tool that measures motion."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from hand_recon.hand.open_hand import open_hand
from hand_recon.motion.bridging import trajectory_of
from hand_recon.motion.posing import landmarks_of
from motion.clips import MotionClip, landmark_clip, made_up_clip
from motion.scores import flips_of, markdown, scores_of_truth
from tests.support.made_up_motion import moving_poses

WEBXR_BONES = tuple((0 if place % 4 == 0 else place, place + 1) for place in range(20))


@pytest.fixture
def handy(tmp_path: Path) -> Path:
    """Twenty made-up poses of both sides: bones of one length each in any directions but the palm's."""
    random = np.random.default_rng(0)
    base = open_hand()(torch.zeros(15, 3), torch.zeros(10)).landmarks.double().numpy()
    lengths = [np.linalg.norm(base[end] - base[start]) for start, end in WEBXR_BONES]
    rows = [row for row in range(25) if row not in {5, 10, 15, 20}]
    for side in ("left", "right"):
        poses = []
        for pose in range(20):
            points = base.copy()
            for (start, end), length in zip(WEBXR_BONES, lengths, strict=True):
                if start:
                    towards = base[end] - base[start] + 0.01 * random.normal(size=3)
                    points[end] = points[start] + length * towards / np.linalg.norm(towards)
            joints = np.zeros((25, 3))
            joints[rows] = 1000 * (points - points[0]) * [1.0, -1.0, -1.0]
            poses.append({"names": [f"pose {pose}"], "jointPositions": joints.tolist()})
        (tmp_path / f"poses_{side}.json").write_text(json.dumps(poses))
    return tmp_path


def _clip(
    handy: Path, *, noise: float = 0.0, correlation: float = 0.0, seed: int = 1
) -> MotionClip:
    return made_up_clip(handy, side="right", seed=seed, noise=noise, correlation=correlation)


def _off(clip: MotionClip) -> np.ndarray:
    """Given minus projected landmarks, pixels."""
    camera = clip.landmarks.intrinsics
    assert camera is not None
    truth = clip.ground_truth[clip.frames] @ camera[0].numpy().T
    return np.asarray(clip.landmarks.landmarks_2d.numpy() - truth[..., :2] / truth[..., 2:])


def test_bones_keep_their_lengths_while_they_turn(handy: Path) -> None:
    points = _clip(handy).ground_truth
    for start, end in WEBXR_BONES:
        lengths = np.linalg.norm(points[:, end] - points[:, start], axis=-1)
        np.testing.assert_allclose(lengths, lengths[0], rtol=1e-3)


def test_motion_is_smooth_and_goes_from_pose_to_pose(handy: Path) -> None:
    points = _clip(handy).ground_truth
    steps = np.linalg.norm(np.diff(points, axis=0), axis=-1)
    assert steps.max() < 0.06
    assert np.linalg.norm(points - points[0], axis=-1).max() > 0.03


def test_noise_has_its_size_and_its_correlation(handy: Path) -> None:
    np.testing.assert_allclose(_off(_clip(handy)), 0.0, atol=0.0051)
    clip = _clip(handy, noise=3.0, correlation=0.7)
    off = _off(clip)
    assert off.std() == pytest.approx(3.0, rel=0.1)
    beside = np.diff(clip.frames) == 1
    found = (off[1:] * off[:-1])[beside].mean() / off.var()
    assert found == pytest.approx(0.7, abs=0.06)


def test_frames_are_missing_here_and_there_and_in_one_gap(handy: Path) -> None:
    clip = _clip(handy)
    steps = np.diff(clip.frames)
    assert clip.frames[0] == 0
    assert len(clip.ground_truth) == clip.frames[-1] + 1
    assert (steps >= 10).sum() == 1
    assert 1 < (steps > 1).sum() < 0.15 * len(steps)


def test_a_seed_is_one_clip(handy: Path) -> None:
    one, same, other = (_clip(handy, noise=1.0, seed=seed) for seed in (1, 1, 2))
    assert torch.equal(one.landmarks.landmarks_2d, same.landmarks.landmarks_2d)
    assert one.ground_truth.shape != other.ground_truth.shape


def test_the_ground_truth_has_no_error_of_acceleration(handy: Path) -> None:
    clip = _clip(handy, noise=2.0)
    found = scores_of_truth(clip)
    assert (found.error, found.acceleration_error) == (0.0, 0.0)
    assert 0 < found.relative_jitter < found.jitter
    assert "| clip | truth | 0 |" in markdown([("clip", "truth", found)])


def test_a_clip_is_read_from_landmarks_a_camera_and_ground_truth(tmp_path: Path) -> None:
    truth = np.random.default_rng(0).uniform(0.3, 0.5, (4, 21, 3))
    camera = np.array([[800.0, 0, 320], [0, 700, 240], [0, 0, 1]])
    pixels = truth @ camera.T
    (tmp_path / "frames.json").write_text(json.dumps((pixels[..., :2] / pixels[..., 2:]).tolist()))
    (tmp_path / "K.json").write_text(json.dumps(camera.tolist()))
    np.save(tmp_path / "truth.npy", truth)
    clip = landmark_clip(tmp_path)
    np.testing.assert_allclose(_off(clip), 0.0, atol=0.0051)


def test_a_finger_away_for_one_frame_is_a_flip_and_a_moving_one_is_not() -> None:
    angles = np.zeros((9, 15, 3))
    angles[:, 3, 0] = np.linspace(0, 2, 9)
    assert flips_of(angles) == 0
    angles[4, :3, 0] = 0.6
    assert flips_of(angles) == 1


def test_landmarks_of_a_left_hand_mirror_those_of_the_right_one() -> None:
    hand = open_hand().landmarks_only()
    right, left = (
        landmarks_of(trajectory_of(moving_poses(4), hand=1, side=side, shape=np.zeros(10)), hand)
        for side in ("right", "left")
    )
    np.testing.assert_allclose(left, right * [-1.0, 1.0, 1.0], atol=1e-6)
