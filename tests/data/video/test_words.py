"""Words name videos, streams, cameras and sequences; everything else stays with the photographs."""

import logging
import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from hand_recon.data.video import words
from hand_recon.data.video.files import VideoFile
from hand_recon.data.video.frames import VideoError
from hand_recon.data.video.sequences import Animation, PhotoSequence
from hand_recon.data.video.words import VideoKind, frame_source, video_kind
from tests.support.video_files import numbered_image, write_clip


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Current folder with one file of each kind."""
    monkeypatch.chdir(tmp_path)
    images = [Image.fromarray(numbered_image(number)) for number in (1, 2)]
    write_clip(tmp_path / "clip.mp4", count=2)
    (tmp_path / "clip.mp4").rename(tmp_path / "without_suffix")
    write_clip(tmp_path / "clip.MOV.mp4", count=2).rename(tmp_path / "clip.MOV")
    images[0].save(tmp_path / "photo.jpg")
    images[0].save(tmp_path / "photo.mp4", "JPEG")
    images[0].save(tmp_path / "still.gif")
    images[0].save(tmp_path / "moving.gif", save_all=True, append_images=images[1:])
    (tmp_path / "notes.txt").write_text("hands")
    (tmp_path / "code.ts").write_text("let hands = 2")
    (tmp_path / "frames").mkdir()
    for number, image in enumerate(images):
        image.save(tmp_path / "frames" / f"{number:05d}.png")
    return tmp_path


@pytest.mark.parametrize(
    ("word", "kind"),
    [
        ("clip.MOV", VideoKind.FILE),
        ("without_suffix", VideoKind.FILE),
        ("missing.mp4", VideoKind.FILE),
        ("missing/clip.WEBM", VideoKind.FILE),
        ("code.ts", VideoKind.FILE),
        ("photo.jpg", None),
        ("photo.mp4", None),
        ("still.gif", None),
        ("moving.gif", VideoKind.ANIMATION),
        ("notes.txt", None),
        ("missing.jpg", None),
        ("missing", None),
        ("", None),
        ("a\0b.mp4", None),
        ("x" * 5000, None),
        ("frames", None),
        ("frames/*.png", None),
        ("*.mp4", None),
        ("frames/%05d.png", VideoKind.NUMBERED),
        ("frames/%d_%d.png", None),
        ("webcam", VideoKind.WEBCAM),
        ("webcam:1", VideoKind.WEBCAM),
        ("webcam:", None),
        ("webcam:one", None),
        ("webcams", None),
        ("rtsp://10.0.0.2/stream", VideoKind.WEB),
        ("HTTPS://x.org/a.mp4", VideoKind.WEB),
        ("http://x.org/a_%05d.ts", VideoKind.WEB),
        ("ftp://x.org/a.mp4", VideoKind.FILE),
    ],
)
def test_words_are_told_apart(word: str, kind: VideoKind | None, folder: Path) -> None:
    assert video_kind(word) is kind


def test_folders_and_patterns_are_videos_once_there_is_a_rate(folder: Path) -> None:
    assert video_kind("frames", 25) is VideoKind.SEQUENCE
    assert video_kind("frames/*.png", 25) is VideoKind.SEQUENCE
    assert video_kind("frames/%05d.png", 25) is VideoKind.NUMBERED
    assert video_kind("photo.jpg", 25) is None


def test_files_and_folders_come_before_cameras_addresses_and_patterns(folder: Path) -> None:
    (folder / "webcam").mkdir()
    Image.new("RGB", (4, 4)).save(folder / "webcam:1", "PNG")
    (folder / "http:" / "x.org").mkdir(parents=True)
    write_clip(folder / "a.mp4", count=1).rename(folder / "http:" / "x.org" / "a.mp4")
    Image.new("RGB", (4, 4)).save(folder / "%d.png")
    assert video_kind("webcam") is None
    assert video_kind("webcam", 25) is VideoKind.SEQUENCE
    assert video_kind("webcam:1") is None
    assert video_kind("http://x.org/a.mp4") is VideoKind.FILE
    assert video_kind("%d.png") is None


def test_a_path_is_no_camera_and_no_address(folder: Path) -> None:
    assert video_kind(Path("webcam")) is None
    assert video_kind(Path("http://x.org/a")) is None
    assert video_kind(Path("frames/%05d.png")) is VideoKind.NUMBERED


def test_sources_are_opened_by_their_kind(folder: Path) -> None:
    for word, expected in (
        ("clip.MOV", VideoFile),
        ("without_suffix", VideoFile),
        ("moving.gif", Animation),
        ("frames/%05d.png", PhotoSequence),
    ):
        with frame_source(word) or pytest.fail(word) as source:
            assert isinstance(source, expected)
            assert len(list(source)) == 2
    sequence = frame_source(folder / "frames", 50)
    assert isinstance(sequence, PhotoSequence)
    np.testing.assert_allclose([frame.time for frame in sequence], [0.0, 0.02])
    assert frame_source("photo.jpg") is None
    assert frame_source("nothing") is None


def test_cameras_and_addresses_are_opened_by_number_and_address(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[object] = []
    monkeypatch.setattr(words, "webcam", opened.append)
    monkeypatch.setattr(words, "web_video", opened.append)
    for word in ("webcam", "webcam:12", "rtsp://me:secret@host/a"):
        frame_source(word)
    assert opened == [0, 12, "rtsp://me:secret@host/a"]


def test_what_names_a_video_but_is_none_is_refused_in_words(folder: Path) -> None:
    with pytest.raises(VideoError, match=r"No file at missing\.mp4"):
        frame_source("missing.mp4")
    with pytest.raises(VideoError, match=r"code\.ts is text; expected a video"):
        frame_source("code.ts")


@pytest.mark.parametrize("fps", [0.0, -5.0, float("nan"), float("inf")])
def test_an_impossible_rate_is_refused(fps: float, folder: Path) -> None:
    with pytest.raises(VideoError, match="expected frames per second, such as fps=25"):
        frame_source("frames", fps)


def test_a_rate_for_a_video_changes_nothing_with_a_note(
    folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.INFO):
        source = frame_source("clip.MOV", 50)
    assert source
    assert source.rate_hint == pytest.approx(25)
    assert "the frames of a video file have their own times" in caplog.text


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such pipes")
def test_a_pipe_is_not_opened(folder: Path) -> None:
    os.mkfifo(folder / "pipe.mp4")
    with pytest.raises(VideoError, match="no ordinary file"):
        frame_source("pipe.mp4")
