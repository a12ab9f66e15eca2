"""Files that are no readable photographs are refused by their kind, with advice."""

import base64
import contextlib
import importlib
import io
import os
import tempfile
import warnings
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image, features

from hand_recon.data.photos import photo
from hand_recon.data.photos.formats import PhotoError
from hand_recon.data.photos.photo import read_photo
from tests.support.photos import AVIF, HEIC_ROTATED, corners, near


def test_without_its_package_a_heic_image_is_refused_with_the_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(name: str) -> None:
        raise ModuleNotFoundError(name)

    monkeypatch.setattr(importlib, "import_module", missing)
    file = tmp_path / "hand.heic"
    file.write_bytes(base64.b64decode(HEIC_ROTATED))
    with pytest.raises(PhotoError, match=r'HEIC.*pip install "hand-recon\[heif\]"'):
        read_photo(file)


def test_an_image_above_pillows_own_limit_is_read_without_a_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "hand.png"
    Image.new("1", (40, 40)).save(file)
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 100)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert read_photo(file).size == (40, 40)
    assert Image.MAX_IMAGE_PIXELS == 100


@pytest.mark.parametrize("limit", [1599, 799, 1])
def test_an_image_above_the_limit_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: int
) -> None:
    file = tmp_path / "hand.png"
    Image.new("1", (40, 40)).save(file)
    monkeypatch.setattr(photo, "LARGEST_PHOTO", limit)
    with pytest.raises(PhotoError, match="Scale it down first"):
        read_photo(file)
    monkeypatch.setattr(photo, "LARGEST_PHOTO", 1600)
    assert read_photo(file).size == (40, 40)


def test_the_limit_admits_the_largest_telephone_and_refuses_a_small_bomb(tmp_path: Path) -> None:
    assert photo.LARGEST_PHOTO >= 16_320 * 12_240
    # 90,000 × 90,000 pixels in a header of a few bytes: nothing of it is decoded.
    header = b"\x89PNG\r\n\x1a\n" + _chunk(
        b"IHDR", (90_000).to_bytes(4, "big") * 2 + b"\x08\x02\0\0\0"
    )
    file = tmp_path / "bomb.png"
    file.write_bytes(header + _chunk(b"IDAT", b"") + _chunk(b"IEND", b""))
    with pytest.raises(PhotoError, match="Scale it down first"):
        read_photo(file)


def _chunk(name: bytes, content: bytes) -> bytes:
    checksum = zlib.crc32(name + content).to_bytes(4, "big")
    return len(content).to_bytes(4, "big") + name + content + checksum


@pytest.mark.parametrize("suffix", ["jpg", "png", "webp", "tif", AVIF, "bmp", "gif"])
@pytest.mark.parametrize("share", [0.02, 0.5, 0.9])
def test_a_file_that_is_cut_off_is_refused(tmp_path: Path, suffix: str, share: float) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (64, 64, 3), dtype=np.uint8)
    file = tmp_path / f"hand.{suffix}"
    Image.fromarray(noise).save(file)
    content = file.read_bytes()
    file.write_bytes(content[: max(16, int(share * len(content)))])
    with pytest.raises(PhotoError, match=r"hand\.\w+ is .*(Copy or download it again|Export it)"):
        read_photo(file)


REFUSED = {
    "empty": (b"", "empty .0 bytes.*download it again"),
    "mp4": (b"\0\0\0\x18ftypisom\0\0\2\0isomiso2avc1mp41", "video.*given alone"),
    "mov": (b"\0\0\0\x14ftypqt  \0\0\2\0qt  ", "video"),
    "old mov": (b"\0\0\0\x08wide\0\0\1\0mdat", "video"),
    "mkv": (b"\x1aE\xdf\xa3\x01\0\0\0", "video"),
    "avi": (b"RIFF\0\1\0\0AVI LIST", "video"),
    "svg": (b'<?xml version="1.0"?>\n<svg xmlns="http://www.w3.org/2000/svg"/>', "SVG.*Export"),
    "bare svg": (b"\n <svg></svg>", "SVG"),
    "pdf": (b"%PDF-1.7\n", "PDF.*Export"),
    "html": (b"<!DOCTYPE html><html></html>", "web page"),
    "text": ("Händе\n".encode() * 30, "text"),
    "zip": (b"PK\x03\x04\x14\0", "ZIP.*Unpack"),
    "psd": (b"8BPS\0\1", "Photoshop"),
    "jxl": (b"\xff\x0a\xfa\x1f", "JPEG XL"),
    "wav": (b"RIFF\0\1\0\0WAVEfmt ", "not that of any format"),
    "noise": (bytes(range(128, 256)), "not that of any format"),
    "cr3": (b"\0\0\0\x18ftypcrx \0\0\0\1crx isom", "raw file.*Export"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_photograph_is_refused_by_its_kind(tmp_path: Path, name: str) -> None:
    content, message = REFUSED[name]
    # A wrong suffix does not hide the kind.
    file = tmp_path / "hand.jpg"
    file.write_bytes(content)
    with pytest.raises(PhotoError, match=message):
        read_photo(file)


@pytest.mark.parametrize("suffix", ["dng", "NEF", "arw"])
def test_a_raw_file_is_refused_although_it_is_a_tiff_with_a_thumbnail(
    tmp_path: Path, suffix: str
) -> None:
    file = tmp_path / f"hand.{suffix}"
    Image.fromarray(corners()).save(file, "TIFF")
    with pytest.raises(PhotoError, match="raw file"):
        read_photo(file)


def test_folders_missing_files_pipes_and_impossible_names_are_refused(tmp_path: Path) -> None:
    with pytest.raises(PhotoError, match="is a folder"):
        read_photo(tmp_path)
    with pytest.raises(PhotoError, match="No file at"):
        read_photo(tmp_path / "none.jpg")
    with pytest.raises(PhotoError, match="Cannot open"):
        read_photo(tmp_path / ("long" * 500))
    with pytest.raises(PhotoError, match="zero byte"):
        read_photo(f"{tmp_path}/a\0b.jpg")
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe.jpg")
        with pytest.raises(PhotoError, match="no ordinary file"):
            read_photo(tmp_path / "pipe.jpg")


def test_a_name_that_is_no_text_is_read_and_named_in_errors(tmp_path: Path) -> None:
    file = tmp_path / os.fsdecode(b"h\xe4nd.jpg")
    try:
        Image.fromarray(corners()).save(file, "JPEG")
    except OSError:
        pytest.skip("this file system has only names of text")
    assert near(read_photo(file).pixels, corners())
    file.write_bytes(b"")
    with pytest.raises(PhotoError) as caught:
        read_photo(file)
    assert str(caught.value).encode("utf-8")


FORMATS = [
    "JPEG",
    "PNG",
    "WEBP",
    "TIFF",
    "GIF",
    "BMP",
    *(["AVIF"] if "avif" in features.get_supported() else []),
]


@settings(max_examples=120, deadline=None)
@given(data=st.data())
def test_damage_anywhere_gives_an_image_or_advice_and_nothing_else(data: st.DataObject) -> None:
    suffix = data.draw(st.sampled_from(FORMATS))
    content = io.BytesIO()
    Image.fromarray(corners(12, 16)).save(content, suffix)
    damaged = bytearray(content.getvalue())
    for _ in range(data.draw(st.integers(1, 4))):
        damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "hand"
        file.write_bytes(damaged[: data.draw(st.integers(0, len(damaged)))])
        # Any other error, and any warning, fails the test.
        with contextlib.suppress(PhotoError):
            assert read_photo(file).pixels.dtype == np.uint8
