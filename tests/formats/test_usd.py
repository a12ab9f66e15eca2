"""USD stages of hands: units, axes, times, and hands that are invisible where they are missing."""

from pathlib import Path

import numpy as np
import pytest

from hand_recon.formats.exported_hands import ExportedHand, Scene
from hand_recon.formats.usd import joint_paths, write_usd
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import JOINTS, PARENTS
from tests.support.exported import clip, photographs
from tests.support.trajectories import Clip, moving_hand, with_times, without_frames
from tests.support.usd_reader import UsdHands

pytest.importorskip("pxr", reason="needs pxr: pip install 'hand_recon[usd]'")


def read(scene: Scene, hand: HandModel, folder: Path) -> UsdHands:
    return UsdHands(write_usd(folder / "new" / "a.usdc", scene, hand))


def test_a_stage_says_its_units_axes_and_times(hand: HandModel, tmp_path: Path) -> None:
    file = read(clip(hand).scenes[0], hand, tmp_path)
    root = file.stage.GetRootLayer().pseudoRoot
    assert (root.GetInfo("upAxis"), root.GetInfo("metersPerUnit")) == ("Y", 1.0)
    assert file.stage.GetTimeCodesPerSecond() == file.stage.GetFramesPerSecond() == 30
    assert (file.stage.GetStartTimeCode(), file.stage.GetEndTimeCode()) == pytest.approx((0, 9))
    assert file.names == ["hand_1_left", "hand_2_right"]


def test_a_hand_is_invisible_where_it_is_missing(hand: HandModel, tmp_path: Path) -> None:
    file = read(clip(hand).scenes[0], hand, tmp_path)
    shown = {
        name: [frame for frame in range(10) if file.is_visible(name, frame / 30 + 1e-4)]
        for name in file.names
    }
    assert shown == {"hand_1_left": [0, 1, 2, 6, 7, 8, 9], "hand_2_right": [4, 5, 6, 7, 8, 9]}


def test_a_hand_stays_visible_after_a_short_gap_in_slow_motion(
    hand: HandModel, tmp_path: Path
) -> None:
    """40 frames of 30 a second, and 20 of 240, of which one is missing: less than a frame of the first."""
    times = np.concatenate([np.arange(40) / 30, 39 / 30 + np.arange(1, 21) / 240])
    motion = without_frames(with_times(moving_hand(1, "right", Clip(frames=60)), times), 45)
    count = len(motion)
    one = ExportedHand(motion, np.zeros((count, 21, 3)), np.full((count, 21, 3, 3), np.nan))
    file = read(Scene("clip", (one,)), hand, tmp_path)
    assert all(file.is_visible("hand_1_right", time + 1e-5) for time in motion.times.tolist())


def test_hands_of_a_photograph_are_visible(hand: HandModel, tmp_path: Path) -> None:
    file = read(photographs(hand).scenes[0], hand, tmp_path)
    assert [file.is_visible(name, 0.0) for name in file.names] == [True, True]


def test_joints_are_named_by_their_paths() -> None:
    paths = joint_paths()
    assert paths[:3] == ["wrist", "wrist/index_MCP", "wrist/index_MCP/index_PIP"]
    for path, parent in zip(paths[1:], PARENTS[1:], strict=True):
        assert path.rpartition("/")[0] == paths[parent]
    assert len(set(paths)) == len(JOINTS)
