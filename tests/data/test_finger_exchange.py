"""Exchange of fingers between photographs: geometry by hand, pixels of made-up hands, donors that fit."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hand_recon.data.finger_exchange import (
    FINGERS,
    PALM,
    Donors,
    ExchangeRule,
    choose_donor,
    exchange_finger,
    palm_colour,
    similarity,
    straight_fingers,
)

SIZE = 120


def flat_hand(*, bent: tuple[int, ...] = ()) -> np.ndarray:
    """Landmarks of a flat right hand seen from its palm; bent fingers have half their length."""
    points = np.zeros((21, 2))
    points[0] = (60, 100)
    for finger, joints in enumerate(FINGERS):
        base = np.array([30, 82]) if finger == 0 else np.array([34 + 11 * finger, 62.0])
        direction = np.array([-0.6, -0.8]) if finger == 0 else np.array([0.0, -1.0])
        step = 5.0 if finger in bent else 12.0
        for joint, place in enumerate(joints):
            points[place] = base + joint * step * direction
    return points


def drawn(points: np.ndarray, skin: tuple[int, int, int], background: int = 10) -> np.ndarray:
    """A made-up image: background, palm and fingers in one colour each."""
    import cv2

    image = np.full((SIZE, SIZE, 3), background, np.uint8)
    hull = cv2.convexHull(np.round(points[list(PALM)]).astype(np.int32))
    cv2.fillConvexPoly(image, hull, skin)
    for joints in FINGERS:
        line = np.round(points[list(joints)]).astype(np.int32)
        cv2.polylines(image, [line], isClosed=False, color=skin, thickness=9)
    return image


def test_stretched_fingers_are_told_from_bent_ones_in_any_rotation() -> None:
    stretched = flat_hand()
    bent = flat_hand()
    for finger, joints in enumerate(FINGERS):
        base = bent[joints[0]]
        if finger == 0:
            # Across the palm.
            bent[list(joints)] = base + np.outer(range(4), (9.0, -6.0))
        else:
            # Up, over and down again: chord 2 of 12 + 5 + 9 pixels.
            bent[list(joints), 1] = base[1] - np.array([0.0, 12.0, 7.0, -2.0])
    # A finger without a bend of its own that lies back over the palm is bent at its base.
    back = flat_hand()
    back[list(FINGERS[2]), 1] = back[FINGERS[2][0], 1] + 9.0 * np.arange(4)
    angle = np.radians(130)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    for points in (np.stack([stretched, bent, back]), np.stack([stretched, bent, back]) @ turn.T):
        assert straight_fingers(points).tolist() == [
            [True] * 5, [False] * 5, [True, True, False, True, True]
        ]  # fmt: skip


@given(
    st.floats(-np.pi, np.pi), st.floats(0.3, 3.0), st.floats(-50, 50), st.floats(-50, 50),
)  # fmt: skip
def test_a_similarity_is_found_again(angle: float, scale: float, right: float, down: float) -> None:
    linear = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    points = flat_hand()[list(PALM)]
    target = points @ linear.T + (right, down)
    found = similarity(points[None], target)
    np.testing.assert_allclose(found.linear[0], linear, atol=1e-9)
    np.testing.assert_allclose(found(points[None])[0], target, atol=1e-9)
    assert float(found.error[0]) == pytest.approx(0.0, abs=1e-9)


def test_a_mirrored_palm_does_not_fit() -> None:
    points = flat_hand()[list(PALM)]
    mirrored = points * (-1, 1)
    assert float(similarity(mirrored[None], points).error[0]) > 0.2


def donors(*hands: np.ndarray, colour: float = 150.0) -> Donors:
    return Donors(np.stack(hands), np.full((len(hands), 3), colour))


def test_a_donor_must_fit_and_must_change_the_finger() -> None:
    own, bent = flat_hand(), flat_hand(bent=(4,))
    rule = ExchangeRule()
    every = np.arange(3)
    mirrored = bent * (-1, 1) + (120, 0)
    # A hand like our own changes nothing, a mirrored one does not fit.
    assert choose_donor(donors(own, own, mirrored), every, 0, own, finger=4, rule=rule) is None
    found = choose_donor(donors(own, mirrored, bent), every, 0, own, finger=4, rule=rule)
    assert found is not None
    assert found[0] == 2
    np.testing.assert_allclose(found[1], [[1, 0, 0], [0, 1, 0]], atol=1e-9)
    # Of those that fit, the one with the most similar skin.
    several = Donors(np.stack([own, bent, bent]), np.array([[150.0] * 3, [120.0] * 3, [140.0] * 3]))
    found = choose_donor(several, every, 0, own, finger=4, rule=rule)
    assert found is not None
    assert found[0] == 2
    other = Donors(np.stack([own, bent]), np.array([[150.0] * 3, [60.0] * 3]))
    assert choose_donor(other, np.arange(2), 0, own, finger=4, rule=rule) is None


def test_a_straight_finger_replaces_a_bent_one() -> None:
    own, donor = flat_hand(bent=(4,)), flat_hand()
    image, donor_image = drawn(own, (200, 150, 120)), drawn(donor, (100, 75, 60))
    identity = np.array([[1.0, 0, 0], [0, 1, 0]])
    pixels, points = exchange_finger(image, own, donor_image, donor, finger=4, matrix=identity)
    little = list(FINGERS[4])
    np.testing.assert_allclose(points[little], donor[little])
    others = [place for place in range(21) if place not in little]
    np.testing.assert_array_equal(points[others], own[others])
    # The new tip has the colour of our palm, where there was background before.
    column, row = np.round(donor[little[3]]).astype(int)
    assert image[row, column, 0] == 10
    np.testing.assert_allclose(pixels[row, column], (200, 150, 120), atol=12)
    # Nothing changes at the other fingers' tips.
    for finger in range(4):
        column, row = np.round(own[FINGERS[finger][3]]).astype(int)
        np.testing.assert_array_equal(pixels[row, column], image[row, column])


def test_a_bent_finger_replaces_a_straight_one_which_is_painted_over() -> None:
    own, donor = flat_hand(), flat_hand(bent=(4,))
    image, donor_image = drawn(own, (200, 150, 120)), drawn(donor, (200, 150, 120))
    identity = np.array([[1.0, 0, 0], [0, 1, 0]])
    pixels, _ = exchange_finger(image, own, donor_image, donor, finger=4, matrix=identity)
    column, row = np.round(own[FINGERS[4][3]]).astype(int)
    assert image[row, column, 0] == 200
    assert pixels[row, column, 0] < 60


def test_the_colour_of_a_palm() -> None:
    hand = flat_hand()
    np.testing.assert_allclose(palm_colour(drawn(hand, (90, 60, 30)), hand), (90, 60, 30), atol=8)
