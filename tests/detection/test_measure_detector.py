"""The tool that compares the detector with MediaPipe's labels, on labels that are made up."""

import json
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from hand_recon.detection.detector import DetectedHand, Detections
from hand_recon.detection.mediapipe import MediaPipeDetector
from measure_detector import Comparison, enlarged_copy, main
from tests.detection.conftest import EXAMPLES, read


def found(*sides: str) -> Detections:
    hands = [DetectedHand(np.zeros((21, 2)), side, 0.9, 0.9) for side in sides]  # type: ignore[arg-type]
    return Detections(tuple(hands))


def test_a_small_image_is_padded_and_enlarged_a_large_one_only_padded() -> None:
    image = np.zeros((60, 100, 3), dtype=np.uint8)
    copy, factor, corner = enlarged_copy(image, 1.7)
    assert copy.shape == (256, 256, 3)
    assert factor == pytest.approx(256 / 170)
    assert corner.tolist() == [35, 55]
    copy, factor, _ = enlarged_copy(np.zeros((200, 200, 3), dtype=np.uint8), 1.7)
    assert copy.shape == (340, 340, 3)
    assert factor == 1


def test_images_are_counted_by_number_and_side_of_their_hands() -> None:
    done = Comparison()
    label = [[3.0, 4.0]] * 21
    assert done.add(found("left"), {"hands": 1, "side": "left"}, label) == [5.0] * 21
    assert done.add(found("right"), {"hands": 1, "side": "left"}, label) is None
    assert done.add(found(), {"hands": 1, "side": "left"}, label) is None
    assert done.add(found("left", "right"), {"hands": 1, "side": "left"}, label) is None
    assert done.add(found(), {"hands": 0}, None) is None
    assert done.add(found("left", "left"), {"hands": 2}, None) is None
    assert (done.images, done.same, done.fewer, done.more, done.other_side) == (6, 3, 1, 1, 1)


def test_labels_of_the_detector_itself_are_met(
    models: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("HAND_RECON_CACHE", str(models.parent))
    image = read(EXAMPLES / "hand.jpg")
    (hand,) = MediaPipeDetector(padding=1.7, copies=0)(image).hands
    # Moved by 3 px of 100: 7.68 px of 256.
    moved = (hand.landmarks_2d + np.array([0, 3])).tolist()
    cv2.imwrite(str(tmp_path / "a.png"), image[..., ::-1])
    (tmp_path / "test.json").write_text(json.dumps([{"image": "a.png", "landmarks": moved}]))
    (tmp_path / "detections.json").write_text(json.dumps({"a.png": {"hands": 1, "side": "right"}}))
    monkeypatch.setattr(sys, "argv", ["measure_detector", str(tmp_path)])
    main()
    printed = capsys.readouterr().out
    assert "1 images: 1 the same hands (100.00 %)" in printed
    assert "1 hands: error mean 7.680, median 7.680" in printed
    assert "landmarks of a hand: median" in printed
