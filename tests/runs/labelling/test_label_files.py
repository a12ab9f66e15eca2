"""Files of labels are read back as they were detected; the progress of a command survives a kill."""

import csv
import json
import logging
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hand_recon.data.landmarks.files import read_landmarks
from hand_recon.data.landmarks.parsed import Assumptions
from hand_recon.detection.detector import DetectedHand, Side
from hand_recon.runs.labelling.label_files import (
    COLUMNS,
    pairs_of,
    recording,
    write_labels,
    write_table,
)
from hand_recon.runs.labelling.label_records import LabelledImage, labelled_hand
from tests.support.labelled_hands import MARKS, image, labelled

ABOUT = {"made_by": "a test"}


@st.composite
def detections(draw: st.DrawFn) -> list[DetectedHand]:
    """Hands with σ, of which some landmarks may be missing; hands at least 100 px large."""
    hands = []
    for _ in range(draw(st.integers(1, 4))):
        rng = np.random.default_rng(draw(st.integers(0, 1000)))
        points = rng.uniform(1, draw(st.floats(100, 5000)), (21, 2))
        points[:2] = (-50, -50), (100, 100)
        for landmark in draw(st.sets(st.integers(2, 20), max_size=10)):
            points[landmark] = np.nan
        side: Side = "left" if draw(st.booleans()) else "right"
        hands.append(DetectedHand(points, side, rng.uniform(), 0.9, sigma=rng.uniform(0.5, 20, 21)))
    return hands


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(hands=detections())
def test_labels_read_back_are_what_the_detector_said_to_the_rounding(
    hands: list[DetectedHand], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "labels.json"
    images = [
        LabelledImage(f"a/{number}.jpg", (5000, 5000), [labelled_hand(hand, {})])
        for number, hand in enumerate(hands)
    ]
    write_labels(path, pairs_of(images), ABOUT)
    caplog.clear()
    caplog.set_level(logging.WARNING)
    found = read_landmarks(path, assumed=Assumptions(side=None, images=tmp_path / "photos"))
    assert not caplog.records
    assert found.sigma is not None
    for number, hand in enumerate(hands):
        there = np.isfinite(hand.landmarks_2d[:, 0])
        points = found.landmarks_2d[number].numpy()
        np.testing.assert_allclose(points, hand.landmarks_2d, atol=0.00501)
        assert (found.labelled[number].numpy() == there).all()
        assert hand.sigma is not None
        sigma = found.sigma[number].numpy()
        np.testing.assert_allclose(sigma[there], hand.sigma[there], atol=0.000501)
        assert bool(found.left[number]) == (hand.side == "left")
        assert found.images[number] == tmp_path / "photos" / "a" / f"{number}.jpg"


def test_scores_and_marks_stand_beside_the_hands_in_their_order(tmp_path: Path) -> None:
    path = tmp_path / "doubtful.json"
    images = [image("a.jpg", labelled(1)), image("b.jpg", labelled(2, doubtful=True))]
    write_labels(path, pairs_of(images), ABOUT)
    content = json.loads(path.read_text())
    assert [entry["image"] for entry in content["hands"]] == ["a.jpg", "b.jpg"]
    assert content["marks"] == [{}, MARKS]
    assert content["scores"] == [0.98, 0.98]
    assert content["about"] == ABOUT
    assert not list(tmp_path.glob("*.part"))


def test_confidences_of_another_detector_are_kept_and_sigma_is_not_made_up(tmp_path: Path) -> None:
    confidence = np.linspace(0.2, 1, 21)
    points = np.random.default_rng(0).uniform(0, 200, (21, 2))
    hand = DetectedHand(points, "left", None, 1.0, confidence=confidence, sigma=np.full(21, np.nan))
    write_labels(tmp_path / "l.json", [(image("a.jpg"), labelled_hand(hand, {}))], ABOUT)
    found = read_landmarks(tmp_path / "l.json")
    assert found.sigma is None
    assert found.confidence is not None
    np.testing.assert_allclose(found.confidence[0].numpy(), confidence, atol=0.000501)


def test_a_record_is_the_same_after_its_row_of_json() -> None:
    missing = labelled(3, "left", doubtful=True)
    missing.landmarks_2d[4] = np.nan
    assert missing.sigma is not None
    missing.sigma[4] = np.nan
    given_image = image("ä b/1.jpg", labelled(1), missing)
    row = json.loads(json.dumps(given_image.to_row(), allow_nan=False))
    again = LabelledImage.from_row(row)
    assert again.to_row() == given_image.to_row()
    np.testing.assert_array_equal(again.hands[1].landmarks_2d, missing.landmarks_2d)
    assert again.hands[1].reasons == MARKS
    assert not again.hands[1].is_sure
    failed = LabelledImage("a.jpg", error="damaged")
    assert LabelledImage.from_row(json.loads(json.dumps(failed.to_row()))) == failed


def test_progress_keeps_whole_lines_and_goes_on_behind_them(tmp_path: Path) -> None:
    path = tmp_path / "progress.jsonl"
    batches = [[image("a.jpg", labelled(1)), image("b.jpg")], [image("c.jpg", labelled(2))]]
    with recording(path) as (done, add):
        assert done == []
        for batch in batches:
            add(batch)
    with path.open("a") as stream:
        stream.write('[{"image": "d')
    with recording(path) as (done, add):
        assert [one.name for one in done] == ["a.jpg", "b.jpg", "c.jpg"]
        add([image("d.jpg", labelled(4))])
    with recording(path) as (done, _):
        assert [one.name for one in done] == ["a.jpg", "b.jpg", "c.jpg", "d.jpg"]
        assert done[3].to_row() == image("d.jpg", labelled(4)).to_row()


def test_the_table_has_a_row_for_each_hand_and_for_each_image_without(tmp_path: Path) -> None:
    images = [
        image("a.jpg", labelled(1), labelled(2, "left", doubtful=True)),
        image("b.jpg"),
        LabelledImage("c.jpg", error="cut off, damaged"),
    ]
    write_table(tmp_path / "hands.csv", images)
    with (tmp_path / "hands.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert tuple(rows[0]) == COLUMNS
    assert [row["image"] for row in rows] == ["a.jpg", "a.jpg", "b.jpg", "c.jpg"]
    assert [row["marks"] for row in rows] == ["", "; ".join(MARKS), "", ""]
    assert rows[1]["side"] == "left"
    assert rows[3]["error"] == "cut off, damaged"
    hand = labelled(1)
    assert hand.sigma is not None
    expected = 100 * hand.sigma.mean() / hand.extent
    assert float(rows[0]["sigma_percent"]) == pytest.approx(expected, abs=0.006)
