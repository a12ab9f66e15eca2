"""Markers and motion files at even times, with gaps as each format has them; clinical signs of angles."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hand_recon.detection.detector import Side
from hand_recon.formats.bvh import STEADY
from hand_recon.formats.clinical_angles import CLINICAL_ANGLES, clinical_degrees
from hand_recon.formats.even_times import even_rows
from hand_recon.formats.exported_hands import ExportedHand
from hand_recon.formats.opensim import write_mot, write_trc
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import ARTICULATED, AXES, LANDMARKS
from hand_recon.motion.trajectory import Trajectory
from tests.support.exported import clip, expected_joints
from tests.support.opensim_reader import read_mot, read_trc
from tests.support.trajectories import Clip, moving_hand, still_hand, with_times, without_frames

SIDES: list[Side] = ["right", "left"]


def hand_of(trajectory: Trajectory) -> ExportedHand:
    """A hand whose landmarks move one metre in a second, each from its own place."""
    count = len(trajectory)
    points = np.arange(63.0).reshape(1, 21, 3) + trajectory.times[:, None, None]
    return ExportedHand(trajectory, points, np.full((count, 21, 3, 3), np.nan))


def test_even_frames_are_taken_as_they_are() -> None:
    rows = even_rows(moving_hand(1, "right", Clip(frames=5, start=3)))
    np.testing.assert_allclose(rows.times, np.arange(3, 8) / 30)
    assert rows.step == pytest.approx(1 / 30)
    values = np.random.default_rng(0).normal(size=(5, 2))
    np.testing.assert_allclose(rows.sample(values), values)
    assert not rows.in_gap.any()


def test_a_missing_frame_has_a_row_in_a_gap() -> None:
    rows = even_rows(without_frames(moving_hand(1, "right", Clip(frames=6)), 2, 3))
    assert rows.in_gap.tolist() == [False, False, True, True, False, False]
    found = rows.sample(np.array([0.0, 1.0, 4.0, 5.0]))
    np.testing.assert_allclose(found, np.arange(6.0))


def test_uneven_times_are_sampled_again_at_the_median_step() -> None:
    times = np.array([0.0, 0.1, 0.2, 0.45, 0.5])
    rows = even_rows(with_times(moving_hand(1, "right", Clip(frames=5)), times))
    np.testing.assert_allclose(rows.times, np.linspace(0.0, 0.5, 6), atol=1e-12)
    np.testing.assert_allclose(rows.sample(3 * times), 3 * rows.times, atol=1e-12)
    assert not rows.in_gap.any()


@given(
    st.sets(st.integers(0, 30), min_size=2, max_size=20),
    st.lists(st.floats(-0.3, 0.3), min_size=31, max_size=31),
)
def test_rows_are_even_from_the_first_frame_to_the_last(
    frames: set[int], jitter: list[float]
) -> None:
    kept = np.array(sorted(frames))
    whole = moving_hand(1, "right", Clip(frames=31))
    times = (np.arange(31) + np.array(jitter) + 0.3) / 30
    motion = without_frames(with_times(whole, times), *set(range(31)) - frames)
    rows = even_rows(motion)
    assert rows.times[0] == motion.times[0]
    np.testing.assert_allclose(rows.times[-1], motion.times[-1], atol=1e-12)
    np.testing.assert_allclose(np.diff(rows.times), rows.step, atol=1e-12)
    assert ((rows.share >= -1e-12) & (rows.share <= 1 + 1e-12)).all()
    # What moves evenly is sampled where it is, but for times that are taken as even.
    found = rows.sample(motion.times)
    assert np.abs(found - rows.times).max() <= 1.01 * STEADY * rows.step
    # Rows are missing inside gaps alone.
    assert not rows.in_gap.any() or np.diff(kept).max() > 1


def test_a_single_frame_is_a_row() -> None:
    rows = even_rows(still_hand())
    assert (rows.times.tolist(), rows.in_gap.tolist()) == ([0.0], [False])
    assert rows.sample(np.array([[7.0]])).tolist() == [[7.0]]


def test_markers_are_y_up_in_millimetres_and_missing_in_gaps(tmp_path: Path) -> None:
    trajectory = without_frames(moving_hand(1, "left", Clip(frames=6, start=4)), 6, 7)
    path = write_trc(tmp_path / "new" / "a.trc", hand_of(trajectory))
    text = path.read_text().split("\n")
    assert text[2].split("\t")[2:5] == ["6", "21", "mm"]
    assert text[8].split("\t") == ["3", "0.200000", *["NaN"] * 63]
    # Landmark 0 is at (t, 1 + t, 2 + t) metres in the camera's frame.
    assert text[6].split("\t")[1:5] == ["0.133333", "133.3333", "-1133.3333", "-2133.3333"]
    markers = read_trc(path)
    assert markers.rate == pytest.approx(30)
    assert markers.names[5] == "index_MCP"
    assert len(markers.names) == len(LANDMARKS)
    missing = np.isnan(markers.points).all(axis=(1, 2))
    assert missing.tolist() == [False, False, True, True, False, False]
    with pytest.raises(FileExistsError, match=r"a\.trc exists and is not overwritten"):
        write_trc(path, hand_of(trajectory))


def test_a_motion_file_bridges_gaps_and_has_even_times(tmp_path: Path) -> None:
    trajectory = without_frames(moving_hand(1, "right", Clip(frames=6)), 2, 3)
    columns, header = read_mot(write_mot(tmp_path / "a.mot", hand_of(trajectory)))
    assert header == {"version": "1", "nRows": "6", "nColumns": "46", "inDegrees": "yes"}
    assert np.ptp(np.diff(columns["time"])) < 2e-6
    flexion = np.degrees(trajectory.joint_angles[:, ARTICULATED.index("ring PIP"), 0])
    expected = np.interp(np.arange(6), [0, 1, 4, 5], flexion)
    np.testing.assert_allclose(columns["ring_PIP_flexion"], expected, atol=1e-5)


def moved(hand: HandModel, side: Side, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Joints of a hand with one clinical angle of 20°, and without, camera frame."""
    (angle,) = [one for one in CLINICAL_ANGLES if one.name == name]
    joint_angles = np.zeros((15, 3))
    joint_angles[angle.joint, angle.axis] = angle.sign * np.radians(20)
    with_angle = still_hand(joint_angles, side)
    column = [one.name for one in CLINICAL_ANGLES].index(name)
    assert clinical_degrees(with_angle)[0, column] == pytest.approx(20)
    return tuple(expected_joints(one, hand)[0] for one in (with_angle, still_hand(side=side)))


@pytest.mark.parametrize("side", SIDES)
def test_abduction_leads_away_from_the_middle_finger_and_flexion_to_the_palm(
    hand: HandModel, side: Side
) -> None:
    middle = 5
    for finger, joint in (("index", 2), ("little", 8), ("ring", 11)):
        after, before = moved(hand, side, f"{finger}_MCP_abduction")
        apart = [np.linalg.norm(those[joint] - those[middle]) for those in (after, before)]
        assert apart[0] > apart[1] + 0.005
        # The palm looks to the camera, along −z.
        after, before = moved(hand, side, f"{finger}_MCP_flexion")
        assert after[joint, 2] < before[joint, 2] - 0.005
    after, before = moved(hand, side, "middle_MCP_radial_deviation")
    index = [np.linalg.norm(those[2] - those[middle]) for those in (after, before)]
    assert index[0] < index[1] - 0.005


@pytest.mark.parametrize("side", SIDES)
def test_the_thumbs_abduction_leads_away_from_the_index_finger_and_out_of_the_palm(
    hand: HandModel, side: Side
) -> None:
    after, before = moved(hand, side, "thumb_CMC_abduction")
    tip, index_mcp = 15, 1
    apart = [np.linalg.norm(those[tip] - those[index_mcp]) for those in (after, before)]
    assert apart[0] > apart[1] + 0.005
    assert after[tip, 2] < before[tip, 2] - 0.005


@pytest.mark.parametrize("side", SIDES)
def test_pronation_rotates_the_back_of_a_finger_to_the_thumbs_side(
    hand: HandModel, side: Side
) -> None:
    """A finger that is bent by 90° shows the rotation of its first phalanx by where its tip goes."""
    bent, turned = np.zeros((15, 3)), np.zeros((15, 3))
    bent[1, 0] = turned[1, 0] = np.pi / 2
    turned[0, AXES.index("twist")] = np.radians(20)
    after, before = (expected_joints(still_hand(one, side), hand)[0] for one in (turned, bent))
    radial = before[1] - before[7]
    # The back goes to the thumb's side, so that the tip, on the palm's side, goes to the little finger's.
    assert (after[3] - before[3]) @ radial / np.linalg.norm(radial) < -0.003
    (column,) = [
        number for number, one in enumerate(CLINICAL_ANGLES) if one.name == "index_MCP_pronation"
    ]
    assert clinical_degrees(still_hand(turned, side))[0, column] == pytest.approx(20)


def test_every_angle_has_a_name_of_its_own() -> None:
    assert len({one.name for one in CLINICAL_ANGLES}) == 45
    assert [(one.joint, one.axis) for one in CLINICAL_ANGLES] == [
        (joint, axis) for joint in range(15) for axis in range(3)
    ]


def test_numbers_that_are_not_finite_are_refused(hand: HandModel, tmp_path: Path) -> None:
    one = clip(hand).scenes[0].hands[0]
    broken = replace(one.trajectory, translation=np.full((len(one.trajectory), 3), np.nan))
    for write in (write_trc, write_mot):
        with pytest.raises(ValueError, match="Hand 1 has numbers that are not finite"):
            write(tmp_path / "a", replace(one, trajectory=broken))
    assert not list(tmp_path.iterdir())
