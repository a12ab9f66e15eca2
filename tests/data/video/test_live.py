"""Live sources give the newest frame, at the time when it arrived, and end in words."""

import itertools
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from hand_recon.data.video.cameras import webcam
from hand_recon.data.video.frames import VideoError
from hand_recon.data.video.live import LiveSource
from tests.support.video_files import FakeCapture, number_of


class Gated(FakeCapture):
    """A camera each of whose frames waits until the test lets it come."""

    def __init__(self, count: int) -> None:
        super().__init__([0.0] * count)
        self.gate = threading.Semaphore(0)
        self.asked = threading.Semaphore(0)

    def grab(self) -> bool:
        self.asked.release()
        self.gate.acquire()
        return super().grab()

    def let(self, count: int) -> None:
        """Let frames come, and wait until the last of them is stored and the next one asked for."""
        self.gate.release(count)
        for _ in range(count):
            assert self.asked.acquire(timeout=5)


def ticking(*times: float) -> Callable[[], float]:
    return iter(times).__next__


def test_the_newest_frame_is_given_and_the_ones_before_it_are_lost() -> None:
    camera = Gated(7)
    source = LiveSource("webcam", camera, ticking(*(10.0 + 0.5 * k for k in range(7))))
    camera.gate.release()
    frames = iter(source)
    first = next(frames)
    for _ in range(2):
        assert camera.asked.acquire(timeout=5)
    camera.let(3)
    second = next(frames)
    camera.let(1)
    third = next(frames)
    assert [number_of(frame.pixels) for frame in (first, second, third)] == [0, 3, 4]
    assert [frame.number for frame in (first, second, third)] == [0, 1, 2]
    # The time is that of the arrival, not that of the taking.
    assert [frame.time for frame in (first, second, third)] == [0.0, 1.5, 2.0]
    assert source.lost == 2
    assert source.is_live
    camera.gate.release(10)
    source.close()
    assert list(frames) == []
    assert camera.released == 1


def test_times_increase_though_a_coarse_clock_stands_still() -> None:
    camera = Gated(3)
    source = LiveSource("webcam", camera, lambda: 4.0)
    frames = iter(source)
    times = []
    for _ in range(3):
        camera.gate.release()
        times.append(next(frames).time)
    camera.gate.release(5)
    assert list(frames) == []
    assert times[0] == 0
    assert all(later > earlier for earlier, later in itertools.pairwise(times))
    assert times[-1] < 1e-9


def test_a_source_without_frames_is_an_error() -> None:
    source = LiveSource("webcam:1", FakeCapture([]))
    with pytest.raises(VideoError, match=r"webcam:1 opens but gives no frame\. Another program"):
        list(source)


def test_an_error_of_the_camera_is_raised_where_frames_are_taken() -> None:
    camera = FakeCapture([0.0] * 9, error_at=0)
    with pytest.raises(cv2.error, match="the cable was pulled"):
        list(LiveSource("webcam", camera))
    assert camera.released == 1


def test_what_is_gone_cannot_be_read() -> None:
    source = LiveSource("webcam", FakeCapture([0.0]))
    with pytest.raises(VideoError, match="webcam is live: its first 7 frames are gone"):
        source.frames(7)
    list(source)
    with pytest.raises(VideoError, match="was read already"):
        source.frames()


def test_a_source_that_is_left_is_released_whether_it_was_read_or_not() -> None:
    unread, endless = FakeCapture([0.0]), FakeCapture([0.0] * 1_000_000)
    with LiveSource("webcam", unread):
        pass
    with LiveSource("webcam", endless) as source:
        frames = iter(source)
        next(frames)
    assert (unread.released, endless.released) == (1, 1)
    assert list(frames) == []


def test_closing_during_a_wait_ends_the_iteration() -> None:
    camera = Gated(5)
    source = LiveSource("webcam", camera)
    taken: list[object] = []
    reader = threading.Thread(target=lambda: taken.extend(source))
    reader.start()
    assert camera.asked.acquire(timeout=5)
    source._closing.set()
    camera.gate.release(9)
    source.close()
    reader.join(5)
    assert not reader.is_alive()
    assert taken == []


def test_size_and_rate_come_from_the_camera() -> None:
    properties = {
        "CAP_PROP_FRAME_WIDTH": 640.0,
        "CAP_PROP_FRAME_HEIGHT": 480.0,
        "CAP_PROP_FPS": 30.0,
    }
    source = LiveSource("webcam", FakeCapture([0.0], properties))
    assert (source.size, source.rate_hint, source.count_hint) == ((640, 480), 30.0, None)
    silent = LiveSource("webcam", FakeCapture([0.0]))
    assert (silent.size, silent.rate_hint) == (None, None)


@pytest.fixture
def devices(tmp_path: Path) -> Iterator[Path]:
    for name in ("video0", "video2", "video10", "null"):
        (tmp_path / name).touch()
    return tmp_path  # type: ignore[return-value]


def refusal(number: int, system: str = "linux", devices: Path = Path("/nowhere")) -> str:
    camera = FakeCapture(opened=False)
    with pytest.raises(VideoError) as caught:
        webcam(number, opener=lambda _: camera, system=system, devices=devices)
    assert camera.released == 1
    return str(caught.value)


def test_a_camera_that_is_missing_or_not_allowed_is_named_with_the_cure(devices: Path) -> None:
    assert (
        "video1 does not exist. Name one that there is: webcam:0, webcam:2, webcam:10."
        in refusal(1, devices=devices)
    )
    assert "/nowhere/video0 does not exist. Connect one; in a container" in refusal(0)
    assert "Another program may use the camera: close it" in refusal(0, devices=devices)
    assert "allow the terminal to use the camera (System Settings" in refusal(0, "darwin")
    assert "allow desktop apps to use the camera" in refusal(3, "win32")
    assert "webcam:4" in refusal(3, "win32")


def test_a_camera_is_opened_by_its_number_and_named_by_its_word() -> None:
    asked: list[str | int] = []

    def opener(address: str | int) -> FakeCapture:
        asked.append(address)
        return FakeCapture([0.0])

    with webcam(opener=opener) as first, webcam(2, opener=opener) as third:
        assert (first.name, third.name) == ("webcam", "webcam:2")
        assert number_of(next(iter(third)).pixels) == 0
    assert asked == [0, 2]
    assert np.isfinite(first.lost)
