"""Landmark files: every format gives the same hands, and what is wrong with a file is said."""

import csv
import json
import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from hand_recon.data.landmarks.files import read_landmarks
from hand_recon.data.landmarks.landmark_set import LandmarkSet
from hand_recon.data.landmarks.parsed import Assumptions
from hand_recon.hand.skeleton import LANDMARK_ORDERS, LANDMARKS

POINTS = np.random.default_rng(0).uniform(5, 1900, (3, 21, 2)).round(2)
SCORES = np.random.default_rng(1).uniform(0.1, 1, (3, 21)).round(3)
CAMERA = [[900.0, 0.0, 640.0], [0.0, 905.0, 480.0], [0.0, 0.0, 1.0]]

# Outside the image too, but not all of them within ±2, which are no pixels.
numbers = st.floats(-500, -3) | st.floats(3, 8000)
points = st.none() | st.tuples(numbers, numbers).map(list)
files_of_hands = st.lists(st.lists(points, min_size=21, max_size=21), min_size=1, max_size=4)


def written(folder: Path, content: Any, name: str = "landmarks.json") -> Path:  # noqa: ANN401
    path = folder / name
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def with_scores(points: np.ndarray = POINTS, third: np.ndarray = SCORES) -> list[Any]:
    hands: list[Any] = np.concatenate([points, third[..., None]], axis=-1).tolist()
    return hands


def table(folder: Path, rows: list[list[Any]], delimiter: str = ",") -> Path:
    with (folder / "landmarks.csv").open("w", newline="") as stream:
        csv.writer(stream, delimiter=delimiter).writerows(rows)
    return folder / "landmarks.csv"


def assert_same_hands(landmarks: LandmarkSet, points: np.ndarray = POINTS) -> None:
    np.testing.assert_array_equal(landmarks.landmarks_2d.numpy(), points)
    assert (landmarks.labelled.numpy() == np.isfinite(points).all(axis=-1)).all()


# --- JSON lists ---------------------------------------------------------------------------------


@given(files_of_hands)
def test_every_list_of_hands_comes_back_number_for_number(
    tmp_path_factory: pytest.TempPathFactory, hands: list[list[list[float] | None]]
) -> None:
    path = written(tmp_path_factory.mktemp("json"), hands)
    landmarks = read_landmarks(path)
    for hand, (points, labelled) in enumerate(
        zip(landmarks.landmarks_2d.tolist(), landmarks.labelled.tolist(), strict=True)
    ):
        back = [point if there else None for point, there in zip(points, labelled, strict=True)]
        assert back == hands[hand]


def test_a_single_hand_need_not_be_nested(tmp_path: Path) -> None:
    one: list[Any] = POINTS[0].tolist()
    one[4] = None
    landmarks = read_landmarks(written(tmp_path, one))
    assert len(landmarks) == 1
    assert landmarks.labelled[0].tolist() == [number != 4 for number in range(21)]


@pytest.mark.parametrize("missing", [None, [None, None], [None, None, None], [float("nan")] * 2])
def test_a_missing_landmark_can_be_written_in_any_of_these_ways(
    tmp_path: Path, missing: list[None] | None
) -> None:
    hands = with_scores()
    hands[1][20] = missing
    landmarks = read_landmarks(written(tmp_path, hands))
    expected = POINTS.copy()
    expected[1, 20] = np.nan
    assert_same_hands(landmarks, expected)
    assert landmarks.confidence is not None
    assert landmarks.confidence.isnan().nonzero().tolist() == [[1, 20]]


def test_a_hand_that_was_not_found_keeps_its_place(tmp_path: Path) -> None:
    landmarks = read_landmarks(written(tmp_path, [POINTS[0].tolist(), None, POINTS[2].tolist()]))
    assert landmarks.labelled.sum(dim=1).tolist() == [21, 0, 21]
    assert landmarks.usable.tolist() == [True, False, True]


def test_third_numbers_up_to_one_are_confidences_and_the_log_says_so(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.INFO):
        landmarks = read_landmarks(written(tmp_path, with_scores()))
    assert "all lie in [0, 1] and are read as confidences" in caplog.text
    assert landmarks.sigma is None
    assert landmarks.confidence is not None
    np.testing.assert_array_equal(landmarks.confidence.numpy(), SCORES)


def test_third_numbers_above_one_are_sigmas_and_the_log_says_so(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.INFO):
        landmarks = read_landmarks(written(tmp_path, with_scores(third=SCORES * 9)))
    assert "read as standard deviations in pixels" in caplog.text
    assert landmarks.confidence is None
    assert landmarks.sigma is not None
    np.testing.assert_array_equal(landmarks.sigma.numpy(), SCORES * 9)


def test_the_caller_can_say_that_small_numbers_are_sigmas(tmp_path: Path) -> None:
    landmarks = read_landmarks(written(tmp_path, with_scores()), assumed=Assumptions(third="sigma"))
    assert landmarks.confidence is None
    assert landmarks.sigma is not None


def test_a_landmark_of_no_confidence_is_missing(tmp_path: Path) -> None:
    hands = with_scores()
    hands[2][7] = [0, 0, 0]
    landmarks = read_landmarks(written(tmp_path, hands))
    assert (~landmarks.labelled).nonzero().tolist() == [[2, 7]]
    assert landmarks.landmarks_2d[2, 7].isnan().all()


def test_another_order_of_landmarks_is_put_right(tmp_path: Path) -> None:
    order = [LANDMARKS.index(name) for name in LANDMARK_ORDERS["interhand"]]
    shuffled = with_scores(POINTS[:, order], SCORES[:, order])
    for third in ("confidence", "sigma"):
        assumed = Assumptions(third=third, order="interhand")
        landmarks = read_landmarks(written(tmp_path, shuffled), assumed=assumed)
        assert_same_hands(landmarks)
        told = landmarks.sigma if third == "sigma" else landmarks.confidence
        assert told is not None
        np.testing.assert_array_equal(told.numpy(), SCORES)


def test_what_is_not_told_is_assumed_by_name(tmp_path: Path) -> None:
    path = written(tmp_path, POINTS.tolist())
    assert not read_landmarks(path).left.any()
    assert read_landmarks(path, assumed=Assumptions(side="left")).left.all()
    assert read_landmarks(path).names == ("0", "1", "2")
    with pytest.raises(ValueError, match="Unknown third number 'variance'; choose one of"):
        Assumptions(third="variance")
    with pytest.raises(ValueError, match="Unknown side 'both'; choose one of"):
        Assumptions(side="both")
    with pytest.raises(ValueError, match="Unknown landmark order 'mine'"):
        Assumptions(order="mine")


# --- JSON objects -------------------------------------------------------------------------------


def test_objects_tell_side_picture_and_camera(tmp_path: Path) -> None:
    hands = [
        {"landmarks": POINTS[0].tolist(), "side": "Left", "image": "a.jpg", "K": CAMERA},
        {"landmarks_2d": POINTS[1].tolist(), "handedness": "right", "intrinsics": CAMERA},
        {"landmarks": POINTS[2].tolist(), "name": "third", "K": CAMERA, "sigma": [2.5] * 21},
    ]
    landmarks = read_landmarks(written(tmp_path, hands))
    assert_same_hands(landmarks)
    assert landmarks.left.tolist() == [True, False, False]
    assert landmarks.names == ("a.jpg", "1", "third")
    assert landmarks.images == (tmp_path / "a.jpg", None, None)
    assert landmarks.intrinsics is not None
    assert landmarks.intrinsics.tolist() == [CAMERA] * 3
    assert landmarks.sigma is not None
    assert landmarks.sigma[:2].isnan().all()
    assert (landmarks.sigma[2] == 2.5).all()


def test_one_object_is_one_hand_and_pictures_may_lie_elsewhere(tmp_path: Path) -> None:
    path = written(tmp_path, {"landmarks": POINTS[0].tolist(), "image": "a.jpg"})
    landmarks = read_landmarks(path, assumed=Assumptions(images=Path("/pictures")))
    assert landmarks.images == (Path("/pictures/a.jpg"),)


def test_keys_that_are_not_read_are_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    read_landmarks(written(tmp_path, [{"landmarks": POINTS[0].tolist(), "colour": "blue"}]))
    assert "['colour'] are not read; known are" in caplog.text


# --- COCO ---------------------------------------------------------------------------------------


def coco_hand(points: np.ndarray, visibility: np.ndarray) -> list[float]:
    numbers: list[float] = np.concatenate([points, visibility[:, None]], axis=1).ravel().tolist()
    return numbers


def test_coco_keypoints_come_with_their_pictures_and_sides(tmp_path: Path) -> None:
    visibility = np.tile([2, 1, 0], 7)
    content = {
        "images": [{"id": 7, "file_name": "x/a.jpg", "width": 640, "height": 480}],
        "categories": [{"id": 1, "name": "left_hand"}, {"id": 2, "name": "hand"}],
        "annotations": [
            {"id": 1, "image_id": 7, "category_id": 1, "keypoints": coco_hand(POINTS[0], visibility)},
            {"id": 2, "image_id": 8, "category_id": 2, "keypoints": coco_hand(POINTS[1], visibility)},
        ],
    }  # fmt: skip
    landmarks = read_landmarks(written(tmp_path, content))
    expected = POINTS[:2].copy()
    expected[:, 2::3] = np.nan
    assert_same_hands(landmarks, expected)
    assert landmarks.left.tolist() == [True, False]
    assert landmarks.names == ("x/a.jpg", "annotation 2")
    assert landmarks.images == (tmp_path / "x/a.jpg", None)
    # Whether a joint can be seen is no measure of how precise its label is.
    assert landmarks.confidence is None


def test_coco_wholebody_has_two_hands_and_those_that_are_not_valid_are_left_out(
    tmp_path: Path,
) -> None:
    seen, nothing = np.full(21, 2), np.zeros(21)
    people = [
        {
            "id": 1, "image_id": 3, "keypoints": [0] * 51,
            "lefthand_kpts": coco_hand(POINTS[0], seen), "lefthand_valid": True,
            "righthand_kpts": coco_hand(POINTS[1], seen), "righthand_valid": True,
        },
        {
            "id": 2, "image_id": 3, "keypoints": [0] * 51,
            "lefthand_kpts": coco_hand(POINTS[2], nothing), "lefthand_valid": False,
            "righthand_kpts": coco_hand(POINTS[2], seen), "righthand_valid": True,
        },
    ]  # fmt: skip
    content = {"images": [{"id": 3, "file_name": "b.jpg"}], "annotations": people}
    landmarks = read_landmarks(written(tmp_path, content))
    assert_same_hands(landmarks)
    assert landmarks.left.tolist() == [True, False, False]
    assert landmarks.names == ("b.jpg left", "b.jpg right", "b.jpg right")


def test_a_list_of_coco_results_has_scores(tmp_path: Path) -> None:
    scores = SCORES[0].copy()
    scores[0], scores[1] = 1.07, 0.0
    content = [
        {"image_id": 3, "category_id": 1, "score": 0.9, "keypoints": coco_hand(POINTS[0], scores)}
    ]
    landmarks = read_landmarks(written(tmp_path, content))
    assert landmarks.confidence is not None
    assert landmarks.confidence[0, 0] == 1.0
    assert landmarks.labelled[0].tolist() == [number != 1 for number in range(21)]


# --- CSV ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
@pytest.mark.parametrize("third", ["c", "confidence", "sigma"])
def test_a_table_with_one_row_per_hand(tmp_path: Path, delimiter: str, third: str) -> None:
    header = [f"{letter}{number}" for number in range(21) for letter in ("u", "v", third)]
    rows: list[list[Any]] = [["name", *header, "Side"]]
    for hand, values in enumerate(with_scores()):
        rows.append([f"hand {hand}", *np.array(values).ravel(), ("left", "", "right")[hand]])
    rows[1][1:3] = "", ""
    landmarks = read_landmarks(table(tmp_path, rows, delimiter))
    expected = POINTS.copy()
    expected[0, 0] = np.nan
    assert_same_hands(landmarks, expected)
    assert landmarks.names == ("hand 0", "hand 1", "hand 2")
    assert landmarks.left.tolist() == [True, False, False]
    told = landmarks.sigma if third == "sigma" else landmarks.confidence
    assert told is not None
    np.testing.assert_array_equal(told[1:].numpy(), SCORES[1:])
    assert told[0, 0].isnan()


@pytest.mark.parametrize("by_name", [True, False])
def test_a_table_with_one_row_per_landmark(tmp_path: Path, by_name: bool) -> None:
    rows: list[list[Any]] = [["hand", "landmark", "u", "v", "sigma", "side", "image"]]
    for hand in (1, 0):
        # Backwards, and the wrist left out: neither order nor completeness is asked for.
        for landmark in range(20, 0, -1):
            called = LANDMARKS[landmark].upper() if by_name else landmark
            rows.append([f"no {hand}", called, *POINTS[hand, landmark], 3.5, "left", f"{hand}.png"])
    landmarks = read_landmarks(table(tmp_path, rows))
    expected = POINTS[[1, 0]].copy()
    expected[:, 0] = np.nan
    assert_same_hands(landmarks, expected)
    assert landmarks.names == ("no 1", "no 0")
    assert landmarks.images == (tmp_path / "1.png", tmp_path / "0.png")
    assert landmarks.left.all()
    assert landmarks.sigma is not None
    assert (landmarks.sigma[:, 1:] == 3.5).all()


# --- cameras ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "form", ["one.json", "each.json", "object.json", "text", "each.csv", "npy"]
)
def test_a_camera_can_be_given_in_any_of_these_forms(tmp_path: Path, form: str) -> None:
    flat = " ".join(str(number) for row in CAMERA for number in row)
    path = tmp_path / f"K.{form}"
    if form == "npy":
        np.save(path, np.array(CAMERA))
        path = path if path.is_file() else path.with_name(f"{path.name}.npy")
    else:
        content = {
            "one.json": json.dumps(CAMERA), "each.json": json.dumps([CAMERA] * 3),
            "object.json": json.dumps({"K": CAMERA}), "text": flat,
            "each.csv": "\n".join([flat.replace(" ", ",")] * 3),
        }[form]  # fmt: skip
        path.write_text(content)
    landmarks = read_landmarks(written(tmp_path, POINTS.tolist()), path)
    assert landmarks.intrinsics is not None
    assert landmarks.intrinsics.tolist() == [CAMERA] * 3


def test_a_camera_that_is_given_goes_before_the_files(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    other = [[500.0, 0, 100], [0, 500.0, 100], [0, 0, 1]]
    path = written(tmp_path, [{"landmarks": POINTS[0].tolist(), "K": other}])
    landmarks = read_landmarks(path, written(tmp_path, CAMERA, "K.json"))
    assert landmarks.intrinsics is not None
    assert landmarks.intrinsics.tolist() == [CAMERA]
    assert "has cameras too" in caplog.text


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ([CAMERA] * 2, "holds 2 camera matrices for 3 hands; expected one for all"),
        (np.transpose(CAMERA).tolist(), r"not \[\[fx, skew, cx\].*column by column"),
        ([[0.8, 0, 0.5], [0, 0.8, 0.5], [0, 0, 1]], "focal lengths of a pixel or less"),
        ([[-900, 0, 640], [0, 900, 480], [0, 0, 1]], "focal lengths of a pixel or less"),
        ([[float("nan"), 0, 640], [0, 900, 480], [0, 0, 1]], "not finite"),
        ([[900, 640], [900, 480]], "holds 2 × 2 numbers, expected camera matrices of 3 × 3"),
        ([[900, 0], [0]], "must be 3 × 3 numbers"),
        ({"camera": CAMERA}, "an object with the keys .*camera.*expected one with `K`"),
        ("[[900, 0", "not complete JSON"),
        ("900 900 640 480", "holds 4 numbers, expected nine per camera matrix"),
        ("fx fy", "no text of numbers"),
    ],
)
def test_what_is_no_camera_is_refused(tmp_path: Path, content: Any, message: str) -> None:  # noqa: ANN401
    path = written(tmp_path, POINTS.tolist())
    with pytest.raises(ValueError, match=message):
        read_landmarks(path, written(tmp_path, content, "K"))


def test_a_camera_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"No camera matrices at .*K\.json"):
        read_landmarks(written(tmp_path, POINTS.tolist()), tmp_path / "K.json")


# --- what is refused ----------------------------------------------------------------------------


def changed(hand: int, landmark: int, point: Any) -> list[Any]:  # noqa: ANN401
    hands: list[Any] = POINTS.tolist()
    hands[hand][landmark] = point
    return hands


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "columns .*expected one row per hand"),
        ("[]", "holds no hands"),
        ("[[[1, 2], [3", "not complete JSON .*cut off"),
        ('{"landmarks": []}\n{"landmarks": []}', "JSON lines"),
        ("{}", "object with the keys"),
        ([POINTS[0, :20].tolist()], r"hand 0 .* has 20 points, expected 21"),
        ([POINTS[0].tolist(), [[1, 2]] * 22], r"hand 1 .* has 22 points, expected 21"),
        ([POINTS[0].tolist(), 7], r"hand 1 .* has 7, expected 21"),
        (changed(2, 5, [1.0]), r"landmark 5 of hand 2 is \[1.0\], expected \[u, v\]"),
        (changed(2, 5, [1.0, 2.0, 3.0, 4.0]), r"landmark 5 of hand 2 is"),
        (changed(2, 5, ["left", 3.0]), "a coordinate is not a number"),
        (changed(1, 5, [float("inf"), 3.0]), "1 of 3 hands have infinite coordinates.*: 1"),
        (changed(1, 5, [None, 30.0]), "1 of 3 hands have landmarks with one coordinate only.*: 1"),
        ((POINTS / 2000).tolist(), "shares of the image's size, as MediaPipe gives them"),
        (with_scores(third=SCORES - 0.5), "a σ that is not positive.*MediaPipe's z"),
        (with_scores(third=np.full((3, 21), np.inf)), "a σ that is not positive and finite"),
        ([{"landmarks": POINTS[0].tolist(), "confidence": [1.5] * 21}], r"outside \[0, 1\]"),
        ([{"landmarks": POINTS[0].tolist(), "sigma": [1.0] * 20}], "`sigma` must be a list of 21"),
        ([{"landmarks": POINTS[0].tolist(), "side": "both"}], "hand 0 has the side 'both'"),
        ([{"points": POINTS[0].tolist()}], "entry 0 is no object with `landmarks`"),
        ([{"landmarks": POINTS[0].tolist()}, POINTS[0].tolist()], "entry 1 is no object"),
        (
            [{"landmarks": POINTS[0].tolist(), "K": CAMERA}, {"landmarks": POINTS[1].tolist()}],
            "1 of 2 hands have a camera matrix, hand 1 has none",
        ),
        ({"annotations": []}, "none of 0 annotations has a hand"),
        ({"annotations": [{"id": 4, "keypoints": [1] * 51}]}, "of annotation 4 has 51 numbers"),
        ([{"keypoints": ["a"] * 63}], "a keypoint is not a number"),
    ],
)  # fmt: skip
def test_every_mistake_has_its_message(tmp_path: Path, content: Any, message: str) -> None:  # noqa: ANN401
    path = written(tmp_path, content)
    with pytest.raises(ValueError, match=f"(?s){message}"):
        read_landmarks(path)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([["x", "y"], [1, 2]], "has the columns .*'x'.*expected one row per hand"),
        ([["u0", "v0"], [1, 2]], r"lacks the columns \['u1'"),
        ([["u0", "u0"], [1, 2]], "two columns of one name"),
        ([["hand", "landmark", "u", "v"], [0, 1, 2]], "line 2: 3 cells for 4 columns"),
        ([["hand", "landmark", "u", "v"], [0, 21, 2, 3]], "unknown landmark '21'"),
        ([["hand", "landmark", "u", "v"], [0, 1, 20, 30], [0, "thumb CMC", 2, 3]], "more than once"),
        ([["hand", "landmark", "u", "v"], [0, 1, "left", 3]], "a cell is not a number"),
        ([["hand", "landmark", "u", "v"]], "holds no hands"),
    ],
)  # fmt: skip
def test_every_mistake_in_a_table_has_its_message(
    tmp_path: Path, rows: list[list[Any]], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        read_landmarks(table(tmp_path, rows))


def test_a_file_that_is_not_there_or_no_text_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"No landmarks at .*nothing\.json"):
        read_landmarks(tmp_path / "nothing.json")
    (tmp_path / "a.json").write_bytes(b"\xff\xd8\xff\xe0")
    with pytest.raises(ValueError, match=r"a\.json is not text"):
        read_landmarks(tmp_path / "a.json")


def test_hands_with_three_landmarks_are_kept_and_named(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    three: list[Any] = [None] * 18 + POINTS[0, :3].tolist()
    four: list[Any] = [None] * 17 + POINTS[0, :4].tolist()
    landmarks = read_landmarks(written(tmp_path, [three, four]))
    assert landmarks.usable.tolist() == [False, True]
    assert "1 of 2 hands have fewer than 4 labelled landmarks" in caplog.text
    assert torch.equal(landmarks.labelled.sum(dim=1), torch.tensor([3, 4]))
