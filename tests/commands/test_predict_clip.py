"""`predict` from a video to hands over time, with a scripted detector in the place of MediaPipe's."""

import csv
import json
from pathlib import Path

import cv2
import jsonschema
import numpy as np
import pytest

import hand_recon
from hand_recon.data.video.files import video_file
from hand_recon.hand.model import HandModel
from hand_recon.hand.open_hand import open_hand
from hand_recon.runs.clip import clip_run, results
from hand_recon.runs.predict_run import predict
from tests.support.photo_folder import SCHEMA, read
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


@pytest.fixture(scope="module")
def mediapipe_hand() -> HandModel:
    return open_hand("mediapipe")


@pytest.fixture
def detector(mediapipe_hand: HandModel, monkeypatch: pytest.MonkeyPatch) -> ScriptedDetector:
    """A right hand that is lost for three frames, and a left one that is once taken for a right one."""
    right, left = (noisy(moving_hand(mediapipe_hand, side)[1]) for side in ("right", "left"))
    right[8:11] = np.nan
    found = ScriptedDetector({"right": right, "left": left}, frozenset({("left", 4)}))
    monkeypatch.setattr(clip_run, "build_detector", lambda config: found)
    return found


def test_a_clip_becomes_hands_over_time(
    detector: ScriptedDetector, mediapipe_hand: HandModel, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    summary = predict(
        asked(clip_file(tmp_path), out, "motion.video=mp4", "motion.glb=true", "motion.bvh=true")
    )
    entries = read(out)
    jsonschema.validate(entries, SCHEMA)
    assert len(entries) == 2 * FRAMES == summary["hands"]
    assert [(one["clip"]["frame"], one["clip"]["hand"]) for one in entries] == [
        (frame, hand) for frame in range(FRAMES) for hand in (1, 2)
    ]
    np.testing.assert_allclose(
        [one["clip"]["time"] for one in entries[::2]], np.arange(FRAMES) / 25, atol=1e-3
    )
    by_side = {side: [one for one in entries if one["side"] == side] for side in ("right", "left")}
    for side, of_side in by_side.items():
        assert len({one["clip"]["hand"] for one in of_side}) == 1
        ground_truth, _ = moving_hand(mediapipe_hand, "left" if side == "left" else "right")
        found = np.array([one["landmarks_3d"] for one in of_side])
        error = np.linalg.norm(found - ground_truth, axis=-1)
        error -= np.linalg.norm(found[:, 9] - ground_truth[:, 9], axis=-1)[:, None]
        # The camera is known and landmarks are half a pixel off: a few millimetres besides the depth.
        assert np.abs(error).mean() < 0.008
    bridged = [one for one in entries if not one["clip"]["seen"]]
    assert [(one["side"], one["clip"]["frame"]) for one in bridged] == [
        ("right", frame) for frame in (8, 9, 10)
    ]
    assert {one["verdict"] for one in bridged} == {"doubtful"}
    assert all(one["observed_2d"] is None and one["landmarks_3d"] for one in bridged)
    assert summary["bridged"] == 3
    with (out / "angles.csv").open(newline="") as stream:
        assert len(list(csv.DictReader(stream))) == 2 * FRAMES
    with video_file(out / "video.mp4") as video:
        frames = list(video)
    assert len(frames) == FRAMES
    assert frames[0].pixels.shape[1] > WIDTH
    # Grey frames have colours where hands are.
    colour = np.ptp(frames[5].pixels[240:, :640].astype(int), axis=-1)
    assert (colour > 40).sum() > 500
    assert (out / "hands.glb").read_bytes()[:4] == b"glTF"
    assert len(list(out.glob("hand_*.bvh"))) == 2
    assert not [path for path in out.iterdir() if "unfinished" in path.name or ".part" in path.name]
    written = json.loads((out / "clip.json").read_text(encoding="utf-8"))
    assert written["frames"] == FRAMES
    for row in written["jitter"]:
        assert row["jitter_after_mm_per_s2"] < 0.7 * row["jitter_before_mm_per_s2"]


@pytest.mark.slow
def test_no_smoothing_is_every_frame_for_itself(detector: ScriptedDetector, tmp_path: Path) -> None:
    summary = predict(asked(clip_file(tmp_path), tmp_path / "out", "motion.smoothing=0"))
    for row in summary["jitter"]:
        assert row["jitter_after_mm_per_s2"] == row["jitter_before_mm_per_s2"]


@pytest.mark.slow
def test_each_hand_has_one_shape_and_one_person_has_one(
    detector: ScriptedDetector, tmp_path: Path
) -> None:
    clip = clip_file(tmp_path)
    for word, count in (("same_person=false", 2), ("same_person=true", 1)):
        out = tmp_path / word
        predict(asked(clip, out, word))
        assert len({tuple(entry["shape"]) for entry in read(out)}) == count


@pytest.mark.slow
def test_long_clips_have_a_hand_to_a_line(
    detector: ScriptedDetector, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clip = clip_file(tmp_path)
    predict(asked(clip, tmp_path / "list"))
    monkeypatch.setattr(results, "LINES_FROM", 2 * FRAMES)
    predict(asked(clip, tmp_path / "lines"))
    lines = (tmp_path / "lines" / "hands.jsonl").read_text(encoding="utf-8").splitlines()
    assert [json.loads(line) for line in lines] == read(tmp_path / "list")
    assert not (tmp_path / "lines" / "hands.json").exists()
    found = hand_recon.read_hands(tmp_path / "lines" / "hands.jsonl")
    assert found.moments == hand_recon.read_hands(tmp_path / "list" / "hands.json").moments


@pytest.mark.slow
def test_images_with_a_rate_are_a_clip(detector: ScriptedDetector, tmp_path: Path) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    for number in range(FRAMES):
        image = numbered_image(number, WIDTH, HEIGHT)[..., ::-1]
        (folder / f"{number}.png").write_bytes(cv2.imencode(".png", image)[1].tobytes())
    predict(asked(folder, tmp_path / "out", "motion.fps=50"))
    times = [one["clip"]["time"] for one in read(tmp_path / "out")]
    assert times[-1] == pytest.approx((FRAMES - 1) / 50)


def test_a_clip_without_hands_says_so(detector: ScriptedDetector, tmp_path: Path) -> None:
    detector.hands = {}
    with pytest.raises(ValueError, match=f"No hand was found in the {FRAMES} frames of .*clip.mp4"):
        predict(asked(clip_file(tmp_path), tmp_path / "out"))


def test_a_video_is_given_alone(detector: ScriptedDetector, tmp_path: Path) -> None:
    clip = clip_file(tmp_path)
    config = asked(clip, tmp_path / "out")
    config.input = [str(clip), str(tmp_path / "photo.jpg")]
    with pytest.raises(ValueError, match=r"Found the video .*clip\.mp4 and 1 more input"):
        predict(config)


@pytest.mark.slow
def test_results_are_not_overwritten(detector: ScriptedDetector, tmp_path: Path) -> None:
    clip = clip_file(tmp_path)
    predict(asked(clip, tmp_path / "out"))
    with pytest.raises(FileExistsError, match="nothing is overwritten"):
        predict(asked(clip, tmp_path / "out"))


@pytest.mark.slow
def test_the_camera_follows_the_size_of_large_hands_once_for_all_frames(
    detector: ScriptedDetector, tmp_path: Path
) -> None:
    predict(asked(clip_file(tmp_path), tmp_path / "out"))
    entries = read(tmp_path / "out")
    assert len({json.dumps(one["camera"]) for one in entries}) == 1
    assert entries[0]["camera"]["source"] == "assumed"
    sides = [
        np.ptp(points, axis=0).max()
        for of_hand in detector.hands.values()
        for points in of_hand
        if np.isfinite(points).all()
    ]
    expected = max(1.2 * WIDTH, 500 / 224 * 1.5 * np.quantile(sides, 0.95))
    assert entries[0]["camera"]["intrinsics"][0][0] == pytest.approx(expected)


def test_exif_is_refused(detector: ScriptedDetector, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="EXIF has no focal length"):
        predict(asked(clip_file(tmp_path), tmp_path / "out", "camera=exif"))
