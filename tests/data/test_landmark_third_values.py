"""The meaning of a third number is decided by the whole file, and depths are told from σ and confidence."""

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hand_recon.data.landmarks.files import read_landmarks
from hand_recon.data.landmarks.parsed import Assumptions
from hand_recon.data.landmarks.points_in_space import refuse_points_in_space
from hand_recon.data.landmarks.third_values import are_scores, interpret
from tests.support.landmark_writing import POINTS, written

HANDS = POINTS / 8
"""Three hands whose boxes are about 220 pixels wide."""


def read(tmp_path: Path, third: Any, **assumed: Any) -> Any:  # noqa: ANN401
    third = np.broadcast_to(np.asarray(third, dtype=float), (3, 21))
    content = np.concatenate([HANDS, third[..., None]], axis=-1).tolist()
    return read_landmarks(written(tmp_path, content), assumed=Assumptions(**assumed))


def spread(low: float, high: float, seed: int = 2) -> np.ndarray:
    return np.random.default_rng(seed).uniform(low, high, (3, 21)).round(3)


def with_one(values: np.ndarray, number: float) -> np.ndarray:
    changed = values.copy()
    changed[1, 5] = number
    return changed


# --- scores -------------------------------------------------------------------------------------


@pytest.mark.parametrize("outlier", [1.001, 1.4, 7.0])
def test_one_score_above_one_does_not_make_all_sigmas(
    tmp_path: Path, outlier: float, caplog: pytest.LogCaptureFixture
) -> None:
    scores = spread(0.1, 1)
    with caplog.at_level(logging.INFO):
        landmarks = read(tmp_path, with_one(scores, outlier))
    assert landmarks.sigma is None
    np.testing.assert_array_equal(landmarks.confidence.numpy(), with_one(scores, 1.0))
    assert f"1 of 63 confidences are above 1 (the largest is {outlier:.4g}) and are read as 1" in (
        caplog.text
    )


def test_scores_with_peaks_above_one_are_clipped(tmp_path: Path) -> None:
    scores = spread(0.6, 1.3)
    assert (scores > 1).mean() > 0.3
    confidence = read(tmp_path, scores).confidence.numpy()
    np.testing.assert_array_equal(confidence, scores.clip(max=1))


@pytest.mark.parametrize("low", [1.2, 2.0, 30.0])
def test_numbers_beyond_scores_are_sigmas_still(tmp_path: Path, low: float) -> None:
    landmarks = read(tmp_path, spread(low, 1.1 * low))
    assert landmarks.confidence is None
    assert landmarks.sigma is not None


@pytest.mark.parametrize("negative", [-1.0, -0.01])
def test_a_negative_score_is_a_missing_landmark_and_no_sigma(
    tmp_path: Path, negative: float, caplog: pytest.LogCaptureFixture
) -> None:
    scores = spread(0.1, 1)
    with caplog.at_level(logging.INFO):
        landmarks = read(tmp_path, with_one(scores, negative))
    assert "1 of 63 confidences are negative and are read as 0" in caplog.text
    assert landmarks.sigma is None
    assert (~landmarks.labelled).nonzero().tolist() == [[1, 5]]


@pytest.mark.parametrize("third", [spread(-3, 5), spread(-0.1, 0.1), with_one(spread(2, 9), 0.0)])
def test_numbers_that_are_neither_score_nor_sigma_are_refused(
    tmp_path: Path, third: np.ndarray, caplog: pytest.LogCaptureFixture
) -> None:
    with (
        caplog.at_level(logging.INFO),
        pytest.raises(
            ValueError,
            match=r"no confidences from 0 to 1, and a σ that is not positive.*third_value=ignore",
        ),
    ):
        read(tmp_path, third)
    assert "are read as" not in caplog.text


def test_named_confidences_are_clipped_likewise_or_refused(tmp_path: Path) -> None:
    hand = {"landmarks": HANDS[0].tolist(), "confidence": [0.9] * 20 + [1.2]}
    confidence = read_landmarks(written(tmp_path, [hand])).confidence
    assert confidence is not None
    assert confidence[0, 20] == 1
    hand["confidence"] = [90.0] * 21
    with pytest.raises(ValueError, match=r"outside \[0, 1\]"):
        read_landmarks(written(tmp_path, [hand]))


@given(st.lists(st.floats(0, 1), min_size=1), st.floats(1.0, 1.49))
def test_scaling_scores_by_less_than_a_half_leaves_them_scores(
    numbers: list[float], factor: float
) -> None:
    scores = np.array(numbers)
    assert are_scores(scores)
    scaled = scores * factor
    assert are_scores(scaled) == (bool((scaled <= 1).mean() >= 0.25))
    assert not are_scores(np.append(scores, -1.001))
    assert not are_scores(np.append(scores, [-0.5] * (1 + len(scores) // 19)))


def test_coco_visibilities_are_no_sigmas(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    visibility = np.full((3, 21), 2.0)
    visibility[0, 4], visibility[2, 7] = 0, 1
    with caplog.at_level(logging.INFO):
        landmarks = read(tmp_path, visibility)
    assert "COCO's visibility" in caplog.text
    assert landmarks.sigma is None
    assert landmarks.confidence is None
    assert (~landmarks.labelled).nonzero().tolist() == [[0, 4]]


# --- depths -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("third", "words"),
    [
        (spread(400, 600), "look like depths in mm"),
        (500, "look like depths in mm"),
        (spread(80, 400), "are no standard deviations"),
        (spread(60, 99.5) / 2 + 50, "are no standard deviations|scores in percent"),
    ],
)
def test_numbers_as_large_as_the_hand_are_refused(tmp_path: Path, third: Any, words: str) -> None:  # noqa: ANN401
    with pytest.raises(ValueError, match=f"({words}).*third_value=ignore"):
        read(tmp_path, third)
    landmarks = read(tmp_path, third, third_value="ignore")
    assert landmarks.sigma is None
    assert landmarks.confidence is None
    np.testing.assert_array_equal(landmarks.landmarks_2d.numpy(), HANDS)


def test_percent_of_large_hands_are_told_from_sigma() -> None:
    with pytest.raises(ValueError, match=r"median of 9\d.*scores in percent. Divide them by 100"):
        interpret(Path("a.json"), HANDS * 8, spread(85, 100), "auto")
    assert interpret(Path("a.json"), HANDS * 8, spread(5, 40), "auto")[0] == "sigma"


@pytest.mark.parametrize("key", ["sigma", "third"])
def test_sigmas_that_are_named_are_compared_with_the_hand(
    tmp_path: Path, key: str, caplog: pytest.LogCaptureFixture
) -> None:
    def read_sigma(sigma: float) -> None:
        if key == "third":
            read(tmp_path, sigma, third_value="sigma")
        else:
            hands = [{"landmarks": HANDS[0].tolist(), "sigma": [sigma] * 21}]
            read_landmarks(written(tmp_path, hands))

    read_sigma(20)
    assert "times their hand's size" not in caplog.text
    read_sigma(110)
    assert (
        "times their hand's size in the median, so that the landmarks hardly count" in caplog.text
    )
    with pytest.raises(ValueError, match=r"\(σ\) are 2\.\d+ times .*third_value=ignore"):
        read_sigma(500)


def relative_depth(low: float, high: float) -> np.ndarray:
    depth = spread(low, high)
    depth[:, 0] = 0
    return depth


@pytest.mark.parametrize(
    "third",
    [
        relative_depth(0.01, 0.24),
        relative_depth(-0.2, 0.2),
        relative_depth(-0.2, -0.01),
        relative_depth(-90, 40),
        relative_depth(0.01, 0.24) + 1e-7 * (np.arange(21) == 0),
        np.roll(relative_depth(-30, 30), 9, axis=1),
    ],
)
def test_depth_relative_to_a_landmark_is_left_out_aloud(
    tmp_path: Path, third: np.ndarray, caplog: pytest.LogCaptureFixture
) -> None:
    landmarks = read(tmp_path, third)
    assert "such as MediaPipe's z, and no confidence. They are left out" in caplog.text
    assert landmarks.confidence is None
    assert landmarks.sigma is None
    assert landmarks.labelled.all()


def test_a_landmark_that_a_detector_never_finds_is_no_depth(tmp_path: Path) -> None:
    scores = spread(0.5, 1)
    scores[:, 3] = 0
    landmarks = read(tmp_path, scores)
    assert landmarks.confidence is not None
    assert (~landmarks.labelled).nonzero().tolist() == [[0, 3], [1, 3], [2, 3]]


def test_confidences_that_may_be_depths_in_metres_are_doubted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    assert read(tmp_path, spread(0.45, 0.55)).confidence is not None
    assert "hardly vary within a hand, as depths in metres" in caplog.text
    caplog.clear()
    read(tmp_path, spread(0.3, 0.94))
    read(tmp_path, 0.5)
    assert "depths in metres" not in caplog.text


# --- points in space ----------------------------------------------------------------------------


def in_camera(unit: float) -> np.ndarray:
    """Hands of 0.2 m half a metre away, in units of this many metres."""
    rng = np.random.default_rng(4)
    shape = rng.uniform(-0.06, 0.06, (5, 21, 3))
    return np.asarray((shape + np.array([0.0, 0.0, 0.5])) / unit)


@pytest.mark.parametrize(
    ("unit", "name"), [(1.0, "metres"), (0.01, "centimetres"), (0.001, "millimetres")]
)
@pytest.mark.parametrize(
    ("change", "cure"),
    [
        (lambda xyz: xyz, r"Project them with the camera matrix K: uvw = xyz"),
        (lambda xyz: xyz - xyz[:, :1], "relative to a point of the hand"),
        (lambda xyz: xyz - xyz.mean(axis=1, keepdims=True), "relative to a point of the hand"),
        (lambda xyz: xyz * [1, -1, -1], "OpenGL's axes: negate y and z"),
    ],
)
def test_points_in_space_are_refused_with_their_unit(
    tmp_path: Path, unit: float, name: str, change: Callable[[np.ndarray], np.ndarray], cure: str
) -> None:
    path = written(tmp_path, change(in_camera(unit)).tolist())
    with pytest.raises(ValueError, match=f"3D points in {name} .*{cure}"):
        read_landmarks(path)


def test_the_projection_in_the_message_is_the_cameras(tmp_path: Path) -> None:
    """A point at (0.1, −0.05, 0.5) m with f = 800 px is 160 right and 80 above (320, 240)."""
    K = np.array([[800.0, 0, 320], [0, 800, 240], [0, 0, 1]])
    for camera in (K, K[None]):
        names: dict[str, Any] = {"xyz": np.array([[[0.1, -0.05, 0.5]]]), "K": camera, "np": np}
        with pytest.raises(ValueError, match="Project them") as error:
            read_landmarks(written(tmp_path, in_camera(1.0).tolist()))
        statements = str(error.value).partition("matrix K: ")[2].partition(". In FreiHAND")[0]
        exec(statements, names)  # noqa: S102  # our own message
        np.testing.assert_allclose(names["uv"], [[[480, 160]]])


@pytest.mark.parametrize(
    "third", [spread(0.1, 1), spread(2, 9), spread(400, 600), relative_depth(-0.2, 0.2)]
)
def test_pixels_with_a_third_number_are_no_points_in_space(third: np.ndarray) -> None:
    refuse_points_in_space(Path("a.json"), HANDS, third)
    # Some hands reach out of the image.
    moved = HANDS - [100, 0]
    moved[1:] = HANDS[1:]
    refuse_points_in_space(Path("a.json"), moved, third)
    refuse_points_in_space(Path("a.json"), HANDS, None)
