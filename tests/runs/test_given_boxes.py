"""Boxes without landmarks in a detector's place: sides, boxes that show no hand, whole images."""

import json
from pathlib import Path

import numpy as np
import pytest

from hand_recon.runs.given_boxes import GivenBoxes, WholeImages

IMAGE = np.zeros((60, 100, 3), np.uint8)


def boxes_file(folder: Path, *entries: dict[str, object]) -> Path:
    path = folder / "boxes.json"
    path.write_text(json.dumps([{"image": "a.png", **entry} for entry in entries]))
    return path


def test_boxes_are_hands_without_landmarks_in_their_order(tmp_path: Path) -> None:
    file = boxes_file(
        tmp_path,
        {"box": [10, 5, 60, 55], "side": "left"},
        {"box": [-20, 0, 30, 40], "side": "right"},
    )
    found = GivenBoxes(file)(IMAGE, tmp_path / "a.png")
    assert found.dropped == ()
    assert [hand.side for hand in found.hands] == ["left", "right"]
    assert found.hands[0].box is not None
    assert found.hands[0].box.tolist() == [10, 5, 60, 55]
    assert all(np.isnan(hand.landmarks_2d).all() for hand in found.hands)
    assert all(hand.score is None for hand in found.hands)


def test_boxes_that_show_no_hand_are_dropped_with_the_reason(tmp_path: Path) -> None:
    boxes = ([100, 0, 130, 40], [5, 5, 14, 24], [5, 5, 15, 25])
    entries: list[dict[str, object]] = [{"box": box, "side": "right"} for box in boxes]
    file = boxes_file(tmp_path, *entries)
    found = GivenBoxes(file)(IMAGE, Path("a.png"))
    assert len(found.hands) == 1
    assert "outside the image of 100 × 60 px" in found.dropped[0]
    assert "spans 19 px, below detector.min_side=20" in found.dropped[1]
    assert "has no entry for" in GivenBoxes(file)(IMAGE, Path("b.png")).dropped[0]
    with pytest.raises(ValueError, match="this image is an array"):
        GivenBoxes(file)(IMAGE)


def test_a_box_without_a_side_has_the_given_one_or_is_refused(tmp_path: Path) -> None:
    file = boxes_file(tmp_path, {"box": [0, 0, 50, 50]}, {"box": [0, 0, 50, 50], "side": "right"})
    with pytest.raises(ValueError, match=r"1 of 2 boxes have no side.*add side=right or side=left"):
        GivenBoxes(file)
    found = GivenBoxes(file, side="left")(IMAGE, Path("a.png"))
    assert [hand.side for hand in found.hands] == ["left", "right"]
    with pytest.raises(ValueError, match="Found side=both; expected side=right or side=left"):
        GivenBoxes(file, side="both")


def test_a_whole_image_is_a_hand_in_the_square_about_it() -> None:
    """An image of 100 × 60: from 20 px above it to 20 px below."""
    with pytest.raises(ValueError, match=r"detector=whole with ckpt=… needs the side.*side=left"):
        WholeImages()
    (hand,) = WholeImages("left")(IMAGE).hands
    assert hand.box is not None
    assert hand.box.tolist() == [0, -20, 100, 80]
    assert hand.side == "left"
