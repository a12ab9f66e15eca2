"""Points for dex-retargeting against a twin of its transform, written out from its description."""

from pathlib import Path

import numpy as np
import pytest

from hand_recon.detection.detector import Side
from hand_recon.formats.dex_retargeting import operator_points, palm_axes, write_dex_retargeting
from hand_recon.hand.model import HandModel
from hand_recon.motion.posing import landmarks_of
from tests.support.exported import clip
from tests.support.trajectories import moving_hand, still_hand

SIDES: list[Side] = ["right", "left"]


def twin(points: np.ndarray, side: Side) -> np.ndarray:
    """One frame: a plane through wrist, index and middle MCP by SVD, then the operator's axes one by one."""
    from_wrist = points - points[0]
    palm = from_wrist[[0, 5, 9]]
    x = palm[0] - palm[2]
    _, _, rows = np.linalg.svd(palm - palm.mean(axis=0))
    normal = rows[2]
    x -= (x @ normal) * normal
    x /= np.linalg.norm(x)
    z = np.cross(x, normal)
    if z @ (palm[1] - palm[2]) < 0:
        normal, z = -normal, -z
    axes = [-normal, z, -x] if side == "right" else [normal, -z, -x]
    return np.stack([from_wrist @ axis for axis in axes], axis=1)


@pytest.mark.parametrize("side", SIDES)
def test_points_are_those_of_the_twin(hand: HandModel, side: Side) -> None:
    points = landmarks_of(moving_hand(1, side), hand)
    found, rotation = operator_points(points, side)
    for frame, those in zip(found, points, strict=True):
        np.testing.assert_allclose(frame, twin(those, side), atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(rotation), 1.0)
    np.testing.assert_allclose(np.linalg.det(palm_axes(points)), 1.0)


@pytest.mark.parametrize("side", SIDES)
def test_z_runs_along_the_fingers_x_leaves_the_palm_and_y_points_to_one_side(
    hand: HandModel, side: Side
) -> None:
    angles = np.zeros((15, 3))
    angles[3:6, 0] = np.radians(60)
    trajectory = still_hand(angles, side)
    (points,), _ = operator_points(landmarks_of(trajectory, hand), side)
    assert np.allclose(points[0], 0)
    # Straight fingers point to +z, the bent middle finger comes out of the palm, to +x.
    assert points[8, 2] > 0.14
    assert points[12, 0] > 0.04
    thumb = {"right": 1.0, "left": -1.0}[side]
    assert thumb * points[4, 1] > 0.03
    assert thumb * points[20, 1] < -0.02


def test_a_hand_and_its_mirror_image_differ_in_y_alone(hand: HandModel) -> None:
    right = landmarks_of(moving_hand(), hand)
    left = right * np.array([-1.0, 1.0, 1.0])
    mirrored = operator_points(right, "right")[0] * np.array([1.0, -1.0, 1.0])
    np.testing.assert_allclose(operator_points(left, "left")[0], mirrored, atol=1e-12)


def test_the_file_has_the_frames_of_the_hand(hand: HandModel, tmp_path: Path) -> None:
    one = clip(hand).scenes[0].hands[0]
    with np.load(write_dex_retargeting(tmp_path / "a.npz", one)) as file:
        assert set(file) == {
            "points", "wrist_rotation", "wrist", "time", "frame", "seen", "is_right",
        }  # fmt: skip
        assert file["frame"].tolist() == [0, 1, 2, 6, 7, 8, 9]
        assert file["points"].shape == (7, 21, 3)
        assert not file["is_right"]
        np.testing.assert_allclose(file["time"], one.trajectory.times)
