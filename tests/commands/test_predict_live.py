"""`predict` before a camera: frames one by one, hands with stable numbers, every way in which it ends."""

import json
import logging
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest

import hand_recon
from hand_recon.data.video.files import video_file
from hand_recon.data.video.frames import Frame, FrameSource
from hand_recon.hand.open_hand import open_hand
from hand_recon.runs import predict_run
from hand_recon.runs.clip import live_hands, live_run
from hand_recon.runs.clip.live_window import open_window
from hand_recon.runs.predict_run import predict
from tests.support.photo_folder import SCHEMA
from tests.support.scripted_clip import (
    FRAMES,
    ScriptedDetector,
    asked,
    clip_file,
    moving_hand,
    noisy,
)


class Camera(FrameSource):
    """A camera that shows a clip, every frame of which is taken in time."""

    name = "webcam"
    rate_hint = 25.0
    is_live = True

    def __init__(self, clip: Path, *, pressing: int | None = None) -> None:
        self.clip, self.pressing = clip, pressing

    def frames(self, first: int = 0) -> Iterator[Frame]:
        with video_file(self.clip) as video:
            for frame in video:
                if frame.number == self.pressing:
                    raise KeyboardInterrupt
                yield replace(frame, time=frame.time)


class Shown:
    """A window that is closed after some frames."""

    def __init__(self, most: int) -> None:
        self.most, self.drawings, self.is_closed = most, 0, False

    def show(self, pixels: np.ndarray) -> bool:
        self.drawings += 1
        return self.drawings < self.most

    def close(self) -> None:
        self.is_closed = True


@pytest.fixture
def clip(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A clip of two hands, the right one lost for two frames, in front of a camera without a window."""
    model = open_hand("mediapipe")
    right, left = (noisy(moving_hand(model, side)[1]) for side in ("right", "left"))
    right[9:11] = np.nan
    found = ScriptedDetector({"right": right, "left": left}, frozenset({("left", 6)}))
    monkeypatch.setattr(live_run, "build_detector", lambda config: found)
    monkeypatch.setattr(live_run, "open_window", lambda title: None)
    return clip_file(tmp_path)


def before(camera: Camera, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(predict_run, "video_kind", lambda word, fps: "camera")
    monkeypatch.setattr(predict_run, "frame_source", lambda word, fps: camera)


def test_hands_are_written_as_they_come(
    clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_hands, "SHAPE_FROM", 8)
    before(Camera(clip), monkeypatch)
    out = tmp_path / "out"
    summary = predict(asked("webcam", out, "motion.video=mp4"))
    lines = (out / "hands.jsonl").read_text(encoding="utf-8").splitlines()
    entries = [json.loads(line) for line in lines]
    jsonschema.validate(entries, SCHEMA)
    assert summary["frames"] == FRAMES
    # A hand is shown from its third frame on.
    shown = {
        side: [one["clip"]["frame"] for one in entries if one["side"] == side]
        for side in ("right", "left")
    }
    assert shown["left"] == list(range(2, FRAMES))
    assert shown["right"] == [n for n in range(2, FRAMES) if n not in (9, 10)]
    for side in ("right", "left"):
        assert len({one["clip"]["hand"] for one in entries if one["side"] == side}) == 1
    assert max(one["residual"] for one in entries) < 12
    assert np.abs(summary["shape"]).max() > 0
    with video_file(out / "video.mp4") as video:
        assert len(list(video)) == FRAMES
    assert len(hand_recon.read_hands(out / "hands.jsonl")) == len(entries)


@pytest.mark.slow
def test_the_later_result_follows_the_hand(
    clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before(Camera(clip), monkeypatch)
    predict(asked("webcam", tmp_path / "out"))
    found = hand_recon.read_hands(tmp_path / "out" / "hands.jsonl")
    ground_truth, _ = moving_hand(open_hand("mediapipe"), "right")
    rows = [row for row, side in enumerate(found.sides) if side == "right"]
    moments = [found.moments[row] for row in rows]
    frames = [moment.frame for moment in moments if moment is not None]
    points = found.landmarks_3d[rows] - found.landmarks_3d[rows, 9:10]
    expected = ground_truth[frames] - ground_truth[frames, 9:10]
    # A lag of some frames of a hand that closes within 0.8 s.
    assert np.linalg.norm(points - expected, axis=-1).mean() < 0.012


def test_a_hand_whose_side_was_mistaken_at_first_does_not_move_from_one_to_the_other(
    clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = open_hand("mediapipe")
    ground_truth, pixels = moving_hand(model, "right")
    mistaken = frozenset(("right", frame) for frame in range(5))
    found = ScriptedDetector({"right": noisy(pixels)}, mistaken)  # type: ignore[arg-type]
    monkeypatch.setattr(live_run, "build_detector", lambda config: found)
    before(Camera(clip), monkeypatch)
    predict(asked("webcam", tmp_path / "out"))
    hands = hand_recon.read_hands(tmp_path / "out" / "hands.jsonl")
    rows = [row for row, side in enumerate(hands.sides) if side == "right"]
    frames = [one.frame for one in hands.moments if one is not None]
    # It is shown in every frame, and of the other side until the votes are in balance.
    assert frames == list(range(2, FRAMES))
    assert rows == list(range(len(frames) - len(rows), len(frames)))
    first = frames[rows[0]]
    assert 9 <= first <= 11
    points = hands.landmarks_3d[rows] - hands.landmarks_3d[rows, 9:10]
    expected = ground_truth[first:] - ground_truth[first:, 9:10]
    assert np.linalg.norm(points - expected, axis=-1).mean(axis=1).max() < 0.02


def test_the_window_ends_it(clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    window = Shown(5)
    before(Camera(clip), monkeypatch)
    monkeypatch.setattr(live_run, "open_window", lambda title: window)
    summary = predict(asked("webcam", tmp_path / "out"))
    assert (summary["frames"], window.drawings, window.is_closed) == (5, 5, True)


def test_the_limit_ends_it(clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before(Camera(clip), monkeypatch)
    summary = predict(asked("webcam", tmp_path / "out", "motion.limit=0.2"))
    assert summary["frames"] == 6


def test_ctrl_c_leaves_complete_results(
    clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    before(Camera(clip, pressing=7), monkeypatch)
    with caplog.at_level(logging.INFO):
        summary = predict(asked("webcam", tmp_path / "out", "motion.video=mp4"))
    assert summary["frames"] == 7
    assert "Ended by Ctrl-C." in caplog.messages
    assert (tmp_path / "out" / "video.mp4").exists()
    assert not (tmp_path / "out" / "unfinished.json").exists()


def test_a_network_is_refused(clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before(Camera(clip), monkeypatch)
    with pytest.raises(ValueError, match="too slow for a camera"):
        predict(asked("webcam", tmp_path / "out", "ckpt=some.ckpt"))


def test_without_a_display_there_is_a_note(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with caplog.at_level(logging.INFO):
        assert open_window("hands") is None
    assert "There is no window" in caplog.text
    assert "opencv-python" in caplog.text
