"""Change between two fits of one hand: millimetres with the wrists in one place, and degrees by joint."""

from dataclasses import replace

import numpy as np
import pytest

from hand_recon.fitting.hand_records import HandRecords
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import ARTICULATED
from hand_recon.page.changes import changes
from tests.support.exported import records_of
from tests.support.trajectories import Clip, moving_hand


@pytest.fixture
def records(hand: HandModel) -> HandRecords:
    """Two hands."""
    return records_of(moving_hand(clip=Clip(frames=2)), hand)


def test_a_hand_that_is_only_elsewhere_has_not_changed(records: HandRecords) -> None:
    farther = replace(records, landmarks_3d=records.landmarks_3d + np.array([0.1, 0.0, 0.4]))
    first = changes(records, farther)[0]
    assert first is not None
    assert first.millimetres == pytest.approx(0.0, abs=1e-9)
    assert first.degrees == 0


def test_one_landmark_and_one_angle_count_as_their_share(records: HandRecords) -> None:
    points, angles = records.landmarks_3d.copy(), records.joint_angles_degrees.copy()
    points[1, 8] += [0.0, 0.0, 0.042]
    angles[1, ARTICULATED.index("ring PIP"), 1] -= 30.0
    nothing, change = changes(
        records, replace(records, landmarks_3d=points, joint_angles_degrees=angles)
    )
    assert nothing is not None
    assert nothing.largest_millimetres == 0
    assert change is not None
    # 42 mm over 21 landmarks, 30° over 15 joints.
    assert change.millimetres == pytest.approx(2.0)
    assert change.largest_millimetres == pytest.approx(42.0)
    assert change.degrees == pytest.approx(2.0)
    assert change.largest_degrees == pytest.approx(30.0)
    assert change.joint == "ring PIP"


def test_a_hand_that_one_fit_lacks_has_no_change(records: HandRecords) -> None:
    missing = replace(records, verdicts=("not fitted", "plausible"))
    assert [change is None for change in changes(records, missing)] == [True, False]
