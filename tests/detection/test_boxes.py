"""Hands in given boxes: files in every form, mistakes in them, and what is read in the boxes."""

import json
from pathlib import Path

import numpy as np
import pytest

from hand_recon.detection.box_files import BoxFile, GivenBox
from hand_recon.detection.boxes import BoxDetector, WholeImageDetector
from hand_recon.detection.detector import Detector
from hand_recon.detection.mediapipe import MediaPipeDetector

BOX = GivenBox(10, 20, 30, 60)


def written(folder: Path, content: object, name: str = "boxes.json") -> Path:
    path = folder / name
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def coco(**annotation: object) -> dict[str, object]:
    return {
        "images": [{"id": 7, "file_name": "a.jpg"}, {"id": 8, "file_name": "none.jpg"}],
        "annotations": [{"image_id": 7, "bbox": [10, 20, 20, 40], "category_id": 1, **annotation}],
        "categories": [{"id": 1, "name": "hand"}, {"id": 2, "name": "Left_Hand"}],
    }


@pytest.mark.parametrize(
    ("content", "name"),
    [
        ({"a.jpg": [[10, 20, 30, 60]]}, "boxes.json"),
        ({"a.jpg": [10, 20, 30, 60]}, "boxes.json"),
        ([{"image": "a.jpg", "box": [10, 20, 30, 60]}], "boxes.json"),
        (coco(), "boxes.json"),
        ("image,left,top,right,bottom\na.jpg,10,20,30,60\n", "boxes.csv"),
        ("\ufeffTop,Image ,left,right,bottom,side\n20,a.jpg,10,30,60,\n", "BOXES.CSV"),
    ],
)
def test_every_form_gives_the_same_box(content: object, name: str, tmp_path: Path) -> None:
    assert BoxFile(written(tmp_path, content, name)).of(Path("a.jpg")) == [BOX]


@pytest.mark.parametrize(
    ("content", "name"),
    [
        ([{"image": "a.jpg", "box": [10, 20, 30, 60], "side": "left"}], "boxes.json"),
        (coco(side="Left"), "boxes.json"),
        (coco(category_id=2), "boxes.json"),
        ("image,left,top,right,bottom,side\na.jpg,10,20,30,60,left\n", "boxes.csv"),
    ],
)
def test_sides_are_read_where_they_are_given(content: object, name: str, tmp_path: Path) -> None:
    (box,) = BoxFile(written(tmp_path, content, name)).of(Path("a.jpg")) or []
    assert box.side == "left"


def test_boxes_keep_their_order_and_an_image_may_have_none(tmp_path: Path) -> None:
    boxes = BoxFile(written(tmp_path, {"a.jpg": [[1, 2, 3, 4], [0, 0, 9, 9]], "b.jpg": []}))
    assert boxes.of(Path("a.jpg")) == [GivenBox(1, 2, 3, 4), GivenBox(0, 0, 9, 9)]
    assert boxes.of(Path("b.jpg")) == []
    assert boxes.of(Path("c.jpg")) is None
    assert BoxFile(written(tmp_path, coco(), "coco.json")).of(Path("none.jpg")) == []


@pytest.mark.parametrize(
    ("name", "file", "fits"),
    [
        ("a.jpg", "folder/a.jpg", True),
        ("folder/a.jpg", "/data/folder/a.jpg", True),
        ("/elsewhere/folder/a.jpg", "folder/a.jpg", True),
        ("folder\\a.jpg", "folder/a.jpg", True),
        ("other/a.jpg", "folder/a.jpg", False),
        ("a.jpg", "ba.jpg", False),
        ("a.jpg", "a.png", False),
    ],
)
def test_an_image_is_found_by_the_end_of_its_path(
    name: str, file: str, fits: bool, tmp_path: Path
) -> None:
    found = BoxFile(written(tmp_path, {name: [10, 20, 30, 60]})).of(Path(file))
    assert found == ([BOX] if fits else None)


def test_the_longest_name_counts_and_a_tie_is_refused(tmp_path: Path) -> None:
    both = {"a.jpg": [1, 2, 3, 4], "folder/a.jpg": [10, 20, 30, 60]}
    boxes = BoxFile(written(tmp_path, both))
    assert boxes.of(Path("/data/folder/a.jpg")) == [BOX]
    assert boxes.of(Path("/data/else/a.jpg")) == [GivenBox(1, 2, 3, 4)]
    tie = BoxFile(written(tmp_path, {"/m/x/a.jpg": [1, 2, 3, 4], "/m/y/a.jpg": [1, 2, 3, 4]}))
    with pytest.raises(
        ValueError, match=r"both /m/x/a.jpg and /m/y/a.jpg could be the image a.jpg"
    ):
        tie.of(Path("a.jpg"))


def test_a_match_does_not_depend_on_the_working_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    boxes = BoxFile(written(tmp_path, {"x/a.jpg": [1, 2, 3, 4], "y/a.jpg": [10, 20, 30, 60]}))
    for folder in (tmp_path, tmp_path / "y"):
        folder.mkdir(exist_ok=True)
        monkeypatch.chdir(folder)
        image = (tmp_path / "y" / "a.jpg").relative_to(folder)
        assert boxes.of(image) == [BOX]
    monkeypatch.chdir(tmp_path)
    assert boxes.of(Path("a.jpg")) is None


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "is no JSON"),
        ("3", "found a single int"),
        ({"a.jpg": 3}, "found 3 for a.jpg"),
        ({"a.jpg": [[1, 2, 3]]}, r"expected four numbers, found \[1, 2, 3\]"),
        ({"a.jpg": [[1, 2, 3, "x"]]}, "expected four numbers"),
        ({"a.jpg": [[1, 2, 3, None]]}, "expected four numbers"),
        ('{"a.jpg": [[1, 2, 3, NaN]]}', "expected finite numbers"),
        ({"a.jpg": [[100, 100, 50, 60]]}, "right > left.*Is it left, top, width, height"),
        ({"a.jpg": [[1, 2, 1, 9]]}, "right > left"),
        ([{"image": "a.jpg"}], r"found \{'image': 'a.jpg'\} as entry 0"),
        ([3], "found 3 as entry 0"),
        ([{"image": "a.jpg", "box": [1, 2, 3, 4], "side": "both"}], "left or right, found 'both'"),
        ({"images": [{"id": 1}], "annotations": []}, "failed at 'file_name'"),
        ({"images": [], "annotations": [{"image_id": 3, "bbox": [1, 2, 3, 4]}]}, "failed at 3"),
        ({"images": 3, "annotations": []}, "COCO file whose images need"),
        (coco(bbox=[1, 2, -3, 4]), "right > left"),
    ],
)
def test_a_mistake_in_the_file_is_named(content: object, message: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=message) as refused:
        BoxFile(written(tmp_path, content))
    assert "boxes.json" in str(refused.value)


def test_a_table_without_its_columns_or_with_a_short_line_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"expected the columns image, left.*found image, x"):
        BoxFile(written(tmp_path, "image,x\na,1\n", "a.csv"))
    with pytest.raises(ValueError, match=r"line 3: expected four numbers, found \['1', '2'"):
        BoxFile(written(tmp_path, "image,left,top,right,bottom\na,1,2,3,4\nb,1,2\n", "b.csv"))
    with pytest.raises(ValueError, match="found none"):
        BoxFile(written(tmp_path, "", "c.csv"))


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"No file of boxes at .*none.json. Name a JSON"):
        BoxDetector(tmp_path / "none.json")


def box_around(landmarks: np.ndarray) -> list[float]:
    return [*landmarks.min(axis=0).tolist(), *landmarks.max(axis=0).tolist()]


def distance(one: np.ndarray, other: np.ndarray) -> float:
    """Mean distance of landmarks, shares of the hand's extent."""
    return float(np.linalg.norm(one - other, axis=1).mean() / np.ptp(other, axis=0).max())


def test_boxes_around_hands_give_their_landmarks(
    models: Path, two_hands: np.ndarray, tmp_path: Path
) -> None:
    found = MediaPipeDetector(models=models)(two_hands).hands
    rows = {"two_hands.jpg": [box_around(hand.landmarks_2d) for hand in found]}
    detector: Detector = BoxDetector(written(tmp_path, rows), models=models)
    again = detector(two_hands, Path("examples/two_hands.jpg"))
    assert again.dropped == ()
    assert len(again.hands) == 2
    for hand, before in zip(again.hands, found, strict=True):
        assert distance(hand.landmarks_2d, before.landmarks_2d) < 0.05
        assert (hand.side, hand.palm_score) == ("left", None)


def test_the_side_that_is_given_stands(models: Path, two_hands: np.ndarray, tmp_path: Path) -> None:
    (first, _) = MediaPipeDetector(models=models)(two_hands).hands
    box = box_around(first.landmarks_2d)
    for side in ("left", "right"):
        rows = [{"image": "a.jpg", "box": box, "side": side}]
        (hand,) = BoxDetector(written(tmp_path, rows), models=models)(
            two_hands, Path("a.jpg")
        ).hands
        assert hand.side == side
        # The network says left.
        assert (hand.side_score > 0.5) is (side == "left")


def test_what_is_no_hand_is_dropped_with_its_option(
    models: Path, two_hands: np.ndarray, tmp_path: Path
) -> None:
    rows = {"a.jpg": [[330, 5, 350, 25], [900, 10, 950, 60]]}
    found = BoxDetector(written(tmp_path, rows), models=models)(two_hands, Path("a.jpg"))
    assert found.hands == ()
    assert "detector.min_" in found.dropped[0]
    assert "the box 900, 10, 950, 60 is outside the image of 720 × 382 px" in found.dropped[1]


def test_an_image_without_an_entry_is_told(tmp_path: Path, two_hands: np.ndarray) -> None:
    detector = BoxDetector(written(tmp_path, {"a.jpg": []}))
    assert detector(two_hands, Path("a.jpg")).dropped == ()
    (sentence,) = detector(two_hands, Path("b.jpg")).dropped
    assert sentence.endswith("boxes.json has no entry for b.jpg")
    with pytest.raises(ValueError, match="give file=<path>"):
        detector(two_hands)


@pytest.mark.parametrize("quarters", [0, 1, 2, 3])
def test_a_whole_image_is_read_in_every_direction(
    models: Path, one_hand: np.ndarray, quarters: int
) -> None:
    tight = one_hand[8:95, 25:92]
    (expected,) = MediaPipeDetector(models=models)(one_hand).hands
    image = np.ascontiguousarray(np.rot90(tight, quarters))
    (hand,) = WholeImageDetector(models=models)(image).hands
    back, size = hand.landmarks_2d, image.shape
    for _ in range(quarters):
        back = np.stack([size[0] - 1 - back[:, 1], back[:, 0]], axis=1)
        size = (size[1], size[0], 3)
    assert distance(back + np.array([25, 8]), expected.landmarks_2d) < 0.08
    assert hand.side == "right"


def test_a_whole_image_without_a_hand_is_dropped(models: Path) -> None:
    found = WholeImageDetector(models=models)(np.full((90, 60, 3), 120, dtype=np.uint8))
    assert found.hands == ()
    assert "detector.min_presence=0.5" in found.dropped[0]


def test_margins_that_hide_a_hand_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"detector.margin between 0.5 and 5, found 0.1"):
        WholeImageDetector(margin=0.1)
    with pytest.raises(ValueError, match=r"found 9"):
        BoxDetector(written(tmp_path, {}), margin=9)
