"""Camera files: every tool's form, lens distortion, and files that hold no camera."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hand_recon.data.landmarks.cameras import with_cameras
from hand_recon.data.landmarks.distortion import undistorted
from hand_recon.data.landmarks.files import read_landmarks
from tests.support.camera_files import MATRIX, POINTS, given_camera
from tests.support.landmark_writing import written

BROWN = [-0.3, 0.12, 0.001, -0.002, 0.01]
FISHEYE = [0.05, -0.01, 0.002, 0.0]
NONE = [0.0] * 5

FLAT = [800.0, 0, 330, 0, 810, 235, 0, 0, 1]
OPENCV_YAML = f"""%YAML:1.0
---
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: {FLAT}
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: {BROWN}
"""
ROS = f"""image_width: 640
image_height: 480
camera_matrix: {{rows: 3, cols: 3, data: {FLAT}}}
distortion_model: plumb_bob
distortion_coefficients: {{rows: 1, cols: 5, data: {BROWN}}}
rectification_matrix: {{rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}}
"""
OPENCV_XML = f"""<?xml version="1.0"?>
<opencv_storage>
<image_width>640</image_width>
<camera_matrix type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt>
<data>{" ".join(map(str, FLAT))}</data></camera_matrix>
<distortion_coefficients type_id="opencv-matrix"><rows>5</rows><cols>1</cols><dt>d</dt>
<data>{" ".join(map(str, BROWN))}</data></distortion_coefficients>
</opencv_storage>
"""
KALIBR = """cam0:
  camera_model: pinhole
  intrinsics: [800, 810, 330, 235]
  distortion_model: {model}
  distortion_coeffs: {coefficients}
  resolution: [640, 480]
"""
SPLIT = {"k1": BROWN[0], "k2": BROWN[1], "p1": BROWN[2], "p2": BROWN[3], "k3": BROWN[4]}

FORMS: dict[str, tuple[str, list[float]]] = {
    "matrix": (json.dumps(MATRIX), NONE),
    "3 × 4": (json.dumps([[*row, 0.0] for row in MATRIX]), NONE),
    "4 × 4": (json.dumps([*([*row, 0] for row in MATRIX), [0, 0, 0, 1]]), NONE),
    "K and dist": (json.dumps({"K": MATRIX, "dist": BROWN}), BROWN),
    "nested dist": (json.dumps({"mtx": MATRIX, "dist": [BROWN]}), BROWN),
    "flat": (json.dumps({"intrinsics": FLAT, "D": BROWN}), BROWN),
    "names": (json.dumps({"fx": 800, "fy": 810, "cx": 330, "cy": 235, **SPLIT}), BROWN),
    "instant-ngp": (
        json.dumps({"fl_x": 800, "fl_y": 810, "cx": 330, "cy": 235, "w": 640, "h": 480, "k1": -0.3}),
        [-0.3, 0, 0, 0],
    ),
    "RealSense": (
        json.dumps(
            {"width": 640, "height": 480, "fx": 800, "fy": 810, "ppx": 330, "ppy": 235,
             "model": "distortion.inverse_brown_conrady", "coeffs": NONE}
        ),
        NONE,
    ),
    "Open3D": (
        json.dumps({"width": 640, "height": 480, "intrinsic_matrix": [800, 0, 0, 0, 810, 0, 330, 235, 1]}),
        NONE,
    ),
    "inner object": (json.dumps({"intrinsics": {"fx": 800, "fy": 810, "cx": 330, "cy": 235}}), NONE),
    "cameras by name": (json.dumps({"cam": {"K": MATRIX, "dist": BROWN}, "date": "today"}), BROWN),
    "list of objects": (json.dumps([{"K": MATRIX, "dist": BROWN}] * 2), BROWN),
    "OpenCV YAML": (OPENCV_YAML, BROWN),
    "OpenCV XML": (OPENCV_XML, BROWN),
    "ROS": (ROS, BROWN),
    "Kalibr": (KALIBR.format(model="radtan", coefficients=BROWN[:4]), BROWN[:4]),
    "COLMAP": ("# Camera list\n1 OPENCV 640 480 800 810 330 235 -0.3 0.12 0.001 -0.002\n", BROWN[:4]),
    "COLMAP pinhole": ("1 PINHOLE 640 480 800 810 330 235\n", NONE),
}  # fmt: skip


def distorted(straight: np.ndarray, coefficients: list[float]) -> np.ndarray:
    """Pixels with distortion, by OpenCV's projection of rays."""
    rays = np.concatenate([straight, np.ones((*straight.shape[:-1], 1))], axis=-1)
    rays = (rays @ np.linalg.inv(MATRIX).T).reshape(-1, 1, 3)
    factors = np.array(coefficients)
    seen, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), np.array(MATRIX), factors)
    return np.asarray(seen).reshape(straight.shape)


@pytest.mark.parametrize("form", FORMS)
def test_every_form_gives_the_matrix_and_straight_landmarks(
    tmp_path: Path, form: str, caplog: pytest.LogCaptureFixture
) -> None:
    text, coefficients = FORMS[form]
    landmarks = given_camera(tmp_path, text, distorted(POINTS, coefficients))
    assert landmarks.intrinsics is not None
    assert landmarks.intrinsics.tolist() == [MATRIX] * 2
    np.testing.assert_allclose(landmarks.landmarks_2d.numpy(), POINTS, atol=1e-6)
    assert ("lens distortion, which is removed from 42 landmarks" in caplog.text) == any(
        coefficients
    )


def test_fisheye_cameras_have_their_own_model(tmp_path: Path) -> None:
    rays = (np.concatenate([POINTS, np.ones((2, 21, 1))], -1) @ np.linalg.inv(MATRIX).T)[..., :2]
    bent = cv2.fisheye.distortPoints(
        rays.reshape(-1, 1, 2).copy(), np.array(MATRIX), np.array(FISHEYE)
    )
    text = KALIBR.format(model="equidistant", coefficients=FISHEYE)
    landmarks = given_camera(tmp_path, text, np.asarray(bent).reshape(2, 21, 2))
    np.testing.assert_allclose(landmarks.landmarks_2d.numpy(), POINTS, atol=1e-6)


def test_a_fisheye_without_coefficients_bends_rays_still() -> None:
    """θ = r: a ray at 45° is seen at π/4 of the focal length, and belongs at 1."""
    matrix = np.diag([100.0, 100.0, 1.0])
    straight = undistorted(Path("K"), np.array([[100 * np.pi / 4, 0.0]]), matrix, (), fisheye=True)
    np.testing.assert_allclose(straight, [[100, 0]], atol=1e-9)


@given(st.floats(-0.35, 0.6), st.floats(-0.1, 0.2), st.floats(-0.01, 0.01), st.integers(0, 1000))
def test_distortion_is_undone_to_a_millionth_of_a_pixel(
    k1: float, k2: float, p1: float, seed: int
) -> None:
    straight = np.random.default_rng(seed).uniform([60, 60], [600, 420], (21, 2))
    coefficients = [k1, k2, p1, -p1]
    found = undistorted(
        Path("K"), distorted(straight, coefficients), np.array(MATRIX), tuple(coefficients), False
    )
    np.testing.assert_allclose(found, straight, atol=1e-6)


def test_missing_landmarks_stay_missing_and_left_hands_left(tmp_path: Path) -> None:
    points = distorted(POINTS, BROWN)
    points[0, 4] = 0
    landmarks = given_camera(tmp_path, FORMS["K and dist"][0], points, side="left")
    assert landmarks.left.all()
    assert (~landmarks.labelled).nonzero().tolist() == [[0, 4]]
    assert landmarks.landmarks_2d[0, 4].isnan().all()
    np.testing.assert_allclose(landmarks.landmarks_2d[1].numpy(), POINTS[1], atol=1e-6)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"K": MATRIX, "dist": [0.1] * 7}, "7 distortion coefficients; expected 4 or 5 or 8"),
        ({"K": MATRIX, "dist": [-5.0, 0, 0, 0]}, "cannot be removed at .* of 21 landmarks"),
        ({"K": MATRIX, "dist": ["a"]}, "parameter is not a number"),
        ({"K": MATRIX, "dist": [float("nan")]}, "parameter is not finite"),
        ({"K": MATRIX, "model": "mei", "dist": [0.1]}, "distortion model 'mei' is not known"),
        ([[*row, 40.0] for row in MATRIX], r"translation.*K \[R \| t\]"),
        ([{"K": MATRIX}, {"R": MATRIX}], "a camera has the keys .'R'. and no `K`"),
        ({"model": {"nothing": 1}}, "an object with the keys"),
        (7, "expected nine per camera matrix"),
        ("<opencv_storage>", "not complete XML"),
        ("%YAML:1.0\n---\nK: [", "not complete YAML"),
        ("K:\n  - a", "must be 3 × 3 numbers|holds 1 numbers"),
        ("1 OPENCV 640 480 800 810", "OPENCV has 2 parameters, expected 8: fx fy cx cy k1"),
        ("1 FOV 640 480 800 810 320 240 0.1", "no camera of COLMAP's with one of the models"),
        ("1 PINHOLE 640 480 800 810 x 240", "parameter is not a number"),
    ],
)  # fmt: skip
def test_what_is_no_camera_is_refused(tmp_path: Path, content: Any, message: str) -> None:  # noqa: ANN401
    text = content if isinstance(content, str) else json.dumps(content)
    with pytest.raises(ValueError, match=message):
        given_camera(tmp_path, text)


texts = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4)
    | st.dictionaries(
        st.sampled_from(["K", "fx", "fy", "cx", "cy", "dist", "image_size", "data", "model", "w"]), inner
    ),
    max_leaves=12,
)  # fmt: skip


@given(texts | st.lists(st.lists(st.floats(), min_size=3, max_size=3), min_size=3, max_size=3))
def test_any_json_is_a_camera_or_a_value_error(
    tmp_path_factory: pytest.TempPathFactory,
    content: Any,  # noqa: ANN401
) -> None:
    folder = tmp_path_factory.mktemp("camera")
    try:
        landmarks = given_camera(folder, json.dumps(content))
    except ValueError:
        return
    assert landmarks.intrinsics is not None
    assert landmarks.intrinsics.isfinite().all()


def test_cameras_must_be_one_or_as_many_as_hands(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="holds 3 camera matrices for 2 hands"):
        given_camera(tmp_path, json.dumps([{"K": MATRIX}] * 3))
    other = np.array(MATRIX) * [[2], [2], [1]]
    both = given_camera(tmp_path, json.dumps([{"K": MATRIX}, {"K": other.tolist()}])).intrinsics
    assert both is not None
    np.testing.assert_array_equal(both.numpy(), [MATRIX, other])


def test_the_landmarks_given_are_not_changed(tmp_path: Path) -> None:
    hands = read_landmarks(written(tmp_path, POINTS.tolist()))
    (tmp_path / "K").write_text(FORMS["K and dist"][0])
    assert not np.array_equal(with_cameras(hands, tmp_path / "K").landmarks_2d.numpy(), POINTS)
    np.testing.assert_array_equal(hands.landmarks_2d.numpy(), POINTS)
