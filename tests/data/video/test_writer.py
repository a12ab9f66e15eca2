"""Written videos hold each frame at the tick nearest to its time, and overwrite nothing."""

import logging
import math
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hand_recon.data.video.files import video_file
from hand_recon.data.video.frames import Frame, VideoError
from hand_recon.data.video.writer import VideoWriter
from tests.support.video_files import number_of, numbered_image


def written(path: Path, times: Sequence[float], fps: float = 25.0, **size: int) -> list[Frame]:
    """Frames of a file of numbered images with these times, read back."""
    with VideoWriter(path, fps) as video:
        for number, time in enumerate(times):
            video.write(numbered_image(number, **size), time)
    assert path.parent.exists()
    assert [found.name for found in path.parent.iterdir()] == [path.name]
    frames = list(video_file(path))
    assert len(frames) == video.count
    return frames


@pytest.mark.parametrize("suffix", [".webm", ".mp4", ".avi", ".MP4"])
def test_a_video_is_read_back_with_its_frames_size_rate_and_colours(
    suffix: str, tmp_path: Path
) -> None:
    frames = written(tmp_path / f"clip{suffix}", [k / 25 for k in range(10)])
    assert [number_of(frame.pixels) for frame in frames] == list(range(10))
    assert frames[-1].time == pytest.approx(9 / 25, abs=1e-3)
    for frame in frames:
        expected = numbered_image(frame.number)
        assert frame.pixels.shape == expected.shape
        for y, x in ((12, 16), (12, 48), (36, 16), (36, 48)):
            np.testing.assert_allclose(frame.pixels[y, x].astype(int), expected[y, x], atol=25)


@pytest.mark.parametrize("width", [63, 65])
@pytest.mark.parametrize("height", [47, 48])
def test_odd_sides_lose_their_last_row_and_column(width: int, height: int, tmp_path: Path) -> None:
    frame = written(tmp_path / "odd.avi", [0.0], width=width, height=height)[0]
    assert frame.pixels.shape == (height // 2 * 2, width // 2 * 2, 3)
    np.testing.assert_allclose(frame.pixels[4, 4].astype(int), (220, 20, 20), atol=25)


@pytest.mark.parametrize(
    ("times", "shown"),
    [
        ([0.0, 0.1, 0.2], [0, 1, 2]),
        ([3.0, 3.3, 3.4], [0, 0, 0, 1, 2]),  # a gap is filled by the frame before it
        ([0.0, 0.04, 0.1], [0, 2]),  # of two frames with one tick, the nearest
        ([0.0, 0.08, 0.14, 0.2], [0, 1, 3]),
        ([0.0, 0.06, 0.12, 0.2], [0, 2, 3]),
        ([0.0, 0.16, 0.24, 0.34], [0, 0, 2, 3]),  # 0.16 and 0.24 are equally near to 0.2: the later
    ],
)
def test_frames_are_repeated_and_left_out_by_the_nearest_tick(
    times: list[float], shown: list[int], tmp_path: Path
) -> None:
    frames = written(tmp_path / "ticks.avi", times, fps=10)
    assert [number_of(frame.pixels) for frame in frames] == shown


@settings(max_examples=25, deadline=None)
@given(
    st.lists(st.floats(min_value=0.001, max_value=0.4), max_size=12),
    st.floats(min_value=-5, max_value=5000),
    st.sampled_from([8.0, 23.976, 25.0, 29.97, 30.0]),
    st.sampled_from([".avi", ".mp4"]),
)
def test_the_duration_is_that_of_the_times_within_a_tick(
    gaps: list[float], start: float, fps: float, suffix: str
) -> None:
    times = [start + sum(gaps[:k]) for k in range(len(gaps) + 1)]
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"clip{suffix}"
        with VideoWriter(path, fps) as video:
            for number, time in enumerate(times):
                video.write(numbered_image(number), time)
        found = video_file(path)
        frames = list(found)
    assert found.rate_hint == pytest.approx(video.fps, rel=1e-9)
    tick = 1 / video.fps
    # The last frame lasts one tick.
    assert abs(len(frames) * tick - (times[-1] - times[0] + tick)) <= tick / 2 + 1e-6
    # Each frame that is shown begins within half a tick of its own time.
    shown = [number_of(frame.pixels) for frame in frames]
    assert shown == sorted(shown)
    for number in set(shown):
        begins = frames[shown.index(number)].time
        assert abs(begins - (times[number] - times[0])) <= tick / 2 + 1e-6


def test_the_codec_is_noted_and_one_that_is_missing_is_named(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
) -> None:
    with caplog.at_level(logging.INFO):
        with VideoWriter(tmp_path / "a.webm") as video:
            video.write(numbered_image(0), 0.0)
        with VideoWriter(tmp_path / "b.webm", codecs=("XYZ1", "VP90")) as other:
            other.write(numbered_image(0), 0.0)
    assert (video.codec, other.codec) == ("VP80", "VP90")
    assert caplog.messages == [
        f"{tmp_path}/a.webm is written as VP8 (VP80).",
        f"{tmp_path}/b.webm is written as VP9 (VP90). This OpenCV cannot write XYZ1.",
    ]
    assert capfd.readouterr().err == ""


def test_without_any_codec_the_suffixes_are_named_and_nothing_is_left(tmp_path: Path) -> None:
    with (
        pytest.raises(VideoError, match=r"none of the codecs XYZ1, XYZ2.*\.webm, \.mp4, \.avi"),
        VideoWriter(tmp_path / "a.mp4", codecs=("XYZ1", "XYZ2")) as video,
    ):
        video.write(numbered_image(0), 0.0)
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_overwritten_at_the_beginning_or_at_the_end(tmp_path: Path) -> None:
    path = tmp_path / "clip.avi"
    path.write_text("mine")
    with pytest.raises(FileExistsError, match=r"exists already, and is not overwritten"):
        VideoWriter(path)
    path.unlink()
    video = VideoWriter(path)
    video.write(numbered_image(3), 0.0)
    path.write_text("mine")
    with pytest.raises(FileExistsError, match=r"made by another program meanwhile"):
        video.close()
    assert path.read_text() == "mine"
    (kept,) = (found for found in tmp_path.iterdir() if found != path)
    assert [number_of(frame.pixels) for frame in video_file(kept)] == [3]


def test_a_file_appears_only_when_it_is_complete(tmp_path: Path) -> None:
    path = tmp_path / "clip.avi"
    with VideoWriter(path) as video:
        video.write(numbered_image(0), 0.0)
        assert not path.exists()
    assert path.exists()


def test_nothing_is_left_after_an_error(tmp_path: Path) -> None:
    def broken() -> None:
        with VideoWriter(tmp_path / "a.avi") as video:
            video.write(numbered_image(0), 0.0)
            assert len(list(tmp_path.iterdir())) == 1
            raise RuntimeError("network")

    with pytest.raises(RuntimeError, match="network"):
        broken()
    assert list(tmp_path.iterdir()) == []


def test_without_frames_there_is_no_file(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with VideoWriter(tmp_path / "a.avi"):
        pass
    assert list(tmp_path.iterdir()) == []
    assert "a.avi is not written, since there is no frame" in caplog.text


def test_frames_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    with VideoWriter(tmp_path / "a.avi") as video:
        video.write(numbered_image(0), 1.0)
        with pytest.raises(ValueError, match=r"has 32 × 48 pixels, and the first one had 64 × 48"):
            video.write(numbered_image(1, width=32), 2.0)
        for time in (1.0, 0.5, math.nan, math.inf):
            with pytest.raises(ValueError, match="expected increasing times"):
                video.write(numbered_image(1), time)
    with pytest.raises(ValueError, match="has 1 × 48 pixels; expected at least 2 × 2"):
        VideoWriter(tmp_path / "b.avi").write(numbered_image(0, width=1), 0.0)


def test_names_and_rates_that_cannot_be_are_refused(tmp_path: Path) -> None:
    with pytest.raises(VideoError, match=r"suffix '.gif'; videos are written as .webm, .mp4, .avi"):
        VideoWriter(tmp_path / "a.gif")
    with pytest.raises(FileNotFoundError, match="There is no folder"):
        VideoWriter(tmp_path / "nowhere" / "a.avi")
    for fps in (0.0, -1.0, math.nan, math.inf, 0.001):
        with pytest.raises(VideoError, match="expected frames per second"):
            VideoWriter(tmp_path / "a.avi", fps)
    assert VideoWriter(tmp_path / "a.avi").fps == 30


@pytest.mark.parametrize("suffix", [".webm", ".mp4", ".avi"])
def test_a_full_disk_is_reported(suffix: str, tmp_path: Path) -> None:
    """A limit of the size of files has the same effect."""
    resource = pytest.importorskip("resource", reason="this system has no limits of file sizes")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    noise = np.random.default_rng(0).integers(0, 256, (40, 96, 128, 3), dtype=np.uint8)
    video = VideoWriter(tmp_path / f"a{suffix}")
    resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, before[1]))
    try:
        for number, image in enumerate(noise):
            video.write(image, number / 30)
        with pytest.raises(
            VideoError, match=rf"a{suffix} could not be written whole: it holds \d+ of 40"
        ):
            video.close()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert list(tmp_path.iterdir()) == []
