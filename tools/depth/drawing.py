"""Sheet of the worst hands of a set, each as the camera sees it and from the side."""

from typing import Final

import numpy as np
import torch
from jaxtyping import Float, UInt8

from depth.comparison import Scored, worst
from hand_recon.evaluation.alignment import align_official
from hand_recon.hand.skeleton import LANDMARKS
from hand_recon.visualization.canvas import Panel, sheet
from hand_recon.visualization.hand_marks import draw_given, draw_skeleton

SIDE: Final = 250
"""Side of a panel, pixels."""

GREY: Final = 205
"""Background, on which the white lines between given and fitted landmarks are seen."""

PAIRS: Final = 3
"""Hands in a row of the sheet."""

VIEWS: Final = ("camera: given ○, fit", "from the side: ground truth ○, fit")
"""Titles of a hand's two panels."""


def draw_worst(scored: Scored, count: int) -> UInt8[np.ndarray, "height width 3"]:
    """Draw the worst hands: given landmarks with the fit's projection, and ground truth with the aligned fit.

    Rings and thin lines are what was given or measured, thick lines are the fit. From the side, the camera is
    at the left and depth goes to the right.

    Args:
        scored: The run.
        count: Number of hands.
    """
    panels: list[Panel | None] = []
    for place in worst(scored, count):
        title = f"{scored.hands.landmarks.names[place]}: {float(scored.errors[place]):.1f} mm"
        seen, side = _views(scored, place)
        panels += [Panel(seen, title), Panel(side, _largest(scored, place))]
    width = 2 * PAIRS
    panels += [None] * (-len(panels) % width)
    rows = [panels[first : first + width] for first in range(0, len(panels), width)]
    return sheet(rows, columns=VIEWS * PAIRS)


def _largest(scored: Scored, place: int) -> str:
    """The two landmarks of a hand that are farthest off, with their errors."""
    errors = scored.landmark_errors[place]
    order = errors.argsort(descending=True)[:2].tolist()
    return ", ".join(f"{LANDMARKS[index]} {float(errors[index]):.0f}" for index in order) + " mm"


def _views(scored: Scored, place: int) -> tuple[np.ndarray, np.ndarray]:
    found = torch.cat([part.prediction.landmarks_2d for part in scored.run.parts])[place]
    given = scored.hands.landmarks.landmarks_2d[place]
    truth = scored.hands.ground_truth[place]
    aligned = align_official(truth, scored.run.landmarks_3d[place])
    # Depth to the right, the image's v downwards.
    from_the_side = _panel(truth[:, [2, 1]].numpy(), aligned[:, [2, 1]].numpy())
    return _panel(given.numpy(), found.double().numpy()), from_the_side


def _panel(
    given: Float[np.ndarray, "landmark=21 2"], found: Float[np.ndarray, "landmark=21 2"]
) -> UInt8[np.ndarray, "side side 3"]:
    """Draw given and found points, scaled together to fill a panel."""
    both = np.concatenate([given, found])
    low, high = both.min(axis=0), both.max(axis=0)
    scale = 0.86 * SIDE / max(float((high - low).max()), 1e-9)
    given, found = (scale * (points - (low + high) / 2) + SIDE / 2 for points in (given, found))
    canvas = np.full((SIDE, SIDE, 3), GREY, dtype=np.uint8)
    draw_skeleton(canvas, given, 1)
    draw_skeleton(canvas, found, 3)
    draw_given(canvas, given, found, 2)
    return canvas
