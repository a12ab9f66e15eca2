"""Names of landmarks in the vocabularies of tools."""

from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hand_recon.data.landmarks.formats.names import landmarks_of_names, side_in
from hand_recon.hand.skeleton import FINGERS, LANDMARKS

MMPOSE: Final = (
    "wrist",
    *(
        f"{finger}{number}"
        for finger in ("thumb", "forefinger", "middle_finger", "ring_finger", "pinky_finger")
        for number in (1, 2, 3, 4)
    ),
)

MEDIAPIPE: Final = (
    "WRIST", "THUMB_CMC", "THUMB_MCP", "THUMB_IP", "THUMB_TIP",
    *(
        f"{finger}_{part}"
        for finger in ("INDEX_FINGER", "MIDDLE_FINGER", "RING_FINGER", "PINKY")
        for part in ("MCP", "PIP", "DIP", "TIP")
    ),
)  # fmt: skip

WEBXR: Final = (
    "wrist", "thumb-metacarpal", "thumb-phalanx-proximal", "thumb-phalanx-distal", "thumb-tip",
    *(
        f"{finger}-finger-{part}"
        for finger in ("index", "middle", "ring", "pinky")
        for part in ("phalanx-proximal", "phalanx-intermediate", "phalanx-distal", "tip")
    ),
)  # fmt: skip

OPENXR: Final = tuple(
    f"XR_HAND_JOINT_{name.upper().replace('-FINGER', '').replace('-PHALANX', '').replace('PINKY', 'LITTLE').replace('-', '_')}_EXT"  # noqa: E501
    for name in WEBXR
)

UNITY: Final = (
    "Wrist",
    *(f"{finger.capitalize()}{number}" for finger in FINGERS for number in range(4)),
)


@pytest.mark.parametrize(
    "names",
    [
        LANDMARKS, MMPOSE, MEDIAPIPE, WEBXR, OPENXR, UNITY,
        [str(number) for number in range(21)], [str(number) for number in range(1, 22)],
        [f"hand_{number}" for number in range(21)], ["hand_root", *MMPOSE[1:]],
        [name.title().replace(" ", "") for name in LANDMARKS],
        [name.lower() for name in MEDIAPIPE],
    ],
)  # fmt: skip
def test_names_in_freihands_order_are_the_landmarks_0_to_20(names: list[str]) -> None:
    found = landmarks_of_names(names)
    assert [found[name].landmark for name in names] == list(range(21))
    assert {named.side for named in found.values()} == {None}


@pytest.mark.parametrize(
    "spelling",
    ["left_{}", "Left {}", "l_{}", "{}_L", "{} (left)", "left_hand_{}", "LeftHand_{}", "lh-{}"],
)
def test_a_side_may_stand_before_or_after_a_name(spelling: str) -> None:
    found = landmarks_of_names([spelling.format(name) for name in LANDMARKS])
    assert [(named.side, named.landmark) for named in found.values()] == [
        ("left", n) for n in range(21)
    ]


@given(st.permutations(MMPOSE))
def test_the_order_of_names_does_not_matter(names: list[str]) -> None:
    assert landmarks_of_names(names) == landmarks_of_names(MMPOSE)


@pytest.mark.parametrize(
    "name",
    [
        "nose", "left_index", "left_thumb", "palm", "XR_HAND_JOINT_PALM_EXT", "index-finger-metacarpal",
        "left_elbow", "thumb CMC joint angle", "", "hand", "index5", "finger 3 tip", "index MCP PIP", "٣",
        "XR_HAND_JOINT_LITTLE_METACARPAL_EXT", "1" * 5000, "thumb_intermediate",
    ],
)  # fmt: skip
def test_names_of_other_things_are_no_landmarks(name: str) -> None:
    assert landmarks_of_names([name]) == {}


def test_a_bodys_wrist_is_a_wrist_but_its_fingers_are_none() -> None:
    """COCO-WholeBody has the wrist of the body beside the root of the hand."""
    found = landmarks_of_names(["left_wrist", "left_hand_root", "right_eye", "left_big_toe"])
    assert {name: named.landmark for name, named in found.items()} == {
        "left_wrist": 0,
        "left_hand_root": 0,
    }


def test_a_thumb_named_like_a_finger_has_no_cmc_of_that_name() -> None:
    names = ["thumb_mcp", "thumb_pip", "thumb_dip", "thumb_tip"]
    assert [named.landmark for named in landmarks_of_names(names).values()] == [1, 2, 3, 4]
    with_cmc = ["thumb_cmc", "thumb_mcp", "thumb_dip", "thumb_tip"]
    assert [named.landmark for named in landmarks_of_names(with_cmc).values()] == [1, 2, 3, 4]


def test_numbers_that_may_count_from_zero_or_one_name_nothing() -> None:
    assert landmarks_of_names(str(number) for number in range(1, 21)) == {}


@given(st.lists(st.text(max_size=30), max_size=8))
def test_any_text_is_a_landmark_or_none(names: list[str]) -> None:
    for named in landmarks_of_names(names).values():
        assert 0 <= named.landmark < 21
        assert named.side in {None, "left", "right"}


@pytest.mark.parametrize(
    ("text", "side"),
    [
        ("left_hand", "left"), ("RightHand", "right"), ("LEFT_HAND_LANDMARKS", "left"), ("hand", None),
        ("left or right", None), ("l", None), ("hand_right_keypoints_2d", "right"), ("bright", None),
        ("LEFT_HAND_136", "left"),
    ],
)  # fmt: skip
def test_a_side_is_read_out_of_a_text(text: str, side: str | None) -> None:
    assert side_in(text) == side
