"""Clips whose frames are not all there, images in a row, and what is in the folder of the results already."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from hand_recon.data.video.files import VideoFile, video_file
from hand_recon.data.video.frames import Frame
from hand_recon.hand.open_hand import open_hand
from hand_recon.runs import predict_run
from hand_recon.runs.clip import clip_run, drawing
from hand_recon.runs.predict_run import predict
from tests.support.photo_folder import read
from tests.support.scripted_clip import (
    FRAMES,
    HEIGHT,
    WIDTH,
    ScriptedDetector,
    asked,
    clip_file,
    moving_hand,
    noisy,
)
from tests.support.video_files import numbered_image

DAMAGED = 6
"""Frame that cannot be decoded."""


class Damaged(VideoFile):
    """A video of which one frame is not given."""

    def frames(self, first: int = 0) -> Iterator[Frame]:
        return (frame for frame in super().frames(first) if frame.number != DAMAGED)


@pytest.fixture
def detector(monkeypatch: pytest.MonkeyPatch) -> ScriptedDetector:
    found = ScriptedDetector({"right": noisy(moving_hand(open_hand("mediapipe"), "right")[1])})
    monkeypatch.setattr(clip_run, "build_detector", lambda config: found)
    return found


def stop(*arguments: object) -> None:
    raise KeyboardInterrupt


@pytest.mark.slow
def test_frames_keep_their_numbers_where_one_is_missing(
    detector: ScriptedDetector, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clip = clip_file(tmp_path)
    monkeypatch.setattr(
        predict_run, "frame_source", lambda word, fps: Damaged(str(clip), "clip.mp4")
    )
    config = asked(clip, tmp_path / "out", "motion.video=mp4")
    # Interrupted behind the missing frame, and while frames are drawn.
    with monkeypatch.context() as patch:
        patch.setattr(
            detector.__class__, "__call__", _stopping(ScriptedDetector.__call__, DAMAGED + 3)
        )
        with pytest.raises(KeyboardInterrupt):
            predict(config)
    with monkeypatch.context() as patch:
        patch.setattr(drawing, "draw_clip_frame", stop)
        with pytest.raises(KeyboardInterrupt):
            predict(config)
    # What a kill leaves of a video.
    (tmp_path / "out" / ".video.0a1b2c3d.mp4").write_bytes(b"part")
    predict(config)
    numbers = [number for number in range(FRAMES) if number != DAMAGED]
    entries = read(tmp_path / "out")
    assert [entry["clip"]["frame"] for entry in entries] == numbers
    assert [entry["clip"]["time"] for entry in entries] == pytest.approx(
        np.array(numbers) / 25, abs=1e-3
    )
    assert sorted(set(detector.calls)) == numbers
    with video_file(tmp_path / "out" / "video.mp4") as video:
        # The frame before is shown for twice as long.
        assert len(list(video)) == FRAMES
    assert not list((tmp_path / "out").glob(".video*"))


def _stopping(function: Callable[..., Any], call: int) -> Callable[..., Any]:
    calls: list[None] = []

    def stopping(*arguments: object) -> Any:  # noqa: ANN401
        calls.append(None)
        return stop() if len(calls) == call else function(*arguments)

    return stopping


def test_other_images_of_the_same_folder_do_not_go_on(
    detector: ScriptedDetector, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    for number in range(FRAMES):
        image = numbered_image(number, WIDTH, HEIGHT)[..., ::-1]
        (folder / f"{number}.png").write_bytes(cv2.imencode(".png", image)[1].tobytes())
    config = asked(f"{folder}/*.png", tmp_path / "out", "motion.fps=25")
    with monkeypatch.context() as patch:
        patch.setattr(clip_run, "fit_clip", stop)
        with pytest.raises(KeyboardInterrupt):
            predict(config)
    changed = folder / "3.png"
    changed.write_bytes(changed.read_bytes() + b"\0")
    with pytest.raises(FileExistsError, match="other video"):
        predict(config)


def test_animations_of_somebody_else_are_not_overwritten(
    detector: ScriptedDetector, tmp_path: Path
) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "hand_1.bvh").write_text("HIERARCHY")
    with pytest.raises(FileExistsError, match=r"already holds hand_1\.bvh"):
        predict(asked(clip_file(tmp_path), tmp_path / "out", "motion.bvh=true"))
    assert (tmp_path / "out" / "hand_1.bvh").read_text() == "HIERARCHY"
