"""Lists of points in other forms than one list of 21 points per hand, and files in other encodings."""

import logging
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest

from hand_recon.data.landmarks.files import read_landmarks
from hand_recon.data.landmarks.formats.whole_body import OPENXR, WEBXR
from hand_recon.hand.skeleton import LANDMARKS
from tests.support.annotation_files import MEDIAPIPE_NAMES
from tests.support.landmark_writing import (
    POINTS,
    SCORES,
    assert_same_hands,
    table,
    with_scores,
    written,
)
from tests.support.tool_files import bodies

ANGLES: Final = np.linspace(-0.9, 0.9, 5)
"""Directions of the fingers of a flat hand, radians from upwards."""

FLAT_HAND: Final = np.array(
    [[500.0, 800.0]]
    + [
        [500 + length * np.sin(angle), 800 - length * np.cos(angle)]
        for angle in ANGLES
        for length in (180.0, 260.0, 320.0, 370.0)
    ]
)
"""Landmarks of a flat hand, pixels."""


def xr_joints(hand: np.ndarray, joints: int) -> np.ndarray:
    """A hand as a headset has it, with a palm (of 26) and the bases of four metacarpals."""
    made = np.empty((joints, 2))
    metacarpals = np.array([6, 11, 16, 21]) - (26 - joints)
    made[metacarpals] = 0.8 * hand[0] + 0.2 * hand[[5, 9, 13, 17]]
    if joints == 26:
        made[0] = 0.5 * (hand[0] + hand[9])
    made[list(OPENXR if joints == 26 else WEBXR)] = hand
    return made


def test_a_headsets_joints_are_palm_wrist_and_five_per_finger_but_four_for_the_thumb() -> None:
    """XR_EXT_hand_tracking: metacarpal, proximal, intermediate, distal, tip; a thumb has no intermediate."""
    fingers = [("index", 6), ("middle", 11), ("ring", 16), ("little", 21)]
    joints = {1: "wrist", 2: "thumb CMC", 3: "thumb MCP", 4: "thumb IP", 5: "thumb tip"}
    for finger, metacarpal in fingers:
        for place, part in enumerate(("MCP", "PIP", "DIP", "tip"), start=1):
            joints[metacarpal + place] = f"{finger} {part}"
    assert [joints[joint] for joint in OPENXR] == list(LANDMARKS)
    assert [joints[joint + 1] for joint in WEBXR] == list(LANDMARKS)


@pytest.mark.parametrize(
    ("joints", "words"), [(26, "OpenXR's 26 joints"), (25, "WebXR's 25 joints")]
)
def test_joints_of_a_headset_in_the_image_are_reduced_to_the_landmarks(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, joints: int, words: str
) -> None:
    hands = [xr_joints(FLAT_HAND, joints).tolist(), xr_joints(FLAT_HAND * 0.5, joints).tolist()]
    with caplog.at_level(logging.INFO):
        landmarks = read_landmarks(written(tmp_path, hands))
    assert_same_hands(landmarks, np.stack([FLAT_HAND, FLAT_HAND * 0.5]))
    assert f"hands of {words} (2); 2 right hands are read" in caplog.text


@pytest.mark.parametrize("joints", [26, 25])
def test_joints_of_a_headset_in_metres_are_refused_as_3d(tmp_path: Path, joints: int) -> None:
    space = np.pad(xr_joints(FLAT_HAND / 4000, joints), ((0, 0), (0, 1)), constant_values=-0.4)
    with pytest.raises(
        ValueError, match=rf"{joints} joints in metres, which are 3D points.*Project"
    ):
        read_landmarks(written(tmp_path, [space.tolist()]))


def test_26_points_that_are_21_and_5_others_are_refused(tmp_path: Path) -> None:
    points = np.concatenate([FLAT_HAND, FLAT_HAND[:5]])
    with pytest.raises(
        ValueError, match=r"has 26 points, expected 21.*\[1, 2, 3, 4, 5, 7.*Keep 21"
    ):
        read_landmarks(written(tmp_path, [points.tolist()]))


@pytest.mark.parametrize(
    ("count", "cure"),
    [
        (17, "17 keypoints of a body have no hands"),
        (20, "write null for it in front"),
        (42, "two lists of 21"),
        (24, "Oculus's 24 bones"),
    ],
)
def test_known_numbers_of_points_have_a_cure_of_their_own(
    tmp_path: Path, count: int, cure: str
) -> None:
    hand = np.random.default_rng(3).uniform(5, 900, (count, 2)).tolist()
    with pytest.raises(ValueError, match=rf"has {count} points, expected 21 in FreiHAND's.*{cure}"):
        read_landmarks(written(tmp_path, [hand]))


def test_frames_may_have_any_number_of_hands(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    hands = with_scores()
    with caplog.at_level(logging.INFO):
        landmarks = read_landmarks(written(tmp_path, [[], hands[:2], [None, hands[2]], []]))
    found = landmarks.usable.tolist()
    assert found == [True, True, False, True]
    assert landmarks.names == (
        "frame 1, hand 0",
        "frame 1, hand 1",
        "frame 2, hand 0",
        "frame 2, hand 1",
    )
    assert_same_hands(landmarks.select(landmarks.usable))
    assert "lists of hands for each frame; 4 right hands are read" in caplog.text


def test_a_body_without_a_left_hand_has_a_right_one(tmp_path: Path) -> None:
    landmarks = read_landmarks(written(tmp_path, bodies(136, 94)[1:].tolist()))
    assert_same_hands(landmarks, POINTS[2:])
    assert landmarks.names == ("0 right",)
    assert landmarks.left.tolist() == [False]


def test_points_may_be_objects_with_x_and_y(tmp_path: Path) -> None:
    hands = [
        [{"x": u, "y": v, "z": 0.5, "score": score} for u, v, score in hand]
        for hand in with_scores()
    ]
    hands[0][4] = None  # type: ignore[call-overload]
    landmarks = read_landmarks(written(tmp_path, hands))
    expected = POINTS.copy()
    expected[0, 4] = np.nan
    assert_same_hands(landmarks, expected)
    assert landmarks.confidence is not None
    np.testing.assert_array_equal(landmarks.confidence[1:].numpy(), SCORES[1:])


@pytest.mark.parametrize("names", [LANDMARKS, MEDIAPIPE_NAMES])
def test_points_may_be_named(tmp_path: Path, names: tuple[str, ...]) -> None:
    shuffled = [7, *range(7), *range(8, 21)]
    hands = [
        {names[landmark]: hand[landmark].tolist() for landmark in shuffled} | {"side": side}
        for hand, side in zip(POINTS, ("left", "right", "right"), strict=True)
    ]
    landmarks = read_landmarks(written(tmp_path, hands))
    assert_same_hands(landmarks)
    assert landmarks.left.tolist() == [True, False, False]
    inside = [{"landmarks": {name: hand[name] for name in names}} for hand in hands]
    assert_same_hands(read_landmarks(written(tmp_path, inside)))


def test_named_points_of_two_sides_are_two_hands(tmp_path: Path) -> None:
    both = {
        f"{side}_{name}": hand[landmark].tolist()
        for side, hand in (("left", POINTS[0]), ("right", POINTS[1]))
        for landmark, name in enumerate(LANDMARKS)
    }
    for content in (both, [both], {"landmarks": both}, [[{"landmarks_2d": both}]]):
        landmarks = read_landmarks(written(tmp_path, content))
        assert_same_hands(landmarks, POINTS[:2])
        assert landmarks.left.tolist() == [True, False]


def test_hands_may_be_listed_by_image_or_by_side(tmp_path: Path) -> None:
    hands = POINTS.tolist()
    landmarks = read_landmarks(written(tmp_path, {"a.jpg": hands[0], "b.jpg": hands[1:]}))
    assert_same_hands(landmarks)
    assert landmarks.images == (tmp_path / "a.jpg", *(tmp_path / "b.jpg",) * 2)
    landmarks = read_landmarks(written(tmp_path, {"Left": hands[0], "Right": [hands[1], hands[2]]}))
    assert_same_hands(landmarks)
    assert landmarks.left.tolist() == [True, False, False]


def test_the_size_of_the_image_may_stand_in_an_object_or_a_table(tmp_path: Path) -> None:
    """(0.5, 0.25) of 640 × 480 is the pixel (320, 120)."""
    shares = [[0.5, 0.25], *([[0.1, 0.2]] * 20)]
    sized = {"landmarks": shares, "width": 640, "height": 480}
    pair = {"landmarks": shares, "image_size": [640, 480]}
    for content in ([sized], [pair], sized):
        landmarks = read_landmarks(written(tmp_path, content))
        assert landmarks.landmarks_2d[0, 0].tolist() == [320, 120]
    rows: list[list[Any]] = [["hand", "landmark", "u", "v", "width", "height"]]
    rows += [[0, landmark, *point, 640, 480] for landmark, point in enumerate(shares)]
    assert read_landmarks(table(tmp_path, rows)).landmarks_2d[0, 0].tolist() == [320, 120]
    titles = [f"{axis}{landmark}" for landmark in range(21) for axis in "xy"]
    rows = [[*titles, "width", "height"], [*np.ravel(shares), 640, 480]]
    assert read_landmarks(table(tmp_path, rows)).landmarks_2d[0, 0].tolist() == [320, 120]


def test_objects_may_be_listed_for_each_frame(tmp_path: Path) -> None:
    objects = [{"landmarks": hand.tolist(), "side": "left"} for hand in POINTS]
    landmarks = read_landmarks(written(tmp_path, [objects[:2], [], objects[2:]]))
    assert_same_hands(landmarks)
    assert landmarks.left.all()


def test_keypoints_may_be_objects_with_x_and_y(tmp_path: Path) -> None:
    content = [
        {"keypoints": [{"x": u, "y": v, "score": score} for u, v, score in hand]}
        for hand in with_scores()
    ]
    landmarks = read_landmarks(written(tmp_path, content))
    assert_same_hands(landmarks)
    assert landmarks.confidence is not None
    np.testing.assert_array_equal(landmarks.confidence.numpy(), SCORES)
