"""Orders and permutations of landmarks."""

import itertools

import pytest

from hand_recon.hand.skeleton import (
    JOINT_LEVELS,
    JOINTS,
    LANDMARK_ORDERS,
    LANDMARK_PARENTS,
    LANDMARKS,
    PARENTS,
    landmark_permutation,
)

PUBLISHED = {
    ("ho3d", "freihand"): (0, 13, 14, 15, 16, 1, 2, 3, 17, 4, 5, 6, 18, 10, 11, 12, 19, 7, 8, 9, 20),
    ("freihand", "ho3d"): (0, 5, 6, 7, 9, 10, 11, 17, 18, 19, 13, 14, 15, 1, 2, 3, 4, 8, 12, 16, 20),
    ("rhd", "freihand"): (0, 4, 3, 2, 1, 8, 7, 6, 5, 12, 11, 10, 9, 16, 15, 14, 13, 20, 19, 18, 17),
    ("interhand", "freihand"): (
        20, 3, 2, 1, 0, 7, 6, 5, 4, 11, 10, 9, 8, 15, 14, 13, 12, 19, 18, 17, 16,
    ),
    ("freihand", "interhand"): (
        4, 3, 2, 1, 8, 7, 6, 5, 12, 11, 10, 9, 16, 15, 14, 13, 20, 19, 18, 17, 0,
    ),
    ("dart", "freihand"): (0, 13, 14, 15, 20, 1, 2, 3, 16, 4, 5, 6, 17, 10, 11, 12, 19, 7, 8, 9, 18),
    ("known_hand", "freihand"): (
        0, 13, 14, 15, 16, 1, 2, 3, 17, 4, 5, 6, 18, 10, 11, 12, 20, 7, 8, 9, 19,
    ),
}  # fmt: skip
"""Index lists printed in the public code of HaMeR, manopth, HO-3D, MobRecon and DIP-Hand."""


@pytest.mark.parametrize(("conventions", "expected"), list(PUBLISHED.items()))
def test_permutations_are_those_that_others_publish(
    conventions: tuple[str, str], expected: tuple[int, ...]
) -> None:
    assert landmark_permutation(*conventions) == expected


@pytest.mark.parametrize("pair", list(itertools.permutations(LANDMARK_ORDERS, 2)))
def test_there_and_back_is_the_identity(pair: tuple[str, str]) -> None:
    there, back = landmark_permutation(*pair), landmark_permutation(*reversed(pair))
    assert tuple(there[index] for index in back) == tuple(range(21))


def test_every_order_names_the_same_landmarks() -> None:
    assert all(set(order) == set(LANDMARKS) for order in LANDMARK_ORDERS.values())


def test_levels_pose_parents_first() -> None:
    done = {0}
    for level in JOINT_LEVELS:
        assert {PARENTS[joint] for joint in level} <= done
        done |= set(level)
    assert done == set(range(len(JOINTS)))


def test_landmark_bones_stay_in_a_finger() -> None:
    for child, parent in enumerate(LANDMARK_PARENTS[1:], start=1):
        same_finger = LANDMARKS[child].split()[0] == LANDMARKS[parent].split()[0]
        assert parent == 0 or same_finger


def test_an_unknown_order_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ValueError, match=r"'coco'.*freihand.*rhd"):
        landmark_permutation("coco", "freihand")
