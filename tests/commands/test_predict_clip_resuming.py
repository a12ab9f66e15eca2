"""A clip whose command is interrupted at any stage and repeated: the same results, and nothing twice."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from omegaconf import DictConfig

from hand_recon.hand.model import HandModel
from hand_recon.hand.open_hand import open_hand
from hand_recon.runs.clip import clip_run, drawing, fitting, results
from hand_recon.runs.clip.found_frames import FoundFrame, whole_lines
from hand_recon.runs.predict_run import predict
from tests.support.photo_checkpoint import write_networks
from tests.support.photo_folder import read
from tests.support.scripted_clip import (
    FRAMES,
    ScriptedDetector,
    asked,
    clip_file,
    moving_hand,
    noisy,
)


class Killed(BaseException):
    """Exception that stands for a kill of the command."""


@pytest.fixture(scope="module")
def hands() -> dict[str, np.ndarray]:
    model: HandModel = open_hand("mediapipe")
    right, left = (noisy(moving_hand(model, side)[1]) for side in ("right", "left"))
    left[5:7] = np.nan
    return {"right": right, "left": left}


def detector_of(hands: dict[str, np.ndarray], monkeypatch: pytest.MonkeyPatch) -> ScriptedDetector:
    found = ScriptedDetector(dict(hands))  # type: ignore[arg-type]  # the sides
    monkeypatch.setattr(clip_run, "build_detector", lambda config: found)
    return found


@pytest.fixture(scope="module")
def never_killed(hands: dict[str, np.ndarray], tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The file of hands of a command that was not interrupted."""
    folder = tmp_path_factory.mktemp("whole")
    with pytest.MonkeyPatch.context() as patch:
        detector_of(hands, patch)
        predict(asked(clip_file(folder), folder / "out"))
    return (folder / "out" / "hands.json").read_bytes()


def killing(function: Callable[..., Any], call: int) -> Callable[..., Any]:
    """A function whose call of a number ends the command."""
    calls = 0

    def killed(*arguments: Any, **named: Any) -> Any:  # noqa: ANN401
        nonlocal calls
        calls += 1
        if calls == call:
            raise Killed
        return function(*arguments, **named)

    return killed


def interrupted(config: DictConfig, place: Any, name: str, call: int) -> None:  # noqa: ANN401
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(place, name, killing(getattr(place, name), call))
        with pytest.raises(Killed):
            predict(config)


@pytest.mark.parametrize(
    "stage",
    [
        pytest.param((ScriptedDetector, "__call__", 1), marks=pytest.mark.slow),
        (ScriptedDetector, "__call__", 8),
        pytest.param((ScriptedDetector, "__call__", FRAMES), marks=pytest.mark.slow),
        pytest.param((fitting, "shape_of_hands", 2), marks=pytest.mark.slow),
        pytest.param((fitting, "_fit_to_file", 2), marks=pytest.mark.slow),
        pytest.param((clip_run, "motion_of", 2), marks=pytest.mark.slow),
        pytest.param((results, "hand_entries", 1), marks=pytest.mark.slow),
        pytest.param((clip_run, "write_motions", 1), marks=pytest.mark.slow),
        (results, "write_animated_glb", 1),
        pytest.param((drawing, "draw_clip_frame", 5), marks=pytest.mark.slow),
        pytest.param((clip_run, "steadiness", 1), marks=pytest.mark.slow),
    ],
)
def test_the_repeated_command_gives_what_an_uninterrupted_one_does(
    hands: dict[str, np.ndarray],
    never_killed: bytes,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    stage: tuple[Any, str, int],
) -> None:
    detector = detector_of(hands, monkeypatch)
    out = tmp_path / "out"
    config = asked(clip_file(tmp_path), out, "motion.video=mp4", "motion.glb=true")
    interrupted(config, *stage)
    assert (out / "unfinished.json").exists()
    predict(config)
    # The frame that was interrupted is looked at again, and no other one.
    assert sorted(set(detector.calls)) == list(range(FRAMES))
    assert len(detector.calls) == FRAMES
    assert (out / "hands.json").read_bytes() == never_killed
    assert {path.name for path in out.iterdir()} == {
        "angles.csv", "clip.json", "config.yaml", "hands.glb", "hands.json", "video.mp4",
    }  # fmt: skip


def test_half_a_line_is_done_again(
    hands: dict[str, np.ndarray],
    never_killed: bytes,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    detector = detector_of(hands, monkeypatch)
    out = tmp_path / "out"
    config = asked(clip_file(tmp_path), out)
    interrupted(config, ScriptedDetector, "__call__", 9)
    lines = out / "unfinished" / "frames.jsonl"
    whole = lines.read_bytes()
    assert whole.count(b"\n") == 8
    lines.write_bytes(whole[:-40])
    predict(config)
    assert detector.calls.count(7) == 2
    assert (out / "hands.json").read_bytes() == never_killed


def test_other_settings_do_not_go_on(
    hands: dict[str, np.ndarray], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    detector_of(hands, monkeypatch)
    clip = clip_file(tmp_path)
    interrupted(asked(clip, tmp_path / "out"), ScriptedDetector, "__call__", 9)
    with pytest.raises(FileExistsError, match="other options"):
        predict(asked(clip, tmp_path / "out", "motion.palms_every=3"))


@pytest.mark.slow
def test_another_number_of_processes_goes_on(
    hands: dict[str, np.ndarray],
    never_killed: bytes,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    detector_of(hands, monkeypatch)
    clip = clip_file(tmp_path)
    interrupted(asked(clip, tmp_path / "out"), ScriptedDetector, "__call__", 9)
    predict(asked(clip, tmp_path / "out", "motion.processes=1"))
    assert (tmp_path / "out" / "hands.json").read_bytes() == never_killed


def test_another_video_of_the_same_name_does_not_go_on(
    hands: dict[str, np.ndarray], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    detector_of(hands, monkeypatch)
    clip = clip_file(tmp_path)
    interrupted(asked(clip, tmp_path / "out"), ScriptedDetector, "__call__", 9)
    clip.write_bytes(clip.read_bytes() + b"\0")
    with pytest.raises(FileExistsError, match="other video"):
        predict(asked(clip, tmp_path / "out"))


@pytest.mark.slow
def test_a_network_looks_at_every_frame_once(
    hands: dict[str, np.ndarray], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """An untrained network's hands are starts of the fit; what it saw is kept for the repeated command."""
    runs = write_networks(tmp_path)
    detector = detector_of(hands, monkeypatch)
    clip, words = clip_file(tmp_path), (f"ckpt='{runs}/photos'", "seen_pose_weight=0")
    predict(asked(clip, tmp_path / "whole", *words))
    assert len(detector.calls) == FRAMES
    config = asked(clip, tmp_path / "out", *words)
    interrupted(config, ScriptedDetector, "__call__", 12)
    frames = list(whole_lines(tmp_path / "out" / "unfinished" / "frames.jsonl"))
    estimate = FoundFrame.from_line(frames[3]).estimate
    assert estimate is not None
    assert estimate.parameters.joint_angles.shape == (2, 15, 3)
    predict(config)
    written = read(tmp_path / "out")
    assert written == read(tmp_path / "whole")
    assert {entry["source"].split(" ")[0] for entry in written} == {"scripted,"}
    assert all("checkpoint photos/checkpoints/best.ckpt" in entry["source"] for entry in written)
