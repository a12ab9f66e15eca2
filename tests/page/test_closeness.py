"""Distance of joint angles to their limits: numbers from the table of ranges, worked out by hand."""

import numpy as np
import pytest

from hand_recon.hand.skeleton import ARTICULATED
from hand_recon.knowledge.ranges import RangeOfMotion, load_ranges
from hand_recon.page.closeness import limit_state

MCP, PIP, DIP = (ARTICULATED.index(f"index {part}") for part in ("MCP", "PIP", "DIP"))


@pytest.fixture(scope="module")
def ranges() -> RangeOfMotion:
    return load_ranges("literature")


def hand_with(**bends: float) -> np.ndarray:
    """One hand whose index finger has some bends, in degrees; all other joints are bent by 30."""
    angles = np.zeros((1, 15, 3))
    angles[..., 0] = 30.0
    for name, bend in bends.items():
        angles[0, ARTICULATED.index(f"index {name}"), 0] = bend
    return angles


@pytest.mark.parametrize(
    ("bend", "closeness", "excess"),
    [
        (50.0, 0.0, 0.0),
        # The PIP's range is −10° to 100°, and closeness rises over 12°.
        (88.0, 0.0, 0.0),
        (94.0, 0.5, 0.0),
        (100.0, 1.0, 0.0),
        (107.0, 1.0, 7.0),
    ],
)
def test_a_joint_is_nearer_to_its_limit_the_farther_it_bends(
    ranges: RangeOfMotion, bend: float, closeness: float, excess: float
) -> None:
    state = limit_state(hand_with(PIP=bend), ranges)
    assert state.closeness[0, PIP] == pytest.approx(closeness, abs=1e-4)
    assert state.excess[0, PIP, 0] == pytest.approx(excess, abs=1e-4)


def test_a_straight_pip_is_at_its_limit_only_while_the_dip_is_bent(ranges: RangeOfMotion) -> None:
    """Eq. 3: the PIP does not overstretch while its DIP is flexed, so −4° are beyond by 4°."""
    bent, straight = (limit_state(hand_with(PIP=-4.0, DIP=dip), ranges) for dip in (20.0, 0.0))
    assert bent.excess[0, PIP, 0] == pytest.approx(-4.0, abs=1e-4)
    assert straight.excess[0, PIP, 0] == 0
    # 6° from the table's −10°.
    assert straight.closeness[0, PIP] == pytest.approx(0.5, abs=1e-4)


def test_twist_of_a_hinge_is_beyond_its_limit_but_never_merely_near(ranges: RangeOfMotion) -> None:
    angles = hand_with()
    assert limit_state(angles, ranges).closeness[0, PIP] == 0
    angles[0, PIP, 2] = 3.0
    state = limit_state(angles, ranges)
    assert state.excess[0, PIP, 2] == pytest.approx(3.0, abs=1e-4)
    assert state.closeness[0, PIP] == 0


def test_a_hand_without_angles_has_no_closeness_and_does_not_change_its_neighbour(
    ranges: RangeOfMotion,
) -> None:
    both = np.concatenate([np.full((1, 15, 3), np.nan), hand_with(PIP=94.0)])
    state = limit_state(both, ranges)
    assert np.isnan(state.closeness[0]).all()
    np.testing.assert_array_equal(
        state.closeness[1], limit_state(hand_with(PIP=94.0), ranges).closeness[0]
    )
