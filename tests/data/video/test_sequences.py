"""Images as frames: numbered files, folders, patterns and animated images, in order and of one size."""

import logging
from pathlib import Path

import numpy as np
import pytest
from PIL import ExifTags, Image

from hand_recon.data.photos.formats import PhotoError
from hand_recon.data.video.frames import VideoError
from hand_recon.data.video.sequences import (
    Animation,
    is_animation,
    numbered_sequence,
    photo_sequence,
)
from tests.support.video_files import number_of, numbered_image


def save(path: Path, number: int, width: int = 64, height: int = 48) -> None:
    Image.fromarray(numbered_image(number, width, height)).save(path)


def numbers(source: object) -> list[int]:
    return [number_of(frame.pixels) for frame in source]  # type: ignore[attr-defined]


def test_numbered_images_come_by_their_numbers(tmp_path: Path) -> None:
    for number in (9, 10, 11, 8):
        save(tmp_path / f"frame_{number:05d}.png", number)
    for other in ("frame_9.png", "frame_00012.jpg", "xframe_00012.png", "frame_000012.png"):
        (tmp_path / other).write_text("no image")
    with numbered_sequence(str(tmp_path / "frame_%05d.png"), rate=20) as source:
        frames = list(source)
    assert numbers(frames) == [8, 9, 10, 11]
    assert [frame.number for frame in frames] == [0, 1, 2, 3]
    assert [frame.time for frame in frames] == pytest.approx([0.0, 0.05, 0.10, 0.15])
    assert (source.size, source.count_hint, source.rate_hint) == ((64, 48), 4, 20)
    assert source.name == str(tmp_path / "frame_%05d.png")


def test_numbers_without_zeros_in_front_and_beyond_the_width(tmp_path: Path) -> None:
    for number in (1, 2, 10):
        save(tmp_path / f"100% {number}.png", number)
    assert numbers(numbered_sequence(str(tmp_path / "100% %d.png"), 30)) == [1, 2, 10]
    for name, number in (("a98.png", 3), ("a99.png", 4), ("a100.png", 5), ("a0101.png", 6)):
        save(tmp_path / name, number)
    assert numbers(numbered_sequence(str(tmp_path / "a%02d.png"), 30)) == [3, 4, 5]


def test_a_missing_number_leaves_a_gap_in_time_with_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    for number in (1, 2, 5):
        save(tmp_path / f"{number}.png", number)
    frames = list(numbered_sequence(str(tmp_path / "%d.png"), rate=10))
    assert [frame.number for frame in frames] == [0, 1, 2]
    assert [frame.time for frame in frames] == pytest.approx([0.0, 0.1, 0.4])
    assert "lacks 2 of the numbers from 1 to 5; the others keep their times" in caplog.text


def test_a_pattern_without_files_is_an_error(tmp_path: Path) -> None:
    for pattern in (tmp_path / "%05d.png", tmp_path / "nowhere" / "%05d.png"):
        with pytest.raises(
            VideoError, match=r"is called like %05d\.png, with a number in place of %05d"
        ):
            numbered_sequence(str(pattern))


def test_a_folder_and_a_pattern_come_in_natural_order(tmp_path: Path) -> None:
    for number in (2, 10, 1):
        save(tmp_path / f"img{number}.png", number)
    (tmp_path / "notes.txt").write_text("hands")
    for source in (photo_sequence(tmp_path, 8), photo_sequence(str(tmp_path / "*.png"), 8)):
        frames = list(source)
        assert numbers(frames) == [1, 2, 10]
        assert [frame.time for frame in frames] == [0.0, 0.125, 0.25]
    with pytest.raises(PhotoError, match="matches no file"):
        photo_sequence(str(tmp_path / "*.jpg"), 8)


def test_without_a_rate_30_is_assumed_with_a_note(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    save(tmp_path / "1.png", 1)
    save(tmp_path / "2.png", 2)
    with caplog.at_level(logging.INFO):
        source = numbered_sequence(str(tmp_path / "%d.png"))
    assert [frame.time for frame in source] == pytest.approx([0.0, 1 / 30])
    assert "30 are assumed (fps=… for another number)" in caplog.text


def test_the_first_image_of_another_size_is_named(tmp_path: Path) -> None:
    for number in (1, 2, 4):
        save(tmp_path / f"{number}.png", number)
    save(tmp_path / "3.png", 3, width=32)
    frames = photo_sequence(tmp_path, 30).frames()
    assert [next(frames).number, next(frames).number] == [0, 1]
    with pytest.raises(VideoError, match=r"3\.png has 32 × 48 pixels, and .*1\.png has 64 × 48"):
        next(frames)


def test_images_are_upright_and_of_one_size_once_they_are(tmp_path: Path) -> None:
    """A telephone that is held upright stores 64 × 48 with the orientation 6, or 48 × 64 without."""
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = 6
    Image.fromarray(numbered_image(1)).save(tmp_path / "1.jpg", exif=exif)
    Image.fromarray(np.rot90(numbered_image(2), -1)).save(tmp_path / "2.jpg")
    source = photo_sequence(tmp_path, 30)
    assert source.size == (48, 64)
    for frame in source:
        np.testing.assert_allclose(frame.pixels[8, 40].astype(int), (220, 20, 20), atol=12)


def test_images_before_the_first_one_asked_for_are_not_read(tmp_path: Path) -> None:
    for number in (1, 2, 3, 4):
        save(tmp_path / f"{number}.png", number)
    source = photo_sequence(tmp_path, 10)
    (tmp_path / "2.png").write_bytes(b"damaged")
    rest = list(source.frames(2))
    assert [(frame.number, frame.time) for frame in rest] == [(2, 0.2), (3, pytest.approx(0.3))]
    assert numbers(rest) == [3, 4]
    with pytest.raises(PhotoError, match=r"2\.png"):
        list(source)


@pytest.mark.parametrize("suffix", ["gif", "png", "webp"])
def test_an_animated_image_has_the_durations_of_its_frames(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"wave.{suffix}"
    images = [Image.fromarray(numbered_image(number)) for number in range(1, 5)]
    images[0].save(
        path, save_all=True, append_images=images[1:], duration=[40, 100, 70, 200], lossless=True
    )
    assert is_animation(path)
    source = Animation(path)
    frames = list(source)
    assert (source.size, source.count_hint) == ((64, 48), 4)
    assert numbers(frames) == [1, 2, 3, 4]
    assert [frame.time for frame in frames] == pytest.approx([0.0, 0.04, 0.14, 0.21])
    (last,) = source.frames(3)
    assert (last.number, last.time) == (3, frames[3].time)
    np.testing.assert_allclose(frames[1].pixels[4, 4].astype(int), (220, 20, 20), atol=12)


def test_durations_of_zero_are_a_tenth_of_a_second_as_in_browsers(tmp_path: Path) -> None:
    images = [Image.fromarray(numbered_image(number)) for number in range(3)]
    images[0].save(tmp_path / "a.gif", save_all=True, append_images=images[1:], duration=0)
    assert [frame.time for frame in Animation(tmp_path / "a.gif")] == pytest.approx([0.0, 0.1, 0.2])


def test_an_animation_that_was_cut_off_gives_what_it_has(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (6, 48, 64, 3), dtype=np.uint8)
    images = [Image.fromarray(image) for image in noise]
    path = tmp_path / "a.png"
    images[0].save(path, save_all=True, append_images=images[1:], duration=50)
    path.write_bytes(path.read_bytes()[:30_000])
    count = len(list(Animation(path)))
    assert 0 < count < 6
    assert f"a.png ends after {count} of 6 frames" in caplog.text


def test_images_of_one_frame_are_no_animations(tmp_path: Path) -> None:
    save(tmp_path / "a.png", 1)
    save(tmp_path / "a.gif", 1)
    (tmp_path / "b.gif").write_bytes(b"GIF89a")
    for name in ("a.png", "a.gif", "b.gif", "missing.gif"):
        assert not is_animation(tmp_path / name)
    with pytest.raises(VideoError, match="no animated GIF, PNG or WebP; expected several frames"):
        Animation(tmp_path / "a.png")
