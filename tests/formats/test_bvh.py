"""BVH files, read back by an independent reader, hold the motion that was written."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hand_recon.detection.detector import Side
from hand_recon.formats.bvh import bvh, to_euler_degrees, write_bvh
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import JOINTS, PARENTS, TIPS
from hand_recon.motion.trajectory import Trajectory
from tests.support.bvh_reader import BvhReader
from tests.support.trajectories import (
    MIRROR,
    TO_GLTF,
    Clip,
    in_camera,
    in_world,
    moving_hand,
    still_hand,
)

TENTH_OF_A_MILLIMETRE = 1e-4
SIDES: list[Side] = ["right", "left"]
LAST_OF_FINGERS = ("thumb IP", "index DIP", "middle DIP", "ring DIP", "little DIP")


def positions(found: BvhReader, side: Side) -> np.ndarray:
    """Positions of the 16 joints at all frames."""
    frames = [found.positions(values) for values in found.values]
    return np.array(
        [[frame[f"{side}_{joint.replace(' ', '_')}"] for joint in JOINTS] for frame in frames]
    )


@pytest.mark.parametrize("side", SIDES)
def test_joints_are_the_hand_models_at_every_frame(hand: HandModel, side: Side) -> None:
    trajectory = moving_hand(1, side)
    found = positions(BvhReader(bvh(trajectory, hand)), side)
    expected = in_world(in_camera(trajectory, hand).joints)
    assert found.shape == expected.shape == (20, 16, 3)
    assert np.abs(found - expected).max() < TENTH_OF_A_MILLIMETRE


@pytest.mark.parametrize("side", SIDES)
def test_fingers_end_at_the_tips_of_the_hand_model(hand: HandModel, side: Side) -> None:
    trajectory = replace(still_hand(side=side), shape=np.linspace(-1, 1, 10))
    (values,) = (found := BvhReader(bvh(trajectory, hand))).values
    places = found.positions(values)
    expected = in_world(in_camera(trajectory, hand).landmarks)[0, list(TIPS)]
    for joint, tip in zip(LAST_OF_FINGERS, expected, strict=True):
        end = places[f"{side}_{joint.replace(' ', '_')} end"]
        assert np.abs(end - tip).max() < TENTH_OF_A_MILLIMETRE


@pytest.mark.parametrize("side", SIDES)
def test_the_rest_pose_has_all_joint_angles_zero(hand: HandModel, side: Side) -> None:
    trajectory = moving_hand(1, side, Clip(frames=2))
    found = BvhReader(bvh(trajectory, hand))
    found.values = np.zeros_like(found.values[:1])
    shape = torch.as_tensor(trajectory.shape).float()
    joints = hand(hand.neutral_angles(), shape).joints
    expected = (joints - joints[0]).numpy() * (MIRROR.numpy() if side == "left" else 1)
    assert np.abs(positions(found, side)[0] - expected).max() < 2e-6
    # And a hand with zero angles rotates at the root alone.
    (values,) = BvhReader(bvh(still_hand(side=side), hand)).values
    assert np.abs(values[6:]).max() < 1e-4


def test_bending_a_finger_rotates_its_joints_about_z(hand: HandModel) -> None:
    angles = np.zeros((15, 3))
    angles[JOINTS.index("index PIP") - 1, 0] = math.radians(30)
    found = BvhReader(bvh(still_hand(angles), hand))
    column = 6 + 3 * (
        [joint.name for joint in found.joints if joint.channels].index("right_index_PIP") - 1
    )
    bend = found.values[0, column : column + 3]
    # The axis of a finger's bend is z but for a few degrees.
    assert abs(bend[0]) == pytest.approx(30, abs=1)
    others = np.delete(found.values[0, 6:], range(column - 6, column - 3))
    assert np.abs(others).max() < 1e-4


def test_the_skeleton_has_the_channels_that_all_readers_take(hand: HandModel) -> None:
    found = BvhReader(bvh(moving_hand(1, "left"), hand))
    root, *others = [joint for joint in found.joints if not joint.name.endswith(" end")]
    rotations = ["Zrotation", "Xrotation", "Yrotation"]
    assert root.name == "left_wrist"
    assert root.offset.tolist() == [0, 0, 0]
    assert root.channels == ["Xposition", "Yposition", "Zposition", *rotations]
    assert all(joint.channels == rotations for joint in others)
    names = [joint.name for joint in found.joints]
    assert len(set(names)) == 16 + 5
    parents = {joint.name: names[joint.parent] for joint in others}
    assert parents == {
        f"left_{JOINTS[joint].replace(' ', '_')}": f"left_{JOINTS[parent].replace(' ', '_')}"
        for joint, parent in enumerate(PARENTS)
        if joint
    }


def test_the_frame_time_is_that_of_the_clip(hand: HandModel) -> None:
    trajectory = moving_hand(1, "right", Clip(frames=5, start=7, rate=25))
    found = BvhReader(bvh(trajectory, hand))
    assert found.frame_time == pytest.approx(0.04, abs=1e-8)
    assert len(found.values) == 5
    # Times of a container are often rounded to milliseconds, which is no other rate.
    jitter = np.array([0, 5e-4, 0, -5e-4, 0])
    rounded = replace(trajectory, times=trajectory.times.round(3) + jitter)
    assert np.allclose(BvhReader(bvh(rounded, hand)).values, found.values)
    assert BvhReader(bvh(still_hand(), hand)).frame_time == pytest.approx(1 / 30, abs=1e-8)


def steady(times: np.ndarray) -> Trajectory:
    """A hand that rotates by 90° a second and moves by 10 cm a second, seen at the given times."""
    count = len(times)
    rotation = Rotation.from_rotvec(times[:, None] * (np.pi / 2) * np.array([0.6, 0.8, 0.0]))
    angles = np.tile(np.full((15, 3), 0.1), (count, 1, 1))
    return Trajectory(
        1, "right", np.arange(count), times, angles, rotation.as_matrix(), times[:, None] * [0.1, 0, 0],
        np.zeros(10), np.ones(count, dtype=bool),
    )  # fmt: skip


def test_varying_times_are_sampled_at_a_constant_rate(hand: HandModel) -> None:
    # The median of 0.1, 0.1, 0.3, 0.1, 0.2 is 0.1, so 0.8 s are eight steps.
    found = BvhReader(bvh(steady(np.array([1.0, 1.1, 1.2, 1.5, 1.6, 1.8])), hand))
    assert found.frame_time == pytest.approx(0.1)
    assert len(found.values) == 9
    even = steady(1.0 + 0.1 * np.arange(9))
    # About the wrist, which moves on a straight line from frame to frame and not on the arc.
    actual, expected = positions(found, "right"), in_world(in_camera(even, hand).joints)
    assert (
        np.abs((actual - actual[:, :1]) - (expected - expected[:, :1])).max()
        < TENTH_OF_A_MILLIMETRE
    )
    for seen in (0, 1, 2, 5, 6, 8):
        assert np.abs(actual[seen] - expected[seen]).max() < TENTH_OF_A_MILLIMETRE


@given(st.lists(st.tuples(*[st.floats(-4, 4)] * 3), min_size=1, max_size=6))
def test_angles_are_those_of_the_rotations(axis_angles: list[tuple[float, ...]]) -> None:
    rotations = Rotation.from_rotvec(np.array(axis_angles)).as_matrix()[:, None]
    angles = to_euler_degrees(rotations)
    back = Rotation.from_euler("ZXY", angles[:, 0], degrees=True).as_matrix()
    assert np.abs(back - rotations[:, 0]).max() < 1e-6


def test_where_angles_lock_the_rotation_is_exact(hand: HandModel) -> None:
    # The hand's y axis is the camera's −z: R_x of 90° in the world, where Z and Y are one rotation.
    trajectory = still_hand()
    facing = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    for rotation in (
        facing,
        np.diag([1.0, 1, 1]),
        np.diag([-1.0, -1, 1]),
        trajectory.root_rotation[0],
    ):
        turned = replace(trajectory, root_rotation=rotation[None])
        found = positions(BvhReader(bvh(turned, hand)), "right")
        expected = in_world(in_camera(turned, hand).joints)
        assert np.abs(found - expected).max() < TENTH_OF_A_MILLIMETRE


def test_angles_go_on_past_half_a_turn() -> None:
    degrees = np.arange(0.0, 800.0, 40.0)
    for axis, column in (("Z", 0), ("Y", 2)):
        rotations = Rotation.from_euler(axis, degrees[:, None], degrees=True).as_matrix()[:, None]
        angles = to_euler_degrees(rotations)[:, 0]
        assert np.allclose(angles[:, column], degrees)
        assert np.allclose(np.delete(angles, column, axis=1), 0, atol=1e-9)
    # Beyond 90° the second angle has one set of angles with it and one that jumps by 180°.
    rotations = Rotation.from_euler("X", degrees[:, None], degrees=True).as_matrix()[:, None]
    assert np.allclose(to_euler_degrees(rotations)[:, 0], degrees[:, None] * [0, 1, 0], atol=1e-6)


def test_up_is_y_and_lengths_are_metres(hand: HandModel) -> None:
    trajectory = replace(still_hand(), translation=np.array([[0.1, -0.2, 0.5]]))
    place = positions(BvhReader(bvh(trajectory, hand)), "right")[0, JOINTS.index("middle MCP")]
    assert np.allclose(place, np.array([0.1, -0.2, 0.5]) * TO_GLTF, atol=1e-5)
    assert np.allclose(place, [0.1, 0.2, -0.5], atol=1e-5)


def test_nothing_is_overwritten_and_folders_are_made(tmp_path: Path, hand: HandModel) -> None:
    path = write_bvh(tmp_path / "new" / "hand.bvh", still_hand(), hand)
    text = path.read_text("ascii")
    assert text == bvh(still_hand(), hand)
    with pytest.raises(FileExistsError, match=r"hand\.bvh exists and is not overwritten"):
        write_bvh(path, still_hand(side="left"), hand)
    assert path.read_text("ascii") == text


def test_what_has_no_motion_is_refused(hand: HandModel) -> None:
    with pytest.raises(ValueError, match="Hand 4 has no frame"):
        bvh(moving_hand(4, "right", Clip(frames=0)), hand)
    lost = replace(still_hand(), translation=np.full((1, 3), np.nan))
    with pytest.raises(ValueError, match="Hand 1 has numbers that are not finite"):
        bvh(lost, hand)
