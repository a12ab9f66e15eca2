"""Video files give every frame once, upright, with its own time; what is wrong with a file is said."""

import logging
import os
import sys
import wave
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, features

from hand_recon.data.video.files import VideoFile, video_file
from hand_recon.data.video.frames import VideoError
from tests.support.video_files import (
    FakeCapture,
    cut,
    number_of,
    numbered_image,
    rotate,
    set_durations,
    write_clip,
)


@pytest.mark.parametrize("suffix", [".mp4", ".avi", ".webm", ".mkv"])
def test_every_frame_comes_once_with_its_number_time_and_colours(
    suffix: str, tmp_path: Path
) -> None:
    path = write_clip(tmp_path / f"clip{suffix}", count=12, fps=25)
    with video_file(path) as video:
        frames = list(video)
    assert (video.size, video.count_hint, video.name) == ((64, 48), 12, str(path))
    assert video.rate_hint == pytest.approx(25)
    assert [frame.number for frame in frames] == list(range(12))
    assert [number_of(frame.pixels) for frame in frames] == list(range(12))
    # WebM and Matroska have whole milliseconds.
    np.testing.assert_allclose([frame.time for frame in frames], np.arange(12) / 25, atol=6e-4)
    # Red stays red: RGB, not OpenCV's BGR.
    np.testing.assert_allclose(
        frames[5].pixels[6:18, 8:24].mean((0, 1)), numbered_image(5)[10, 10], atol=25
    )


def test_frames_keep_their_own_times_when_the_rate_varies(tmp_path: Path) -> None:
    path = write_clip(tmp_path / "phone.mp4", count=6)
    durations = [0.04, 0.2, 0.04, 0.08, 0.04, 0.04]
    set_durations(path, durations)
    times = [frame.time for frame in video_file(path)]
    np.testing.assert_allclose(times, [0.0, 0.04, 0.24, 0.28, 0.36, 0.40], atol=1e-6)


@pytest.mark.parametrize("degrees", [0, 90, 180, 270])
def test_the_rotation_in_the_head_is_applied(degrees: int, tmp_path: Path) -> None:
    path = write_clip(tmp_path / "phone.mp4", count=2)
    rotate(path, degrees)
    video = video_file(path)
    upright = np.rot90(numbered_image(1), -degrees // 90)
    shown = list(video)[1].pixels
    assert video.size == (upright.shape[1], upright.shape[0])
    height, width, _ = upright.shape
    for y in (height // 4, height * 3 // 4):
        for x in (width // 4, width * 3 // 4):
            np.testing.assert_allclose(shown[y, x].astype(int), upright[y, x], atol=25)


def test_skipped_frames_are_not_converted_and_the_rest_is_as_without(tmp_path: Path) -> None:
    path = write_clip(tmp_path / "clip.mp4", count=8)
    video = video_file(path)
    whole, rest = list(video), list(video.frames(5))
    assert [frame.number for frame in rest] == [5, 6, 7]
    for late, all_along in zip(rest, whole[5:], strict=True):
        assert late.time == all_along.time
        np.testing.assert_array_equal(late.pixels, all_along.pixels)
    assert list(video.frames(8)) == []
    captures = [FakeCapture([0.0, 0.1, 0.2, 0.3]) for _ in range(2)]
    waiting = iter(captures)
    fake = VideoFile("clip", "clip", lambda _: next(waiting))
    assert [frame.number for frame in fake.frames(2)] == [2, 3]
    assert captures[1].retrieved == [2, 3]


def test_frames_belong_to_their_owner(tmp_path: Path) -> None:
    frames = iter(video_file(write_clip(tmp_path / "clip.avi", count=3)))
    first = next(frames).pixels
    copy = first.copy()
    next(frames)
    np.testing.assert_array_equal(first, copy)
    assert first.flags.writeable
    assert first.flags.c_contiguous


@pytest.mark.parametrize("suffix", [".webm", ".avi"])
def test_a_file_that_was_cut_off_gives_what_it_has_with_a_warning(
    suffix: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = write_clip(tmp_path / f"cut{suffix}", count=30)
    cut(path, 0.6)
    count = len(list(video_file(path)))
    assert 0 < count < 27
    assert f"cut{suffix} ends after {count} frames; its head promises 30" in caplog.text


def test_times_that_are_missing_are_repaired_with_a_note(caplog: pytest.LogCaptureFixture) -> None:
    def opener(_: str | int) -> FakeCapture:
        return FakeCapture([0.0] * 4, {"CAP_PROP_FPS": 20.0})

    with caplog.at_level(logging.INFO):
        frames = list(VideoFile("raw.h264", "raw.h264", opener))
    assert [frame.time for frame in frames] == pytest.approx([0.0, 0.05, 0.10, 0.15])
    assert "raw.h264 has 3 frames without a time" in caplog.text
    assert "50.0 ms after" in caplog.text


def test_times_are_relative_to_the_first_frame_and_30_frames_a_second_are_assumed() -> None:
    def opener(_: str | int) -> FakeCapture:
        return FakeCapture(
            [1.4, 1.5, 0.0], {"CAP_PROP_FPS": 90_000.0, "CAP_PROP_FRAME_COUNT": -1.0}
        )

    video = VideoFile("clip.ts", "clip.ts", opener)
    assert (video.rate_hint, video.count_hint) == (None, None)
    assert [frame.time for frame in video] == pytest.approx([0.0, 0.1, 0.1 + 1 / 30])


def test_squeezed_pixels_are_warned_of(caplog: pytest.LogCaptureFixture) -> None:
    properties = {"CAP_PROP_SAR_NUM": 16.0, "CAP_PROP_SAR_DEN": 11.0}
    VideoFile("dv.avi", "dv.avi", lambda _: FakeCapture([0.0], properties))
    assert "1.45 times as wide as high" in caplog.text


def test_every_capture_is_released(tmp_path: Path) -> None:
    captures: list[FakeCapture] = []

    def opener(_: str | int) -> FakeCapture:
        captures.append(FakeCapture([0.0, 0.1, 0.2]))
        return captures[-1]

    video = VideoFile("clip", "clip", opener)
    unfinished = video.frames()
    next(unfinished)
    unfinished.close()  # type: ignore[attr-defined]
    list(video)
    assert [capture.released for capture in captures] == [1, 1, 1]


def without_letters(folder: Path) -> Path:
    return folder / os.fsdecode(b"clip\xff.mp4")


@pytest.mark.skipif(sys.platform != "linux", reason="other systems allow no such names")
def test_a_name_of_bytes_that_are_no_letters_is_refused_since_opencv_crashes(
    tmp_path: Path,
) -> None:
    path = write_clip(tmp_path / "clip.mp4", count=2).rename(without_letters(tmp_path))
    with pytest.raises(VideoError, match=r"no letters, which OpenCV cannot open\. Rename"):
        video_file(path)


def test_names_that_ffmpeg_would_take_for_something_else_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("a:b.mp4", "50%03d.mp4", "hände [2].mp4", "-i.mp4"):
        write_clip(tmp_path / name, count=2)
        assert len(list(video_file(name))) == 2


def test_what_is_no_video_is_named(tmp_path: Path) -> None:
    def refusal(name: str, content: bytes) -> str:
        (tmp_path / name).write_bytes(content)
        with pytest.raises(VideoError) as caught:
            video_file(tmp_path / name)
        return str(caught.value)

    assert "is text; expected a video" in refusal("notes.mp4", b"hands\n" * 30)
    assert "a web page, perhaps saved in place of" in refusal("page.mp4", b"<html><body></body>")
    assert "is empty (0 bytes)" in refusal("empty.mp4", b"")
    noise = np.random.default_rng(0).integers(0, 256, 5000, dtype=np.uint8).tobytes()
    assert "has no video track that can be read" in refusal(
        "noise.mp4", b"\xfe\xfd\xfc\xfb" + noise
    )
    with pytest.raises(VideoError, match=r"No file at .*missing.mp4"):
        video_file(tmp_path / "missing.mp4")
    with pytest.raises(VideoError, match="is a folder; expected a video"):
        video_file(tmp_path)


def test_sound_alone_has_no_video_track(tmp_path: Path) -> None:
    with wave.open(str(tmp_path / "song.mp4"), "wb") as sound:
        sound.setnchannels(1)
        sound.setsampwidth(2)
        sound.setframerate(8000)
        sound.writeframes(bytes(16_000))
    recording = write_clip(tmp_path / "recording.mp4", count=2)
    recording.write_bytes(recording.read_bytes().replace(b"vide", b"soun"))
    for path in (tmp_path / "song.mp4", recording):
        with pytest.raises(VideoError, match="no video track that can be read; it may hold sound"):
            video_file(path)


def test_a_recording_that_was_broken_off_lacks_its_index(tmp_path: Path) -> None:
    path = write_clip(tmp_path / "recording.mp4", count=10)
    cut(path, 0.5)
    with pytest.raises(VideoError, match=r"was cut off: it lacks the index \(moov\)"):
        video_file(path)


@pytest.mark.skipif("avif" not in features.get_supported(), reason="this Pillow has no AVIF")
def test_av1_is_named_with_the_cure(tmp_path: Path) -> None:
    """An animated AVIF is an AV1 video in an MP4; OpenCV's wheels open it and decode nothing."""
    images = [Image.fromarray(numbered_image(number)) for number in range(3)]
    images[0].save(
        tmp_path / "a.avif", save_all=True, append_images=images[1:], duration=100, speed=10
    )
    path = (tmp_path / "a.avif").rename(tmp_path / "screen.mp4")
    message = ""
    try:
        video_file(path)
    except VideoError as error:
        message = str(error)
    if not message:
        pytest.skip("this OpenCV decodes AV1")
    assert "is an AV1 video, which this OpenCV does not decode" in message
    assert "by ffmpeg -i" in message


def test_a_video_without_a_frame_names_its_codec() -> None:
    tag = float(int.from_bytes(b"XYZ1", "little"))
    with pytest.raises(VideoError, match=r"codec xyz1\), but no frame of it can be decoded"):
        VideoFile("odd.avi", "odd.avi", lambda _: FakeCapture([], {"CAP_PROP_FOURCC": tag}))
