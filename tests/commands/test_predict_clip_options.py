"""Options that `predict` refuses for a video, before it looks at a frame, and `strict`."""

import logging
from pathlib import Path

import numpy as np
import pytest
import torch
from hydra.errors import InstantiationException

from hand_recon.hand.open_hand import open_hand
from hand_recon.runs.clip import checks, clip_run
from hand_recon.runs.predict_run import predict
from tests.support.photo_folder import read
from tests.support.scripted_clip import (
    FRAMES,
    ScriptedDetector,
    asked,
    clip_file,
    moving_hand,
    noisy,
)

REFUSED = (ValueError, FileNotFoundError, InstantiationException)


@pytest.fixture
def detector(monkeypatch: pytest.MonkeyPatch) -> ScriptedDetector:
    right = noisy(moving_hand(open_hand("mediapipe"), "right")[1])
    found = ScriptedDetector({"right": right})
    monkeypatch.setattr(clip_run, "build_detector", lambda config: found)
    return found


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("json='-'",), "json=- is for photographs"),
        (("results.meshes=glb",), r"hands\.glb"),
        (("results.overlays=false",), r"motion\.video=null"),
        (("detector=landmarks", "detector.landmarks=a.json"), "detector=landmarks looks hands up"),
        (("detector=boxes", "detector.boxes=a.json"), "detector=boxes looks hands up"),
        (("descent.solver=adam",), "chooses among several"),
        (("descent.steps=0", "lifter=default"), "chooses among the minima"),
        (("descent.starts=0",), "no lifter"),
        (("data_term=mse",), "data term is no likelihood"),
        (("keep_balance=true",), "data term is no likelihood"),
        (("camera=exif",), "EXIF has no focal length"),
        (("camera=nowhere.json",), r"nowhere\.json"),
        (("motion.longest_gap=2.5",), r"motion\.longest_gap=2\.5; expected 0 .* to 2 s"),
        (("motion.longest_gap=-1",), r"motion\.longest_gap=-1"),
        (("motion.palms_every=0",), r"motion\.palms_every=0"),
        (("motion.copies=9",), r"motion\.copies=9; expected 0 to 8"),
        (("motion.limit=0",), r"motion\.limit=0"),
        (("motion.processes=0",), r"motion\.processes=0"),
        (("motion.video=gif",), r"motion\.video=gif"),
        (("motion.smoothing=-1",), "-1"),
    ],
)
def test_what_a_video_does_not_have_is_refused_before_its_first_frame(
    detector: ScriptedDetector, tmp_path: Path, words: tuple[str, ...], message: str
) -> None:
    kept = [word for word in words if not word.startswith("detector")]
    config = asked(clip_file(tmp_path), tmp_path / "out", *kept)
    if len(kept) < len(words):
        config.detector = {words[1].split(".")[1].split("=")[0]: "a.json"}
    with pytest.raises(REFUSED, match=message):
        predict(config)
    assert not detector.calls
    # A corrected command may have the same folder.
    assert not (tmp_path / "out").exists()


def test_a_hand_without_second_derivatives_is_refused_before_the_first_frame(
    detector: ScriptedDetector, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = open_hand("mediapipe")
    hand = plain.with_arrays(pose_directions=torch.zeros(*plain.template.shape, 135))
    monkeypatch.setattr(checks, "build_hand", lambda config: hand)
    with pytest.raises(ValueError, match="no derivatives of the pose blend shapes"):
        predict(asked(clip_file(tmp_path), tmp_path / "out"))
    assert not detector.calls


def test_cameras_of_every_frame_are_refused(detector: ScriptedDetector, tmp_path: Path) -> None:
    file = tmp_path / "cameras.npy"
    np.save(file, np.tile(np.diag([700.0, 700.0, 1.0]), (FRAMES, 1, 1)))
    with pytest.raises(ValueError, match=f"holds {FRAMES} cameras"):
        predict(asked(clip_file(tmp_path), tmp_path / "out", f"camera='{file}'"))
    assert not detector.calls


def test_strict_refuses_doubtful_hands_that_are_written_all_the_same(
    detector: ScriptedDetector, tmp_path: Path
) -> None:
    # A hand whose index finger is elsewhere.
    detector.hands["right"][:, 6:9] += 90.0
    with pytest.raises(ValueError, match=f"of {FRAMES} hands are doubtful"):
        predict(asked(clip_file(tmp_path), tmp_path / "out", "strict=true"))
    assert "doubtful" in {entry["verdict"] for entry in read(tmp_path / "out")}
    assert not (tmp_path / "out" / "unfinished.json").exists()


def test_no_gap_is_bridged(detector: ScriptedDetector, tmp_path: Path) -> None:
    detector.hands["right"][8] = np.nan
    predict(asked(clip_file(tmp_path), tmp_path / "out", "motion.longest_gap=0"))
    frames = [entry["clip"]["frame"] for entry in read(tmp_path / "out")]
    assert frames == [*range(8), *range(9, FRAMES)]


def test_hands_that_are_left_out_are_said_when_none_is_left(
    detector: ScriptedDetector, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    detector.hands["right"][1:] = np.nan
    with (
        caplog.at_level(logging.INFO),
        pytest.raises(ValueError, match=r"No hand of .*clip\.mp4 is left"),
    ):
        predict(asked(clip_file(tmp_path), tmp_path / "out"))
    assert "a hand in frames 0 to 0 is left out: seen for 0.00 s" in caplog.text
