"""Plot of joint angles over time, in front of their ranges of motion."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from jaxtyping import Bool, Float

from hand_recon.formats.hand_colours import hand_colours
from hand_recon.formats.joint_motion import SINGLE_FRAME, check_motions
from hand_recon.formats.new_file import write_new
from hand_recon.hand.skeleton import ARTICULATED, AXES, FINGERS
from hand_recon.knowledge.ranges import RangeOfMotion
from hand_recon.motion.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FINGER_ANGLES: Final = (("MCP", "bend"), ("PIP", "bend"), ("DIP", "bend"), ("MCP", "splay"))
"""Joint and axis of the angles that are drawn of a finger."""

THUMB_ANGLES: Final = (("CMC", "bend"), ("MCP", "bend"), ("IP", "bend"), ("CMC", "splay"))
"""Joint and axis of the angles that are drawn of the thumb."""

_RANGE: Final = "#e0e9e0"
_DASHES: Final = (0, (2, 1.2))
_TICKS: Final = {"bend": 30.0, "splay": 15.0}
_MARGIN: Final = 8.0
_WIDTH: Final = 12.0
_ROW: Final = 1.75


def write_angles_plot(
    path: str | Path, trajectories: Sequence[Trajectory], ranges: RangeOfMotion
) -> Path:
    """Draw the angles of all hands of a clip as a PNG file; folders are made.

    Each finger has a row: bend of its three joints, and splay of the first. Hands differ in colour, ranges of
    motion are shaded, and bridged gaps are dashed and paler. Angles that the literature gives no freedom
    (twist, splay of the outer joints) are in the table only. Needs matplotlib (the extra `train`).

    Args:
        path: File to write.
        trajectories: Hands of one clip.
        ranges: Ranges of motion, one set for all hands.

    Raises:
        FileExistsError: The file exists.
        ValueError: There is no hand, a hand has no frame, numbers are not finite, or a time is negative.
    """
    check_motions(trajectories)
    stream = io.BytesIO()
    angles_figure(trajectories, ranges).savefig(stream, format="png", dpi=110)
    return write_new(path, stream.getvalue())


def bridged_steps(observed: Bool[np.ndarray, " frame"]) -> Bool[np.ndarray, " step"]:
    """Mask of the steps from frame to frame that begin or end where the hand was not seen."""
    return ~(observed[1:] & observed[:-1])


def lone_frames(observed: Bool[np.ndarray, " frame"]) -> Bool[np.ndarray, " frame"]:
    """Mask of the frames in which the hand was seen, but not in the frame before or after."""
    around = np.pad(observed, 1)
    return observed & ~around[:-2] & ~around[2:]


def angles_figure(trajectories: Sequence[Trajectory], ranges: RangeOfMotion) -> "Figure":
    """Draw the figure of `write_angles_plot`.

    Args:
        trajectories: Hands of one clip.
        ranges: Ranges of motion, one set for all hands.
    """
    # Half a second, which commands that draw no plot should not wait for.
    from matplotlib.figure import Figure
    from matplotlib.ticker import MultipleLocator

    # Without pyplot, which keeps global state and may ask for a display.
    figure = Figure(figsize=(_WIDTH, _ROW * len(FINGERS) + 0.6), layout="constrained")
    grid = figure.subplots(len(FINGERS), len(FINGER_ANGLES), sharex=True, squeeze=False)
    for row, finger in enumerate(FINGERS):
        angles = THUMB_ANGLES if finger == "thumb" else FINGER_ANGLES
        for column, (part, axis) in enumerate(angles):
            axes = grid[row, column]
            index = ARTICULATED.index(f"{finger} {part}"), AXES.index(axis)
            axes.set_title(f"{finger} {part} {axis}", fontsize=9, loc="left", pad=3)
            _draw_range(axes, ranges, index)
            for trajectory, colour in zip(trajectories, hand_colours(trajectories), strict=True):
                degrees = np.degrees(trajectory.joint_angles[:, index[0], index[1]])
                _draw_angle(axes, trajectory, degrees, _darker(colour))
            axes.spines[["top", "right"]].set_visible(False)
            axes.tick_params(labelsize=8)
            axes.yaxis.set_major_locator(MultipleLocator(_TICKS[axis]))
        grid[row, 0].set_ylabel("degrees", fontsize=8)
    end = max(float(trajectory.times[-1]) for trajectory in trajectories)
    # All axes share it. The clip begins at zero, whenever its first hand does.
    grid[0, 0].set_xlim(0.0, max(end, SINGLE_FRAME) * 1.01)
    for axes in grid[-1]:
        axes.set_xlabel("time, s", fontsize=8)
    _add_legend(figure, trajectories)
    return figure


def _draw_range(axes: "Axes", ranges: RangeOfMotion, index: tuple[int, int]) -> None:
    lower, upper = (float(bound[index].rad2deg()) for bound in (ranges.lower, ranges.upper))
    axes.axhspan(lower, upper, color=_RANGE, linewidth=0, zorder=0)
    axes.axhline(0.0, color="#b0b0b0", linewidth=0.6, zorder=1)
    # Sets the limits from the range, which angles beyond it widen.
    axes.set_ylim(lower - _MARGIN, upper + _MARGIN)


def _draw_angle(
    axes: "Axes",
    trajectory: Trajectory,
    degrees: Float[np.ndarray, " frame"],
    colour: tuple[float, float, float],
) -> None:
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, degrees.min() - _MARGIN), max(high, degrees.max() + _MARGIN))
    # No line leads over a gap that was not bridged.
    after = np.flatnonzero(np.diff(trajectory.frames) > 1) + 1
    times = np.insert(trajectory.times, after, trajectory.times[after])
    observed = np.insert(trajectory.observed, after, values=False)
    degrees = np.insert(degrees, after, np.nan)
    axes.plot(times, np.where(observed, degrees, np.nan), color=colour, linewidth=1.4, zorder=3)
    # A frame between two gaps has no line.
    single = lone_frames(observed)
    axes.plot(
        times[single], degrees[single], color=colour, linestyle="", marker="o",
        markersize=2.5, zorder=3,
    )  # fmt: skip
    bridged = np.full_like(degrees, np.nan)
    steps = bridged_steps(observed)
    for part in (slice(None, -1), slice(1, None)):
        bridged[part][steps] = degrees[part][steps]
    axes.plot(
        times, bridged, color=colour, linewidth=1.3, linestyle=_DASHES, alpha=0.65, zorder=2
    )  # fmt: skip


def _add_legend(figure: "Figure", trajectories: Sequence[Trajectory]) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Line2D | Patch] = [
        Line2D([], [], color=_darker(colour), label=f"hand {trajectory.hand}, {trajectory.side}")
        for trajectory, colour in zip(trajectories, hand_colours(trajectories), strict=True)
    ]
    if not all(trajectory.observed.all() for trajectory in trajectories):
        handles.append(
            Line2D([], [], color="grey", linestyle=_DASHES, alpha=0.65, label="bridged gap")
        )
    handles.append(Patch(color=_RANGE, label="range of motion"))
    figure.legend(handles=handles, loc="outside upper center", ncols=6, fontsize=9, frameon=False)


def _darker(colour: tuple[float, float, float]) -> tuple[float, float, float]:
    """A colour for thin lines on white, 0 to 1."""
    red, green, blue = (0.72 * value / 255 for value in colour)
    return red, green, blue
