"""Files of reconstructed hands read as landmarks."""

import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hand_recon.data.landmarks.files import read_landmarks
from tests.support.landmark_writing import (
    CAMERA,
    POINTS,
    assert_same_hands,
    written,
)


@pytest.mark.parametrize("sigma", ["sigma", "sigma_2d"])
@pytest.mark.parametrize(
    ("cameras", "known"),
    [
        ([{"source": "given"}, {"source": "EXIF"}], True),
        ([{"source": "field of view"}, {"source": "EXIF"}], True),
        ([{"known": True}, {"known": True}], True),
        ([{"source": "given"}, {"source": "assumed"}], False),
        ([{"known": False}, {"known": False}], False),
    ],
)
def test_reconstructed_hands_are_landmarks_with_the_cameras_that_were_given(
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    sigma: str,
    cameras: list[dict[str, Any]],
    known: bool,
) -> None:
    hands = [
        {
            "image": "a.jpg", "name": f"hand {number}", "side": "left", "verdict": "plausible", "reasons": [],
            "landmarks_3d": [[0.0, 0.0, 0.5]] * 21, "landmarks_2d": POINTS[number].tolist(),
            sigma: [[3.0, 4.0]] * 21, "joint_angles_degrees": {}, "loss": {},
            "camera": {"intrinsics": CAMERA, "image_size": None, **camera},
        }
        for number, camera in enumerate(cameras)
    ]  # fmt: skip
    hands.append(
        {**hands[0], "name": "not fitted", "landmarks_2d": None, sigma: None, "camera": None}
    )
    with caplog.at_level(logging.INFO):
        landmarks = read_landmarks(written(tmp_path, hands, "hands.json"))
    assert_same_hands(landmarks.select(slice(0, 2)), POINTS[:2])
    assert landmarks.usable.tolist() == [True, True, False]
    assert landmarks.left.all()
    assert landmarks.sigma is not None
    # The root mean square of 3 and 4 pixels.
    np.testing.assert_allclose(landmarks.sigma[:2].numpy(), 12.5**0.5)
    assert (landmarks.intrinsics is not None) == known
    assert "projections of reconstructed hands; 3 left hands are read" in caplog.text
    assert "are not read; known are" not in caplog.text


def result(number: int, source: str | None, **changes: Any) -> dict[str, Any]:  # noqa: ANN401
    """A hand of a file of reconstructed hands, whose projections are 5 px right of what was observed."""
    projections = (POINTS[number] + [5.0, 0.0]).tolist()
    camera = {"intrinsics": CAMERA, "image_size": None, "source": source}
    return {
        "image": f"{number}.jpg", "name": f"hand {number}", "side": "right",
        "landmarks_3d": [[0.0, 0.0, 0.5]] * 21, "landmarks_2d": projections,
        "observed_2d": POINTS[number].tolist(), "loss": {}, "camera": camera if source else None, **changes,
    }  # fmt: skip


def test_reconstructed_hands_are_read_as_they_were_observed(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    first = result(0, "given")
    first["observed_2d"][3] = None
    hands = [first, result(1, "EXIF", observed_2d=None)]
    with caplog.at_level(logging.INFO):
        found = read_landmarks(written(tmp_path, hands))
    assert found.labelled[0].tolist() == [landmark != 3 for landmark in range(21)]
    seen = found.labelled[0].numpy()
    np.testing.assert_allclose(found.landmarks_2d[0].numpy()[seen], POINTS[0][seen])
    np.testing.assert_allclose(found.landmarks_2d[1].numpy(), POINTS[1] + [5.0, 0.0])
    assert "observed landmarks of reconstructed hands; 2 right hands are read" in caplog.text
    assert found.intrinsics is not None
    assert not [record for record in caplog.records if record.levelno >= logging.WARNING]


def test_known_cameras_beside_assumed_ones_are_left_out_and_counted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    hands = [result(0, "given"), result(1, "assumed"), result(0, "EXIF")]
    assert read_landmarks(written(tmp_path, hands)).intrinsics is None
    assert (
        "1 of 3 hands have no known camera, so that the known cameras of 2 are left out"
        in caplog.text
    )
    caplog.clear()
    assert read_landmarks(written(tmp_path, [result(0, "assumed")] * 2)).intrinsics is None
    assert "known camera" not in caplog.text


def test_a_hand_without_a_result_has_the_camera_of_its_image(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A fit that ran away can be tried again; the camera of another image is not that of its own."""
    no_result = {"landmarks_3d": None, "landmarks_2d": None, "loss": None}
    beside = [result(0, "given"), result(1, None, image="0.jpg", **no_result)]
    found = read_landmarks(written(tmp_path, beside))
    assert found.intrinsics is not None
    assert found.intrinsics.tolist() == [CAMERA] * 2
    np.testing.assert_allclose(found.landmarks_2d[1].numpy(), POINTS[1])
    elsewhere = [result(0, "given"), result(1, None, **no_result)]
    assert read_landmarks(written(tmp_path, elsewhere)).intrinsics is None
    assert "known cameras of 1 are left out" in caplog.text
    few = [*POINTS[1][:3].tolist(), *[None] * 18]
    seen = read_landmarks(
        written(tmp_path, [result(0, "given"), result(1, None, **no_result, observed_2d=few)])
    )
    assert seen.intrinsics is not None
    assert seen.usable.tolist() == [True, False]


@pytest.mark.parametrize(
    "damage",
    [
        {"observed_2d": "gone"},
        {"observed_2d": [[1.0, 2.0]] * 20},
        {"observed_2d": [[1.0]] * 21},
        {"observed_2d": 3},
        {"observed_2d": {}},
        {"landmarks_2d": 7, "observed_2d": None},
        {"camera": {"source": "given", "intrinsics": [1, 2]}},
        {"camera": {"source": "given", "intrinsics": None}, "observed_2d": []},
        {"side": 4},
        {"image": ["a.jpg"], "side": "up"},
    ],
)
def test_damaged_reconstructed_hands_are_refused(tmp_path: Path, damage: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"hands|landmarks|hand"):
        read_landmarks(written(tmp_path, [result(0, "given", **damage)]))
