"""Bombs are refused by what they announce, before anything is unpacked or decoded; limits can be changed."""

import io
import struct
import subprocess
import sys
import zipfile
import zlib
from pathlib import Path
from typing import Final

import numpy as np
import pytest
import torch
from PIL import Image

from hand_recon.data.images import decode_image
from hand_recon.data.photos.formats import PhotoError
from hand_recon.data.photos.photo import read_photo
from hand_recon.data.video.files import VideoFile
from hand_recon.data.video.frames import VideoError
from hand_recon.reading.archives import load_array, load_arrays, refuse_packed
from hand_recon.reading.image_header import announced_pixels
from hand_recon.reading.limits import Limits
from hand_recon.reading.text import parse_yaml
from tests.support.video_files import FakeCapture

SIDE: Final = 60_000


def _png() -> bytes:
    head = b"IHDR" + struct.pack(">IIBBBBB", SIDE, SIDE, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + head + struct.pack(">I", zlib.crc32(head))


def _jpeg() -> bytes:
    stream = io.BytesIO()
    Image.new("RGB", (16, 16)).save(stream, "JPEG")
    content = bytearray(stream.getvalue())
    place = content.index(b"\xff\xc0")
    content[place + 5 : place + 9] = struct.pack(">HH", SIDE, SIDE)
    return bytes(content)


def _jpeg_after(piece: bytes) -> bytes:
    """A JPEG with a piece before its frame's marker, of which libjpeg takes no notice."""
    content = _jpeg()
    place = content.index(b"\xff\xc0")
    return content[:place] + piece + content[place:]


def _tiff() -> bytes:
    tags = [(256, SIDE), (257, SIDE), (258, 8), (259, 1), (262, 1), (273, 8), (277, 1), (279, 8)]
    entries = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in tags)
    return b"II*\0" + struct.pack("<IH", 8, len(tags)) + entries + bytes(4)


def _webp() -> bytes:
    stream = io.BytesIO()
    Image.new("RGB", (16, 16)).save(stream, "WEBP", lossless=True)
    content = bytearray(stream.getvalue())
    place = content.index(b"VP8L") + 9
    # 16,384 is the most that the format can announce.
    content[place : place + 4] = struct.pack("<I", 16_383 | 16_383 << 14)
    return bytes(content)


BOMBS: Final = {
    "png": _png(), "jpg": _jpeg(), "tif": _tiff(), "webp": _webp(),
    "extra.jpg": _jpeg_after(b"x"), "marker.jpg": _jpeg_after(b"\xff\x01"),
}  # fmt: skip
"""Contents of files whose headers announce too many pixels, by suffix."""


@pytest.mark.parametrize("suffix", BOMBS)
def test_an_image_that_announces_too_many_pixels_is_refused_by_its_header(
    tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = BOMBS[suffix]
    file = tmp_path / f"bomb.{suffix}"
    file.write_bytes(content)
    decoded: list[object] = []
    monkeypatch.setattr("PIL.ImageFile.ImageFile.load", lambda image: decoded.append(image))
    monkeypatch.setattr("cv2.imdecode", lambda *words: decoded.append(words))
    with pytest.raises(PhotoError, match=r"bomb.*Scale it down|bomb.*Copy or download"):
        read_photo(file)
    assert decode_image(content) is None
    assert not decoded


@pytest.mark.parametrize("form", ["PNG", "JPEG", "WEBP", "TIFF", "BMP", "GIF"])
def test_the_pixels_of_a_valid_image_are_announced(form: str) -> None:
    stream = io.BytesIO()
    Image.new("RGB", (31, 17)).save(stream, form)
    assert announced_pixels(stream.getvalue()) == 31 * 17


PIECES: Final = {
    "extraneous bytes": b"abc", "stuffed FF": b"\xff\x00", "TEM": b"\xff\x01", "RST3": b"\xff\xd3",
    "filling": b"\xff\xff\xff", "a comment": b"\xff\xfe\x00\x0b\xff\xc0\x00\x11\x08\x00\x01\x00\x01",
    "a length of 0": b"\xff\xfe\x00\x00",
}  # fmt: skip
"""Pieces before a frame's marker that libjpeg skips."""


@pytest.mark.parametrize("piece", PIECES)
def test_the_pixels_of_a_jpeg_are_those_that_libjpeg_decodes(piece: str) -> None:
    stream = io.BytesIO()
    Image.new("RGB", (31, 17)).save(stream, "JPEG")
    content = stream.getvalue()
    place = content.index(b"\xff\xc0")
    changed = content[:place] + PIECES[piece] + content[place:]
    decoded = decode_image(changed)
    assert decoded is not None
    assert decoded.shape == (17, 31, 3)
    assert announced_pixels(changed) == 31 * 17


@pytest.mark.parametrize("ends", [b"\xff\xd8", b"\xff\xd9", b"\xff\xda\x00\x08", b""])
def test_a_jpeg_whose_size_is_not_known_is_not_decoded(
    ends: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    decoded: list[object] = []
    monkeypatch.setattr("cv2.imdecode", lambda *words: decoded.append(words))
    content = _jpeg()
    frame = content.index(b"\xff\xc0")
    changed = content[:frame] + ends + content[frame:] if ends else content[: frame + 8]
    assert announced_pixels(changed) is None
    assert decode_image(changed + b"\xff\xd9") is None
    assert not decoded


def test_a_video_is_refused_by_the_size_of_its_frames() -> None:
    size = {"CAP_PROP_FRAME_WIDTH": 60_000.0, "CAP_PROP_FRAME_HEIGHT": 60_000.0}
    capture = FakeCapture([0.0], size)
    with pytest.raises(VideoError, match="3,600,000,000 pixels a frame; expected at most"):
        VideoFile("bomb.mp4", "bomb.mp4", lambda address: capture)
    assert not capture.retrieved


def _archive(*members: tuple[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method) as archive:
        for name, content in members:
            archive.writestr(name, content)
    return stream.getvalue()


def _npy(array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def test_arrays_that_unpack_to_more_than_the_limit_are_not_unpacked(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    content = _archive(("a.npy", _npy(np.zeros(100_000))), ("b.npy", _npy(np.zeros(10))))
    assert len(content) < 3000
    monkeypatch.setattr("hand_recon.reading.archives.LIMITS", Limits(array_bytes=100_000))
    with pytest.raises(
        ValueError, match=r"bomb\.npz has 800,\d+ bytes of arrays; expected at most"
    ):
        load_arrays(io.BytesIO(content), "bomb.npz")
    assert load_arrays(io.BytesIO(content), "bomb.npz", ["b"])["b"].shape == (10,)


def test_a_header_that_announces_a_terabyte_asks_for_no_memory() -> None:
    head = b"{'descr': '<f8', 'fortran_order': False, 'shape': (100000000000, 21, 2), }"
    content = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head) + 1) + head + b"\n" + bytes(80)
    with pytest.raises(
        ValueError, match=r"a\.npy is not a whole .* announces 33600000000000 bytes"
    ):
        load_array(content, "a.npy")


def test_a_packed_checkpoint_is_refused_and_a_plain_one_is_not(tmp_path: Path) -> None:
    torch.save({"a": torch.zeros(50_000)}, tmp_path / "plain.ckpt")
    refuse_packed(tmp_path / "plain.ckpt")
    with zipfile.ZipFile(tmp_path / "plain.ckpt") as archive:
        members = [(one.filename, archive.read(one)) for one in archive.infolist()]
    (tmp_path / "packed.ckpt").write_bytes(_archive(*members))
    assert (tmp_path / "packed.ckpt").stat().st_size < 10_000
    with pytest.raises(ValueError, match=r"packed\.ckpt is packed: it unpacks to 2\d\d,\d+ bytes"):
        refuse_packed(tmp_path / "packed.ckpt")


def test_yaml_that_refers_to_itself_a_thousand_million_times_is_counted_and_not_written_out() -> (
    None
):
    levels = ["a0: &a0 [1, 1]", *(f"a{n}: &a{n} [*a{n - 1}, *a{n - 1}]" for n in range(1, 30))]
    with pytest.raises(ValueError, match=r"a\.yaml has [\d,]+ values, references included"):
        parse_yaml("\n".join(levels), "a.yaml")
    with pytest.raises(ValueError, match="holds itself"):
        parse_yaml("a: &a [*a]", "a.yaml")
    with pytest.raises(ValueError, match="the key 'a' is there twice"):
        parse_yaml("a: 1\na: 2", "a.yaml")


def test_limits_are_read_from_text() -> None:
    assert Limits.from_text("") == Limits()
    assert Limits.from_text(" photo_pixels=4e8, array_bytes=5 ") == Limits(
        photo_pixels=400_000_000, array_bytes=5
    )


@pytest.mark.parametrize("text", ["photo_pixels", "pixels=3", "photo_pixels=0", "photo_pixels=nan"])
def test_limits_that_mean_nothing_are_refused(text: str) -> None:
    with pytest.raises(ValueError, match=f"Found '{text}' in HAND_RECON_LIMITS; expected <name>="):
        Limits.from_text(text)


@pytest.mark.slow
def test_the_environment_changes_the_limits() -> None:
    words = [
        sys.executable,
        "-c",
        "from hand_recon.reading.limits import LIMITS; print(LIMITS.frame_pixels)",
    ]
    done = subprocess.run(  # noqa: S603
        words, env={"HAND_RECON_LIMITS": "frame_pixels=9"}, capture_output=True, text=True, check=True,
        cwd=Path(__file__).resolve().parents[2],
    )  # fmt: skip
    assert done.stdout.strip() == "9"
