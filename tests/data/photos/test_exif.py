"""EXIF: the orientation is applied once, and the focal length is in pixels of the image or unknown."""

import base64
import io
import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from hand_recon.data.photos.photo import read_photo
from tests.support.photos import AVIF, BLUE, HEIC_ROTATED, RED, corners, exif_of, near, needs_heif


@pytest.mark.parametrize("suffix", ["jpg", "png", "webp", "tif", AVIF])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_every_orientation_is_applied_once(tmp_path: Path, suffix: str, orientation: int) -> None:
    # The inverses of the eight transforms, written out: what a camera stores of the upright image.
    upright = corners()
    turned = upright.transpose(1, 0, 2)
    stored = {
        1: upright, 2: upright[:, ::-1], 3: upright[::-1, ::-1], 4: upright[::-1],
        5: turned, 6: turned[::-1], 7: turned[::-1, ::-1], 8: turned[:, ::-1],
    }[orientation]  # fmt: skip
    file = tmp_path / f"hand.{suffix}"
    Image.fromarray(np.ascontiguousarray(stored)).save(
        file, exif=exif_of(Orientation=orientation).tobytes()
    )
    photo = read_photo(file)
    assert near(photo.pixels, upright)
    assert photo.orientation == orientation
    assert photo.size == (48, 32)
    assert photo.stored_size == ((32, 48) if orientation >= 5 else (48, 32))
    assert photo.pixels.flags.c_contiguous
    assert photo.pixels.flags.writeable


@pytest.mark.parametrize("orientation", [0, 9, 65535])
def test_an_orientation_that_does_not_exist_counts_as_upright(
    tmp_path: Path, orientation: int
) -> None:
    file = tmp_path / "hand.jpg"
    Image.fromarray(corners()).save(file, exif=exif_of(Orientation=orientation).tobytes())
    photo = read_photo(file)
    assert photo.orientation == 1
    assert near(photo.pixels, corners())


@needs_heif
def test_a_heic_image_is_rotated_once_and_has_its_focal_length(tmp_path: Path) -> None:
    file = tmp_path / "IMG_0001.HEIC"
    file.write_bytes(base64.b64decode(HEIC_ROTATED))
    photo = read_photo(file)
    expected = np.full((48, 32, 3), 255, dtype=np.uint8)
    expected[:24, 16:], expected[24:, :16] = RED, BLUE
    assert near(photo.pixels, expected)
    assert (photo.orientation, photo.size, photo.stored_size) == (6, (32, 48), (48, 32))
    assert photo.focal_px == pytest.approx(26 * math.hypot(48, 32) / math.hypot(36, 24))


def test_focal_length_by_the_film_is_a_share_of_the_diagonal(tmp_path: Path) -> None:
    # A frame of 36 × 24 mm in 360 × 240 px has 10 px a millimetre.
    file = tmp_path / "hand.jpg"
    Image.new("RGB", (360, 240)).save(file, exif=exif_of(FocalLengthIn35mmFilm=28).tobytes())
    photo = read_photo(file)
    assert photo.focal_35mm == 28
    assert photo.focal_px == pytest.approx(280)


@pytest.mark.parametrize(("unit", "resolution"), [(2, 2540.0), (3, 1000.0), (None, 2540.0)])
def test_focal_length_by_the_sensor_goes_before_the_film(
    tmp_path: Path, unit: int | None, resolution: float
) -> None:
    # 100 px a millimetre (2,540 an inch, 1,000 a centimetre) times 4.25 mm.
    tags: dict[str, float] = {
        "FocalLength": 4.25, "FocalPlaneXResolution": resolution, "FocalLengthIn35mmFilm": 43,
    }  # fmt: skip
    if unit:
        tags["FocalPlaneResolutionUnit"] = unit
    file = tmp_path / "hand.jpg"
    Image.new("RGB", (360, 240)).save(file, exif=exif_of(**tags).tobytes())
    assert read_photo(file).focal_px == pytest.approx(425)


def test_an_image_scaled_down_has_its_focal_length_scaled(tmp_path: Path) -> None:
    tags = {"FocalLength": 4.25, "FocalPlaneXResolution": 25400.0, "FocalPlaneResolutionUnit": 2}
    size = {"ExifImageWidth": 3600, "ExifImageHeight": 2400}
    file = tmp_path / "hand.jpg"
    Image.new("RGB", (360, 240)).save(file, exif=exif_of(**tags, **size).tobytes())
    assert read_photo(file).focal_px == pytest.approx(4.25 * 1000 / 10)
    # A program that rotates the pixels may leave the recorded size as it was.
    Image.new("RGB", (240, 360)).save(file, exif=exif_of(**tags, **size).tobytes())
    assert read_photo(file).focal_px == pytest.approx(4.25 * 1000 / 10)


@pytest.mark.parametrize("size", [(300, 300), (100, 110), (900, 300)])
def test_an_image_of_a_shape_that_no_camera_has_was_cropped(
    tmp_path: Path, size: tuple[int, int]
) -> None:
    # Programs that crop often rewrite the recorded size, so that it tells nothing.
    exif = exif_of(FocalLengthIn35mmFilm=28, ExifImageWidth=size[0], ExifImageHeight=size[1])
    file = tmp_path / "hand.jpg"
    Image.new("RGB", size).save(file, exif=exif.tobytes())
    photo = read_photo(file)
    assert (photo.focal_35mm, photo.focal_px) == (28, None)
    assert "unlike a camera's images: it was cropped" in str(photo.focal_note)


@pytest.mark.parametrize(
    "size", [(400, 300), (300, 400), (360, 240), (320, 180), (360, 180), (500, 400)]
)
def test_the_shapes_of_cameras_are_not_taken_for_crops(
    tmp_path: Path, size: tuple[int, int]
) -> None:
    file = tmp_path / "hand.jpg"
    Image.new("RGB", size).save(file, exif=exif_of(FocalLengthIn35mmFilm=28).tobytes())
    photo = read_photo(file)
    assert photo.focal_px == pytest.approx(28 * math.hypot(*size) / math.hypot(36, 24))
    assert photo.focal_note is None


@pytest.mark.parametrize(("film", "known"), [(43, True), (50, True), (28, False), (90, False)])
def test_lens_and_sensor_have_to_agree(tmp_path: Path, film: int, known: bool) -> None:
    # By the sensor 425 px; by the film's diagonal 10 px a millimetre.
    tags = {"FocalLength": 4.25, "FocalPlaneXResolution": 2540.0, "FocalLengthIn35mmFilm": film}
    file = tmp_path / "hand.jpg"
    Image.new("RGB", (360, 240)).save(file, exif=exif_of(**tags).tobytes())
    photo = read_photo(file)
    assert (photo.focal_px is not None) == known
    assert ("disagree" in str(photo.focal_note)) == (not known)


def test_an_image_of_another_shape_than_recorded_was_cropped(tmp_path: Path) -> None:
    exif = exif_of(FocalLengthIn35mmFilm=28, ExifImageWidth=4000, ExifImageHeight=3000)
    file = tmp_path / "hand.jpg"
    Image.new("RGB", (300, 300)).save(file, exif=exif.tobytes())
    photo = read_photo(file)
    assert (photo.focal_35mm, photo.focal_px) == (28, None)
    assert "cropped" in str(photo.focal_note)


@pytest.mark.parametrize(
    "tags",
    [
        {"FocalLengthIn35mmFilm": 0},
        {"FocalLengthIn35mmFilm": 60000},
        {"FocalLength": 0.0, "FocalPlaneXResolution": 2540.0},
        {"FocalLength": 4.25, "FocalPlaneXResolution": 0.0},
        {"FocalLength": 4.25},
        {"FocalLength": 4.25, "FocalPlaneXResolution": 2540.0, "FocalPlaneResolutionUnit": 9},
        {"FocalLength": 4.25, "FocalPlaneXResolution": 0.01},
    ],
)
def test_a_focal_length_that_cannot_be_is_none(tmp_path: Path, tags: dict[str, float]) -> None:
    file = tmp_path / "hand.jpg"
    Image.new("RGB", (360, 240)).save(file, exif=exif_of(**tags).tobytes())
    assert read_photo(file).focal_px is None


def test_damaged_metadata_do_not_hide_the_image(tmp_path: Path) -> None:
    content = io.BytesIO()
    exif = exif_of(Orientation=6, FocalLengthIn35mmFilm=28).tobytes()
    Image.fromarray(corners()).save(content, "JPEG", exif=exif)
    whole = content.getvalue()
    start = whole.index(b"Exif\0\0") + 6
    for position in range(start, start + len(exif) - 6, 3):
        file = tmp_path / "hand.jpg"
        file.write_bytes(whole[:position] + b"\xff\xff" + whole[position + 2 :])
        assert read_photo(file).pixels.shape in ((32, 48, 3), (48, 32, 3))
