"""Poses with independent fingers: inside their ranges, independent of each other, and rendered as such."""

import numpy as np
import pytest

from hand_recon.data.synthetic.gestures import BEND, SPLAY, TWIST
from hand_recon.data.synthetic.independent import THUMB, independent_pose
from hand_recon.data.synthetic.levels import DIFFICULTIES
from hand_recon.data.synthetic.recipe import Recipe
from hand_recon.data.synthetic.scene import synthetic_view
from hand_recon.hand.skeleton import ARTICULATED, FINGERS


@pytest.fixture(scope="module")
def degrees() -> np.ndarray:
    random = np.random.default_rng(0)
    return np.degrees(np.stack([independent_pose(random) for _ in range(4000)]))


def column(degrees: np.ndarray, joint: str, axis: int) -> np.ndarray:
    found: np.ndarray = degrees[:, ARTICULATED.index(joint), axis]
    return found


def test_every_combination_of_straight_and_curled_fingers_occurs(degrees: np.ndarray) -> None:
    curled = np.stack(
        [column(degrees, f"{finger} PIP", BEND) > 50 for finger in FINGERS[1:]], axis=1
    )
    codes, counts = np.unique(curled @ np.array([1, 2, 4, 8]), return_counts=True)
    assert list(codes) == list(range(16))
    # Equal shares would be 250 of each.
    assert counts.min() > 120


def test_fingers_do_not_follow_each_other(degrees: np.ndarray) -> None:
    bends = np.stack([column(degrees, f"{finger} MCP", BEND) for finger in FINGERS[1:]])
    between = np.corrcoef(bends)[np.triu_indices(4, 1)]
    # Three standard errors of 4,000 draws.
    assert np.abs(between).max() < 3 / np.sqrt(4000) + 0.01
    own = np.corrcoef(column(degrees, "ring PIP", BEND), column(degrees, "ring DIP", BEND))[0, 1]
    assert own > 0.9


def test_bends_span_the_range_and_stay_inside(degrees: np.ndarray) -> None:
    pip = column(degrees, "index PIP", BEND)
    assert pip.min() > -6
    assert pip.min() < 5
    assert 100 < pip.max() <= 105
    for (joint, axis), (low, high) in THUMB.items():
        values = column(degrees, joint, axis)
        assert low <= values.min() < low + 0.05 * (high - low)
        assert high >= values.max() > high - 0.05 * (high - low)


def test_hinges_only_bend_and_bent_fingers_splay_less(degrees: np.ndarray) -> None:
    hinges = [i for i, joint in enumerate(ARTICULATED) if joint.endswith(("PIP", "DIP", "IP"))]
    assert np.abs(degrees[:, hinges][..., [SPLAY, TWIST]]).max() == 0
    bend, splay = column(degrees, "middle MCP", BEND), np.abs(column(degrees, "middle MCP", SPLAY))
    assert splay[bend > 80].max() < 6 < 12 < splay[bend < 10].max()


def test_the_level_renders_them() -> None:
    recipe = Recipe("train", DIFFICULTIES["any_pose"], 64, seed=0)
    angles = np.degrees(
        np.stack([synthetic_view(recipe, index).joint_angles for index in range(60)])
    )
    index, ring = column(angles, "index PIP", BEND), column(angles, "ring PIP", BEND)
    # Straight beside curled in both orders, which gestures seldom have.
    assert ((index < 20) & (ring > 70)).any()
    assert ((index > 70) & (ring < 20)).any()
