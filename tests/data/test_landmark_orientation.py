"""Labels in images as stored, and sizes that differ."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from PIL import Image

from hand_recon.camera import project
from hand_recon.data.crop import CropPolicy
from hand_recon.data.images import read_image
from hand_recon.data.landmarks.files import read_landmarks
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.data.landmarks.image_orientation import to_upright
from hand_recon.data.landmarks.image_sizes import stored_size, upright_size
from hand_recon.data.landmarks.splits import LandmarkRecipe, LandmarkSplits

WIDTH, HEIGHT = 160, 100
"""Size of the images as they are stored."""

POINTS = (np.random.default_rng(2).permutation(21)[:, None] * [6.0, 4.0]) + [12.5, 8.5]
"""Middles of stored pixels."""


def stored_image(path: Path, orientation: int, points: np.ndarray = POINTS) -> None:
    """Write an image with a green dot at each point, in pixels as stored, and EXIF's orientation."""
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8)
    for u, v in points:
        cv2.circle(pixels, (int(u), int(v)), 1, (0, 255, 0), -1)
    exif = Image.Exif()
    exif[0x0112] = orientation
    Image.fromarray(pixels).save(path, exif=exif, quality=100, subsampling=0)


def coco(folder: Path, size: tuple[int, int], points: np.ndarray = POINTS, count: int = 3) -> Path:
    """COCO's annotations of one hand for each image, which name this size."""
    images = [
        {"id": n, "file_name": f"{n}.jpg", "width": size[0], "height": size[1]}
        for n in range(count)
    ]
    keypoints = np.concatenate([points, np.full((21, 1), 2)], axis=1).ravel().tolist()
    box = [*points.min(axis=0).tolist(), *np.ptp(points, axis=0).tolist()]
    annotations = [
        {"id": n, "image_id": n, "keypoints": keypoints, "side": "right", "bbox": box}
        for n in range(count)
    ]
    path = folder / "labels.json"
    path.write_text(json.dumps({"images": images, "annotations": annotations}))
    return path


def rotated(orientation: int, points: np.ndarray = POINTS) -> np.ndarray:
    """Points in the upright image: 6 is a quarter turn clockwise, 8 one counter-clockwise."""
    u, v = points[:, 0], points[:, 1]
    turned = {6: (HEIGHT - v, u), 8: (v, WIDTH - u)}[orientation]
    return np.stack(turned, axis=-1)


def samples(path: Path, **recipe: Any) -> Any:  # noqa: ANN401
    options: dict[str, Any] = {"crop": CropPolicy(96, "joints"), "min_side": 5.0} | recipe
    return LandmarkSplits(LandmarkRecipe(path, path, path, **options)).dataset("val")


@pytest.mark.parametrize("orientation", [6, 8])
def test_labels_in_stored_pixels_are_rotated_with_the_image(
    tmp_path: Path, orientation: int, caplog: pytest.LogCaptureFixture
) -> None:
    for number in range(3):
        stored_image(tmp_path / f"{number}.jpg", orientation)
    data = samples(coco(tmp_path, (WIDTH, HEIGHT)))
    assert "3 of 3 hands are in pixels of images as they are stored" in caplog.text
    assert "160 × 100, the upright image is 100 × 160" in caplog.text
    np.testing.assert_allclose(data.hands.landmarks_2d[0], rotated(orientation))
    # The dots are where the labels are, in the image and in the crop.
    image = read_image(tmp_path / "0.jpg")
    assert image is not None
    columns, rows = data.hands.landmarks_2d[0].astype(int).T
    assert (image[rows, columns, 1] > 150).all()
    sample = data[0]
    columns, rows = sample.landmarks_2d.int().T
    assert (sample.image[1, rows, columns] > 80).all()


@pytest.mark.parametrize("orientation", [1, 6, 8])
def test_labels_in_upright_pixels_stay(
    tmp_path: Path, orientation: int, caplog: pytest.LogCaptureFixture
) -> None:
    for number in range(3):
        stored_image(tmp_path / f"{number}.jpg", orientation)
    points = POINTS if orientation == 1 else rotated(orientation)
    size = (WIDTH, HEIGHT) if orientation == 1 else (HEIGHT, WIDTH)
    data = samples(coco(tmp_path, size, points))
    np.testing.assert_array_equal(data.hands.landmarks_2d[0], points)
    assert not caplog.text


def test_a_fit_has_upright_labels_unless_its_camera_is_given(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    for number in range(3):
        stored_image(tmp_path / f"{number}.jpg", 6)
    path = coco(tmp_path, (WIDTH, HEIGHT))
    free = read_landmarks(path)
    np.testing.assert_allclose(free.landmarks_2d[2].numpy(), rotated(6))
    assert free.image_sizes is not None
    assert free.image_sizes.tolist() == [[HEIGHT, WIDTH]] * 3
    (tmp_path / "K.json").write_text("[[150, 0, 80], [0, 150, 50], [0, 0, 1]]")
    caplog.clear()
    given = read_landmarks(path, tmp_path / "K.json")
    np.testing.assert_array_equal(given.landmarks_2d[2].numpy(), POINTS)
    assert "As their cameras are given, the results of a fit stay in that frame" in caplog.text


def test_a_fit_of_labels_of_another_size_is_warned_of(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    for number in range(3):
        stored_image(tmp_path / f"{number}.jpg", 1)
    landmarks = read_landmarks(coco(tmp_path, (2 * WIDTH, 2 * HEIGHT)))
    assert len(landmarks) == 3
    assert "for 3 of 3 hands the file gives another size than the image has" in caplog.text


def test_only_the_rotated_images_of_a_file_are_rotated(tmp_path: Path) -> None:
    for number, orientation in enumerate((1, 6, 8)):
        stored_image(tmp_path / f"{number}.jpg", orientation)
    table = samples(coco(tmp_path, (WIDTH, HEIGHT))).hands
    for row, points in enumerate((POINTS, rotated(6), rotated(8))):
        np.testing.assert_allclose(table.landmarks_2d[row], points)


def test_labels_of_mirrored_images_are_refused(tmp_path: Path) -> None:
    for number in range(3):
        stored_image(tmp_path / f"{number}.jpg", 5)
    with pytest.raises(ValueError, match=r"stored mirrored \(EXIF orientation 5.*label them again"):
        samples(coco(tmp_path, (WIDTH, HEIGHT)))


def test_without_a_size_labels_outside_the_upright_image_name_the_rotation(tmp_path: Path) -> None:
    hands = []
    for number in range(3):
        stored_image(tmp_path / f"{number}.jpg", 6)
        moved = POINTS * [0.2, 1] + [WIDTH - 40, 0]
        hands.append({"landmarks": moved.tolist(), "side": "right", "image": f"{number}.jpg"})
    (tmp_path / "a.json").write_text(json.dumps(hands))
    with pytest.raises(
        ValueError, match=r"3 of 3 hands.*inside the images as these are stored.*`width`"
    ):
        samples(tmp_path / "a.json")


@pytest.mark.parametrize("orientation", [6, 8])
def test_a_camera_and_a_box_are_rotated_with_the_labels(tmp_path: Path, orientation: int) -> None:
    """Rotating the hand about the camera's axis gives the rotated projections with the new matrix."""
    stored_image(tmp_path / "a.jpg", orientation)
    matrix = torch.tensor([[300.0, 0, 70], [0, 310, 45], [0, 0, 1]]).double()
    points = torch.randn(1, 21, 3, generator=torch.Generator().manual_seed(0)).double() * 0.03
    points[..., 2] += 0.5
    seen = project(points, matrix[None])
    landmarks = ImageLandmarks(
        landmarks_2d=seen,
        labelled=torch.ones(1, 21, dtype=torch.bool),
        left=torch.tensor([False]),
        names=("a",),
        intrinsics=matrix[None],
        images=(tmp_path / "a.jpg",),
        hand_boxes=torch.tensor([[10.0, 20, 40, 80]]).double(),
        image_sizes=torch.tensor([[WIDTH, HEIGHT]]).double(),
    )
    upright = to_upright(landmarks, tmp_path)
    x, y, z = points.unbind(-1)
    turned = torch.stack((-y, x, z) if orientation == 6 else (y, -x, z), dim=-1)
    assert upright.intrinsics is not None
    assert (upright.intrinsics[0].tril(-1) == 0).all()
    torch.testing.assert_close(project(turned, upright.intrinsics), upright.landmarks_2d)
    expected = [20, 10, 80, 40] if orientation == 6 else [20, WIDTH - 40, 80, WIDTH - 10]
    assert upright.hand_boxes is not None
    assert upright.hand_boxes.tolist() == [
        [HEIGHT - 80, 10, HEIGHT - 20, 40] if orientation == 6 else expected
    ]
    assert upright.image_sizes is not None
    assert upright.image_sizes.tolist() == [[HEIGHT, WIDTH]]
    # They are in upright pixels now.
    assert torch.equal(to_upright(upright, tmp_path).landmarks_2d, upright.landmarks_2d)


def test_labels_of_another_size_are_refused_or_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    for number in range(3):
        stored_image(tmp_path / f"{number}.jpg", 1)
    path = coco(tmp_path, (2 * WIDTH, 2 * HEIGHT))
    with pytest.raises(
        ValueError, match=r"for 3 of 3 hands .* 320 × 200 in the file and 160 × 100 on"
    ):
        samples(path)
    content = json.loads(path.read_text())
    for image in content["images"][1:]:
        image["width"], image["height"] = WIDTH, HEIGHT
    path.write_text(json.dumps(content))
    assert len(samples(path)) == 3
    assert "for 1 of 3 hands the file gives another size" in caplog.text


@pytest.mark.parametrize("value", [0, -5, None, "160", [1], float("nan")])
def test_a_size_that_is_no_size_is_unknown(tmp_path: Path, value: object) -> None:
    path = coco(tmp_path, (WIDTH, HEIGHT))
    content = json.loads(path.read_text())
    content["images"][0]["width"] = value
    path.write_text(json.dumps(content))
    sizes = read_landmarks(path).image_sizes
    assert sizes is not None
    assert sizes[0].isnan().all()
    assert sizes[1:].tolist() == [[WIDTH, HEIGHT]] * 2


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (POINTS * [0.2, 1] + [WIDTH + 10, 0], "pixels of another image size"),
        (POINTS[:, ::-1] * [1, 0.3] + [0, HEIGHT], "if width and height were exchanged"),
        (POINTS * 20, "pixels of another image size"),
        (POINTS - [0, 90], "pixels of another image size"),
    ],
)
def test_hands_outside_their_images_are_said(
    tmp_path: Path, points: np.ndarray, words: str, caplog: pytest.LogCaptureFixture
) -> None:
    read_landmarks(coco(tmp_path, (WIDTH, HEIGHT), points))
    assert words in caplog.text
    assert "of 3 of 3 hands, most landmarks lie outside of the image" in caplog.text
    caplog.clear()
    read_landmarks(coco(tmp_path, (WIDTH, HEIGHT)))
    assert not caplog.text


def test_the_stored_size_is_read_without_the_pixels(tmp_path: Path) -> None:
    for orientation in range(1, 9):
        stored_image(tmp_path / f"{orientation}.jpg", orientation)
        found = stored_size(tmp_path / f"{orientation}.jpg")
        assert found == (WIDTH, HEIGHT, orientation)
        image = read_image(tmp_path / f"{orientation}.jpg")
        assert image is not None
        assert upright_size(found) == image.shape[1::-1]
    (tmp_path / "text.jpg").write_text("no image")
    assert stored_size(tmp_path / "text.jpg") is None
    assert stored_size(tmp_path / "nothing.jpg") is None
