"""Contact sheets of the open hand for `docs/open_hand.md`: `python tools/draw_open_hand.py`.

Matplotlib draws flat-shaded faces sorted by depth: slow, but small files that are the same on every machine.
"""

import argparse
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
import torch
from jaxtyping import Float
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from PIL import Image
from torch import Tensor

from hand_recon.hand.model import HandModel
from hand_recon.hand.open_hand import open_hand
from hand_recon.hand.skeleton import ARTICULATED, AXES, LANDMARK_PARENTS
from hand_recon.knowledge.ranges import load_ranges

IMAGES = Path(__file__).resolve().parents[1] / "docs" / "images"
SKIN = np.array([0.93, 0.76, 0.66])
INSIDE = np.array([0.45, 0.10, 0.08])
LIGHT = np.array([0.30, 0.35, 0.89])

SHAPE_NAMES = (
    "size", "finger vs palm length", "finger thickness", "palm breadth", "thumb length",
    "palm thickness", "index vs ring", "little finger", "taper", "build",
)  # fmt: skip

OPPOSITION = {
    "index": {"thumb CMC": (18, 0), "thumb MCP": (13, 0), "thumb IP": (-13, 0),
              "index MCP": (55, -22), "index PIP": (43, 0), "index DIP": (24, 0)},
    "middle": {"thumb CMC": (31, 7), "thumb MCP": (8, 0), "thumb IP": (-13, 0),
               "middle MCP": (56, -22), "middle PIP": (55, 0), "middle DIP": (14, 0)},
    "ring": {"thumb CMC": (31, 11), "thumb MCP": (30, 0), "thumb IP": (-14, 0),
             "ring MCP": (48, -32), "ring PIP": (68, 0), "ring DIP": (3, 0)},
    "little": {"thumb CMC": (32, 12), "thumb MCP": (53, 0), "thumb IP": (-14, 0),
               "little MCP": (39, -54), "little PIP": (84, 0), "little DIP": (1, 0)},
    "little's base": {"thumb CMC": (33, -12), "thumb MCP": (54, 0), "thumb IP": (16, 0),
                      "little MCP": (59, -3), "little PIP": (3, 0), "little DIP": (2, 0)},
}  # fmt: skip
"""Poses of Kapandji's test, bend and splay in degrees, found by the search in `tests/hand/test_thumb.py`."""


@dataclass(frozen=True)
class View:
    """Direction of an orthographic view."""

    name: str
    """Name in the titles."""
    axes: Float[np.ndarray, "3 3"]
    """Rows: right, up and towards the viewer in the hand's frame."""


def _view(name: str, towards: Sequence[float]) -> View:
    z = np.asarray(towards, float) / np.linalg.norm(towards)
    x = np.cross([-1.0, 0.0, 0.0], z)
    x /= np.linalg.norm(x)
    return View(name, np.stack([x, np.cross(z, x), z]))


BACK = _view("back", (0, 1, 0))
PALM = _view("palm", (0, -1, 0))
SIDE = _view("thumb side", (0, 0, 1))
OBLIQUE = _view("oblique", (-0.3, -0.6, 0.7))


def pose(
    hand: HandModel, degrees: Mapping[str, Sequence[float]]
) -> Float[Tensor, "joint=15 axis=3"]:
    """Joint angles, radians, with the named joints at the given bend, splay and twist in degrees."""
    angles = hand.neutral_angles()
    for joint, values in degrees.items():
        angles[ARTICULATED.index(joint), : len(values)] = torch.tensor(values).float().deg2rad()
    return angles


def draw(
    axis: Axes, hand: HandModel, angles: Tensor, view: View, shape: Tensor | None = None
) -> None:
    """Draw one hand in one view."""
    posed = hand(angles, torch.zeros(10) if shape is None else shape)
    points = posed.vertices.numpy() @ view.axes.T
    corners = points[hand.faces.numpy()]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    shade = (0.22 + 0.75 * normals @ LIGHT).clip(0.08, 1.0)[:, None]
    colours = np.where(normals[:, 2:] > 0, shade * SKIN, INSIDE)
    order = np.argsort(corners[:, :, 2].mean(axis=1))
    faces = PolyCollection(
        list(corners[order][:, :, :2]), facecolors=colours[order], edgecolors=colours[order] * 0.8,
        linewidths=0.15,
    )  # fmt: skip
    axis.add_collection(faces)
    axis.set_aspect("equal")
    axis.set_xlim(-0.11, 0.11)
    axis.set_ylim(-0.11, 0.115)
    axis.axis("off")


def draw_landmarks(axis: Axes, hand: HandModel, angles: Tensor, view: View, colour: str) -> None:
    """Draw the skeleton of the hand's landmarks over the image."""
    points = hand(angles, torch.zeros(10)).landmarks.numpy() @ view.axes.T
    for landmark, parent in enumerate(LANDMARK_PARENTS):
        if parent >= 0:
            axis.plot(*points[[parent, landmark], :2].T, color=colour, linewidth=0.7)
    axis.plot(points[:, 0], points[:, 1], ".", color=colour, markersize=3)


def rest_sheet(hand: HandModel, path: Path) -> None:
    """Draw rest pose, neutral pose, bent MCPs and a fist in four views, with both landmark sets."""
    fingers = ("index", "middle", "ring", "little")
    poses = {
        "rest": hand.rest_angles,
        "neutral: all angles zero": hand.neutral_angles(),
        "MCP 80°": pose(hand, {f"{f} MCP": (80,) for f in fingers}),
        "fist": pose(
            hand,
            {f"{f} {j}": (b,) for f in fingers for j, b in (("MCP", 80), ("PIP", 95), ("DIP", 55))},
        ),
    }
    figure, axes = plt.subplots(len(poses), 4, figsize=(8, 2.2 * len(poses)))
    sets = {"#1f5fbf": hand, "#c02020": open_hand("mano")}
    for row, (name, angles) in zip(axes, poses.items(), strict=True):
        for axis, view in zip(row, (BACK, PALM, SIDE, OBLIQUE), strict=True):
            draw(axis, hand, angles, view)
            axis.set_title(f"{name}, {view.name}", fontsize=7)
            if view is BACK:
                for colour, model in sets.items():
                    draw_landmarks(axis, model, angles, view, colour)
    _save(figure, path)


def shape_sheet(hand: HandModel, path: Path) -> None:
    """Draw each shape direction at −2 and +2 standard deviations, from the back and from the side."""
    figure, axes = plt.subplots(5, 8, figsize=(13, 9))
    for direction, name in enumerate(SHAPE_NAMES):
        row, start = axes[direction // 2], 4 * (direction % 2)
        for column, (amount, view) in enumerate(((-2, BACK), (2, BACK), (-2, SIDE), (2, SIDE))):
            shape = torch.zeros(10)
            shape[direction] = amount
            draw(row[start + column], hand, hand.rest_angles, view, shape)
            row[start + column].set_title(f"{name} {amount:+d}σ", fontsize=7)
    _save(figure, path)


def joint_sheet(hand: HandModel, path: Path) -> None:
    """Draw every free joint axis at both ends of its range in the literature."""
    ranges = load_ranges("literature")
    free = [
        (joint, axis)
        for joint in range(15)
        for axis in range(3)
        if ranges.upper[joint, axis] > ranges.lower[joint, axis]
    ]
    figure, axes = plt.subplots(7, 6, figsize=(11, 13))
    for axis in axes.flat:
        axis.axis("off")
    for index, (joint, angle) in enumerate(free):
        view = (
            PALM if ARTICULATED[joint].startswith("thumb") and angle == 0 else (SIDE, BACK)[angle]
        )
        for end, bound in enumerate((ranges.lower, ranges.upper)):
            angles = hand.neutral_angles()
            angles[joint, angle] = bound[joint, angle]
            target = axes.flat[2 * index + end]
            draw(target, hand, angles, view)
            degrees = float(bound[joint, angle].rad2deg())
            target.set_title(f"{ARTICULATED[joint]} {AXES[angle]} {degrees:.0f}°", fontsize=6)
    _save(figure, path)


def opposition_sheet(hand: HandModel, path: Path) -> None:
    """Draw Kapandji's test: the thumb's pad on each fingertip and on the base of the little finger."""
    figure, axes = plt.subplots(2, len(OPPOSITION), figsize=(2.2 * len(OPPOSITION), 4.6))
    for column, (name, degrees) in enumerate(OPPOSITION.items()):
        for row, view in enumerate((PALM, _view("from the fingertips", (-0.7, -0.6, 0.4)))):
            draw(axes[row, column], hand, pose(hand, degrees), view)
            axes[row, column].set_title(f"{name}, {view.name}", fontsize=7)
    _save(figure, path)


def _save(figure: Figure, path: Path) -> None:
    figure.tight_layout(pad=0.3)
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=90)
    plt.close(figure)
    # Few colours keep the files small enough for the repository.
    Image.open(buffer).convert("RGB").quantize(96).save(path, optimize=True)


def main() -> None:
    """Draw all sheets."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=IMAGES, help="folder for the images")
    folder = parser.parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    mpl.use("Agg")
    torch.set_num_threads(1)
    hand = open_hand()
    rest_sheet(hand, folder / "open_hand_rest.png")
    shape_sheet(hand, folder / "open_hand_shape.png")
    joint_sheet(hand, folder / "open_hand_joints.png")
    opposition_sheet(hand, folder / "open_hand_opposition.png")


if __name__ == "__main__":
    main()
