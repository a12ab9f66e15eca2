"""Photographs of every common format and mode become the same pixels."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image, ImageCms

from hand_recon.data.photos.formats import PhotoError
from hand_recon.data.photos.photo import read_photo
from tests.support.photos import AVIF, BLUE, GREEN, RED, corners, exif_of, near


@pytest.mark.parametrize("suffix", ["jpg", "png", "webp", "tif", AVIF, "bmp", "gif", "ppm", "jp2"])
def test_every_format_gives_the_same_pixels(tmp_path: Path, suffix: str) -> None:
    file = tmp_path / f"hand.{suffix}"
    Image.fromarray(corners()).save(file)
    photo = read_photo(str(file))
    assert near(photo.pixels, corners())
    assert photo.size == photo.stored_size == (48, 32)
    assert (photo.orientation, photo.focal_px, photo.notes, photo.path) == (1, None, (), file)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_jpeg_is_rotated_as_opencv_rotates_it(tmp_path: Path, orientation: int) -> None:
    file = tmp_path / "hand.jpg"
    Image.fromarray(corners()).save(file, exif=exif_of(Orientation=orientation).tobytes())
    by_opencv = cv2.imread(str(file), cv2.IMREAD_COLOR_RGB)
    assert by_opencv is not None
    assert near(read_photo(file).pixels, np.asarray(by_opencv))


@pytest.mark.parametrize(("format_", "suffix"), [("PNG", "jpg"), ("JPEG", "png"), ("WEBP", "")])
def test_the_content_decides_and_not_the_suffix(tmp_path: Path, format_: str, suffix: str) -> None:
    file = tmp_path / f"hand.{suffix}"
    Image.fromarray(corners()).save(file, format_)
    assert near(read_photo(file).pixels, corners())


def test_transparent_parts_become_white(tmp_path: Path) -> None:
    pixels = np.zeros((2, 2, 4), dtype=np.uint8)
    pixels[0, 0], pixels[0, 1], pixels[1, 0] = (*RED, 255), (0, 0, 0, 0), (0, 0, 0, 128)
    file = tmp_path / "hand.png"
    Image.fromarray(pixels).save(file)
    photo = read_photo(file)
    assert photo.pixels[0].tolist() == [list(RED), [255, 255, 255]]
    # 255 − 128: half black on white.
    assert np.abs(photo.pixels[1, 0].astype(int) - 127).max() <= 1
    assert "white" in " ".join(photo.notes)


def test_an_opaque_alpha_channel_changes_nothing_and_is_not_mentioned(tmp_path: Path) -> None:
    file = tmp_path / "hand.png"
    Image.fromarray(corners()).convert("RGBA").save(file)
    photo = read_photo(file)
    assert (photo.pixels == corners()).all()
    assert photo.notes == ()


@pytest.mark.parametrize("mode", ["P", "L", "1", "RGB"])
def test_a_transparent_colour_becomes_white(tmp_path: Path, mode: str) -> None:
    black = Image.new(mode, (4, 4), 0)
    file = tmp_path / "hand.png"
    black.save(file, transparency=(0, 0, 0) if mode == "RGB" else 0)
    assert (read_photo(file).pixels == 255).all()


@pytest.mark.parametrize("mode", ["L", "1", "P", "LA", "I;16"])
@pytest.mark.parametrize("suffix", ["png", "tif"])
def test_grey_palette_and_one_bit_keep_black_and_white(
    tmp_path: Path, mode: str, suffix: str
) -> None:
    grey = np.zeros((4, 6), dtype=np.uint8)
    grey[:, 3:] = 255
    file = tmp_path / f"hand.{suffix}"
    if mode == "I;16":
        Image.fromarray(grey.astype(np.uint16) * 257).save(file)
    else:
        Image.fromarray(grey).convert(mode).save(file)
    assert (read_photo(file).pixels == grey[..., None]).all()


@pytest.mark.parametrize("suffix", ["png", "tif"])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_sixteen_bits_are_scaled_to_eight(tmp_path: Path, suffix: str, channels: int) -> None:
    # OpenCV writes what Pillow cannot: colour of 16 bits. 257 · v is v in 8 bits.
    levels = np.arange(256, dtype=np.uint16).reshape(16, 16) * 257
    stored = np.stack([levels] * channels, axis=-1)
    if channels == 4:
        stored[..., 3] = 65535
    file = tmp_path / f"hand.{suffix}"
    assert cv2.imwrite(str(file), stored)
    grey = (levels // 257).astype(int)
    assert np.abs(read_photo(file).pixels.astype(int) - grey[..., None]).max() <= 1


def test_numbers_of_32_bits_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "depth.tif"
    Image.fromarray(np.ones((4, 4), dtype=np.float32)).save(file)
    with pytest.raises(PhotoError, match=r"floating-point numbers; expected.*8-bit JPEG or PNG"):
        read_photo(file)


@pytest.mark.parametrize("suffix", ["jpg", "tif"])
def test_cmyk_has_its_colours_and_not_their_negative(tmp_path: Path, suffix: str) -> None:
    file = tmp_path / f"hand.{suffix}"
    Image.fromarray(corners()).convert("CMYK").save(file)
    assert near(read_photo(file).pixels, corners(), tolerance=16)


def test_a_wide_profile_is_converted_to_srgb(tmp_path: Path) -> None:
    # In this profile red and blue are exchanged, so that a missing conversion is seen at once.
    profile = bytearray(ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes())
    red, blue = profile.index(b"rXYZ"), profile.index(b"bXYZ")
    profile[red : red + 4], profile[blue : blue + 4] = b"bXYZ", b"rXYZ"
    name = profile.index("sRGB".encode("utf-16-be"))
    profile[name : name + 8] = "Mine".encode("utf-16-be")
    file = tmp_path / "hand.png"
    Image.fromarray(corners()).save(file, icc_profile=bytes(profile))
    photo = read_photo(file)
    assert np.abs(photo.pixels[2, 2].astype(int) - np.array(RED[::-1])).max() <= 3
    assert photo.notes == ()


@pytest.mark.parametrize("profile", [b"no profile", b"\0" * 200])
def test_a_damaged_profile_is_ignored_with_a_note(tmp_path: Path, profile: bytes) -> None:
    file = tmp_path / "hand.png"
    Image.fromarray(corners()).save(file, icc_profile=profile)
    photo = read_photo(file)
    assert (photo.pixels == corners()).all()
    assert "profile" in photo.notes[0]


def test_an_srgb_profile_is_not_mentioned(tmp_path: Path) -> None:
    file = tmp_path / "hand.png"
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    Image.fromarray(corners()).save(file, icc_profile=profile)
    assert read_photo(file).notes == ()


@pytest.mark.parametrize("suffix", ["gif", "tif", "webp", "png"])
def test_the_first_of_several_images_is_read_and_the_others_are_mentioned(
    tmp_path: Path, suffix: str
) -> None:
    file = tmp_path / f"hand.{suffix}"
    others = [Image.new("RGB", (48, 32), BLUE), Image.new("RGB", (48, 32), GREEN)]
    Image.fromarray(corners()).save(file, save_all=True, append_images=others)
    photo = read_photo(file)
    assert near(photo.pixels, corners(), tolerance=20)
    assert "3" in photo.notes[0]
    assert "the first is read" in photo.notes[0]


def test_a_jpeg_with_a_preview_is_an_ordinary_photograph(tmp_path: Path) -> None:
    file = tmp_path / "hand.jpg"
    Image.fromarray(corners()).save(
        file, "MPO", save_all=True, append_images=[Image.new("RGB", (12, 8))]
    )
    photo = read_photo(file)
    assert near(photo.pixels, corners())
    assert photo.notes == ()


@pytest.mark.parametrize("size", [(1, 1), (1, 500), (500, 1)])
def test_the_smallest_images_are_read(tmp_path: Path, size: tuple[int, int]) -> None:
    file = tmp_path / "hand.png"
    Image.new("RGB", size, RED).save(file)
    photo = read_photo(file)
    assert photo.size == size
    assert (photo.pixels == RED).all()


@pytest.mark.parametrize(
    "name", ["Hände 手 🖐 #1%20?.jpg", "-o=1,[a]{b}.jpg", "'quote\".jpg", " .jpg"]
)
def test_names_of_any_letters_are_read(tmp_path: Path, name: str) -> None:
    file = tmp_path / name
    Image.fromarray(corners()).save(file)
    assert near(read_photo(file).pixels, corners())
