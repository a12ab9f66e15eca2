"""`hand_recon.reconstruct`: what `predict` does, as a function."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

import hand_recon
from hand_recon.runs.predict_run import predict
from tests.support.photo_folder import CAMERA, QUICK, asked, read


def test_the_python_call_gives_what_the_command_writes(folder: Path, tmp_path: Path) -> None:
    photo = folder / "photos" / "1 two.png"
    settings = ["detector=landmarks", f"detector.landmarks='{folder}/found.json'", *QUICK]
    predict(asked(folder, f"input=['{photo}']", "camera='fov=60'"))
    hands = hand_recon.reconstruct(photo, camera="fov=60", overrides=settings)
    assert json.loads(json.dumps(hands.entries())) == read(folder / "out")
    assert (hands.sides, len(hands)) == (("right", "right"), 2)
    assert hands.vertices.shape == (2, 778, 3)
    assert np.linalg.eigvalsh(hands.records.covariance_3d).min() > 0
    drawing = hands.draw(tmp_path / "over.png")
    assert drawing.shape[0] >= 480
    for name in ("hands.obj", "hands.glb"):
        mesh = trimesh.load_mesh(hands.save(tmp_path / name), process=False)
        assert len(mesh.vertices) == 2 * 778
    assert hand_recon.read_hands(hands.save(tmp_path / "saved.json")).sides == hands.sides
    with pytest.raises(FileExistsError, match="nothing is overwritten"):
        hands.save(tmp_path / "hands.obj")


def test_the_python_call_takes_arrays_and_refuses_what_is_no_image(folder: Path) -> None:
    settings = ["detector=landmarks", f"detector.landmarks='{folder}/found.json'", *QUICK]
    pixels = np.zeros((48, 64, 3), np.uint8)
    for image in (pixels, Image.fromarray(pixels), [pixels, folder / "photos" / "2 none.png"]):
        hands = hand_recon.reconstruct(image, overrides=settings)
        assert len(hands) == 0
        assert hands.vertices.shape == (0, 778, 3)
        assert hands.entries() == []
        with pytest.raises(ValueError, match="No hand was fitted"):
            hands.draw()
    for wrong in (np.zeros((48, 64), np.uint8), np.zeros((48, 64, 3)), "gone.jpg"):
        with pytest.raises(ValueError, match=r"expected height × width × 3|gone\.jpg"):
            hand_recon.reconstruct(wrong, overrides=settings)
    with pytest.raises(ValueError, match="camera has the shape"):
        hand_recon.reconstruct(pixels, camera=np.eye(4), overrides=settings)
    with pytest.raises(
        ValueError, match=r"'output=x' has no effect here: output is an argument of reconst"
    ):
        hand_recon.reconstruct(pixels, overrides=["output=x"])


def test_arrays_of_python_calls_are_checked(folder: Path, tmp_path: Path) -> None:
    settings = ["detector=landmarks", f"detector.landmarks='{folder}/found.json'", *QUICK]
    photo = folder / "photos" / "1 two.png"
    for camera in (np.zeros((3, 3)), np.full((3, 3), np.nan), np.diag([1.0, -1.0, 1.0])):
        with pytest.raises(ValueError, match="camera is no camera matrix"):
            hand_recon.reconstruct(photo, camera=camera, overrides=settings)
    hands = hand_recon.reconstruct(photo, camera=np.array(CAMERA), overrides=settings)
    assert hands.records.intrinsics.tolist() == [CAMERA, CAMERA]
    for name in ("hands.OBJ2", "run.1"):
        with pytest.raises(
            ValueError, match=r"expected \.json, \.obj, \.ply, \.glb or a folder's name"
        ):
            hands.save(tmp_path / name)
    with pytest.raises(ValueError, match="names no kind of image"):
        hands.draw(tmp_path / "hands.bmp")
    hands.draw(tmp_path / "hands.jpg")
    assert (tmp_path / "hands.jpg").read_bytes()[:2] == b"\xff\xd8"


def test_an_image_of_pillow_is_turned_as_its_file_is(tmp_path: Path) -> None:
    pixels = np.zeros((40, 60, 3), np.uint8)
    image = Image.fromarray(pixels)
    exif = image.getexif()
    exif[0x0112] = 6
    image.save(tmp_path / "turned.jpg", exif=exif)
    from hand_recon.runs.reconstruct import _photo

    with Image.open(tmp_path / "turned.jpg") as opened:
        assert _photo(opened).size == _photo(tmp_path / "turned.jpg").size == (40, 60)
