"""Tables and plots of joint angles hold what the motion has."""

import csv
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from matplotlib.patches import Rectangle

from hand_recon.detection.detector import Side
from hand_recon.formats.angles_plot import (
    angles_figure,
    bridged_steps,
    lone_frames,
    write_angles_plot,
)
from hand_recon.formats.angles_table import write_angles
from hand_recon.formats.hand_colours import hand_colours
from hand_recon.knowledge.ranges import load_ranges
from hand_recon.motion.trajectory import Trajectory
from hand_recon.visualization.hand_overlay import HAND_COLOURS
from tests.support.trajectories import Clip, moving_hand, still_hand, without_frames

RANGES = load_ranges("literature")


def read(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def with_gap(trajectory: Trajectory, *frames: int) -> Trajectory:
    observed = trajectory.observed.copy()
    observed[list(frames)] = False
    return replace(trajectory, observed=observed)


def test_a_row_has_the_degrees_of_a_hand_in_a_frame(tmp_path: Path) -> None:
    angles = np.zeros((15, 3))
    angles[0] = np.radians([12.5, -3.25, 0.5])
    angles[14, 0] = np.pi / 2
    (row,) = read(write_angles(tmp_path / "new" / "angles.csv", [still_hand(angles, "left")]))
    assert list(row)[:5] == ["hand", "side", "frame", "time_s", "observed"]
    assert len(row) == 5 + 45
    assert list(row.values())[:5] == ["1", "left", "0", "0.0", "1"]
    named = {
        "index_MCP_bend_degrees": 12.5,
        "index_MCP_splay_degrees": -3.25,
        "index_MCP_twist_degrees": 0.5,
        "thumb_IP_bend_degrees": 90,
    }
    found = {name: float(value) for name, value in list(row.items())[5:] if float(value)}
    assert found == named


def test_rows_are_hand_by_hand_with_times_of_the_clip(tmp_path: Path) -> None:
    hands = [
        with_gap(moving_hand(1, "left", Clip(frames=3)), 1),
        moving_hand(2, "right", Clip(frames=2, start=5)),
    ]
    rows = read(write_angles(tmp_path / "angles.csv", hands))
    keys = [(row["hand"], row["side"], row["frame"], row["observed"]) for row in rows]
    assert keys == [
        ("1", "left", "0", "1"), ("1", "left", "1", "0"), ("1", "left", "2", "1"),
        ("2", "right", "5", "1"), ("2", "right", "6", "1"),
    ]  # fmt: skip
    assert [float(row["time_s"]) for row in rows] == pytest.approx(
        [0, 1 / 30, 2 / 30, 5 / 30, 6 / 30], abs=1e-6
    )
    expected = np.degrees(np.concatenate([one.joint_angles.reshape(-1, 45) for one in hands]))
    found = np.array([[float(value) for value in list(row.values())[5:]] for row in rows])
    assert np.abs(found - expected).max() <= 0.5001e-4


def test_files_are_not_overwritten_and_need_a_hand(tmp_path: Path) -> None:
    table, plot = tmp_path / "angles.csv", tmp_path / "angles.png"
    for path in (table, plot):
        path.write_text("mine")
    with pytest.raises(FileExistsError, match=r"angles\.csv exists and is not overwritten"):
        write_angles(table, [still_hand()])
    with pytest.raises(FileExistsError, match=r"angles\.png exists and is not overwritten"):
        write_angles_plot(plot, [still_hand()], RANGES)
    assert table.read_text() == plot.read_text() == "mine"
    with pytest.raises(ValueError, match="Found no hand"):
        write_angles(tmp_path / "other.csv", [])
    with pytest.raises(ValueError, match="Found no hand"):
        write_angles_plot(tmp_path / "other.png", [], RANGES)
    assert len(list(tmp_path.iterdir())) == 2


def test_steps_at_unseen_frames_are_bridged() -> None:
    observed = np.array([True, True, False, False, True, False, True, True])
    assert bridged_steps(observed).tolist() == [False, True, True, True, True, True, False]
    assert lone_frames(observed).tolist() == [False] * 4 + [True] + [False] * 3
    assert lone_frames(np.array([True])).tolist() == [True]
    assert bridged_steps(np.array([True])).shape == (0,)


def test_a_panel_shades_the_range_of_its_angle() -> None:
    figure = angles_figure([moving_hand()], RANGES)
    panels = {axes.get_title(loc="left"): axes for axes in figure.axes}
    assert len(panels) == 20
    for title, lower, upper in [
        ("index MCP bend", -25.9, 84.7), ("little MCP splay", -54.6, 15.1), ("thumb IP bend", -15, 80),
        ("ring PIP bend", -10, 100), ("thumb CMC splay", -30, 12),
    ]:  # fmt: skip
        (band,) = [patch for patch in panels[title].patches if isinstance(patch, Rectangle)]
        assert band.get_y() == pytest.approx(lower, abs=1e-3)
        assert band.get_y() + band.get_height() == pytest.approx(upper, abs=1e-3)


def test_a_panel_shows_its_angle_and_dashes_gaps() -> None:
    trajectory = with_gap(moving_hand(1, "right", Clip(frames=8)), 0, 3, 4)
    figure = angles_figure([trajectory], RANGES)
    (axes,) = [one for one in figure.axes if one.get_title(loc="left") == "middle DIP bend"]
    degrees = np.degrees(trajectory.joint_angles[:, 5, 0])
    lines = {
        "dashed" if line.is_dashed() else "solid": np.asarray(line.get_ydata(), dtype=float)
        for line in axes.get_lines()
        if len(np.asarray(line.get_xdata())) == 8
    }
    seen = np.array([False, True, True, False, False, True, True, True])
    assert np.array_equal(lines["solid"], np.where(seen, degrees, np.nan), equal_nan=True)
    # A gap's line begins and ends at the frames that were seen.
    dashed = np.array([True, True, True, True, True, True, False, False])
    assert np.array_equal(lines["dashed"], np.where(dashed, degrees, np.nan), equal_nan=True)


def test_no_line_leads_over_a_gap_that_was_not_bridged() -> None:
    gap = without_frames(moving_hand(), *range(5, 12))
    for axes in angles_figure([gap], RANGES).axes:
        drawn = [line for line in axes.get_lines() if len(np.asarray(line.get_xdata())) > 2]
        assert len(drawn) == 2
        for line in drawn:
            times, degrees = (np.asarray(one, dtype=float) for one in line.get_data())
            shown = np.isfinite(degrees)
            joined = shown[1:] & shown[:-1]
            # No segment is longer than a frame.
            assert (np.diff(times)[joined] < 1.5 / 30).all()


def test_axes_hold_angles_beyond_the_range_and_begin_with_the_clip() -> None:
    angles = np.zeros((15, 3))
    angles[:, 0] = np.radians(150)
    later = replace(still_hand(angles), times=np.array([2.0]))
    for axes in angles_figure([later], RANGES).axes:
        low, high = axes.get_ylim()
        assert low < 0
        assert high > (150 if axes.get_title(loc="left").endswith("bend") else 8)
        assert axes.get_xlim()[0] == 0
        assert axes.get_xlim()[1] > 2


def test_the_legend_names_hands_and_gaps(tmp_path: Path) -> None:
    hands = [moving_hand(1, "left"), moving_hand(2, "right", Clip(seed=1))]

    def names(trajectories: list[Trajectory]) -> list[str]:
        (legend,) = angles_figure(trajectories, RANGES).legends
        return [text.get_text() for text in legend.get_texts()]

    assert names(hands) == ["hand 1, left", "hand 2, right", "range of motion"]
    assert "bridged gap" in names([hands[0], with_gap(hands[1], 4)])
    image = cv2.imread(str(write_angles_plot(tmp_path / "new" / "angles.png", hands, RANGES)))
    assert image is not None
    assert image.shape[0] > 900
    # Curves in the colours of both hands: one bluer, one greener.
    blue, green, red = (image[..., channel].astype(int) for channel in range(3))
    assert ((blue - red > 40) & (blue > green)).sum() > 500
    assert ((green - blue > 40) & (green > red)).sum() > 500


def test_colours_are_those_of_the_sides_and_then_others() -> None:
    sides: list[Side] = ["right", "left", "right", "right"]
    hands = [moving_hand(number, side, Clip(frames=2)) for number, side in enumerate(sides)]
    colours = hand_colours(hands)
    assert colours[:2] == [HAND_COLOURS["right"], HAND_COLOURS["left"]]
    assert len(set(colours)) == 4
    many = hand_colours([moving_hand(number, "left", Clip(frames=2)) for number in range(9)])
    assert many[1] == many[7]
