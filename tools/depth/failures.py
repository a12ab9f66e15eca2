"""Causes of the largest errors: fingers and wrists that are wrong in depth."""

from typing import Final

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from depth.comparison import Scored, worst
from hand_recon.evaluation.alignment import align_official
from hand_recon.hand.skeleton import LANDMARKS

ENDS: Final = tuple(
    (LANDMARKS.index(f"{finger} {base}"), LANDMARKS.index(f"{finger} tip"))
    for finger, base in (
        ("thumb", "CMC"), ("index", "MCP"), ("middle", "MCP"), ("ring", "MCP"), ("little", "MCP")
    )
)  # fmt: skip
"""Base and tip of each finger."""

FLIPPED: Final = 0.02
"""Least error of the depth between base and tip of a finger that is called flipped, metres."""

WRIST_OFF: Final = 0.015
"""Least error of the wrist's depth that is counted, metres."""


def depth_errors(scored: Scored) -> Float[Tensor, "hand landmark=21 3"]:
    """Aligned fit minus ground truth in the camera's axes, metres; depth is the last."""
    aligned = align_official(scored.hands.ground_truth, scored.run.landmarks_3d)
    return aligned - scored.hands.ground_truth


def flipped_fingers(
    ground_truth: Float[Tensor, "hand landmark=21 3"], errors: Float[Tensor, "hand landmark=21 3"]
) -> Bool[Tensor, "hand finger=5"]:
    """Fingers that point towards the camera in place of away from it, or the other way round.

    Args:
        ground_truth: Landmarks, camera frame, metres.
        errors: Aligned fit minus ground truth, metres.
    """
    base, tip = (torch.tensor(ends) for ends in zip(*ENDS, strict=True))
    away = ground_truth[:, tip, 2] - ground_truth[:, base, 2]
    off = errors[:, tip, 2] - errors[:, base, 2]
    return (away * (away + off) < 0) & (off.abs() > FLIPPED)


def markdown_failures(scored: Scored) -> str:
    """Table of the worst tenth of the hands beside all of them.

    Args:
        scored: The run.
    """
    errors = depth_errors(scored)
    flips = flipped_fingers(scored.hands.ground_truth, errors).any(dim=1)
    lines = [
        f"| {scored.hands.name}, {scored.run.method.name} | hands | PA-MPJPE, mm | squared error in depth, % "
        f"| a flipped finger, % | wrist's depth {1000 * WRIST_OFF:.0f} mm off, % | largest landmarks, mm |",
        "|" + " --- |" * 7,
    ]
    tenth = worst(scored, max(1, len(scored.hands) // 10))
    for name, rows in (("all", list(range(len(scored.hands)))), ("worst tenth", tenth)):
        squares = errors[rows].square()
        in_depth = squares[..., 2].sum() / squares.sum()
        of_landmark = scored.landmark_errors[rows].mean(dim=0)
        largest = of_landmark.argsort(descending=True)[:4].tolist()
        named = ", ".join(f"{LANDMARKS[each]} {float(of_landmark[each]):.0f}" for each in largest)
        cells = [
            name, str(len(rows)), f"{float(scored.errors[rows].mean()):.1f}", _percent(in_depth),
            _percent(flips[rows].double().mean()),
            _percent((errors[rows, 0, 2].abs() > WRIST_OFF).double().mean()), named,
        ]  # fmt: skip
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _percent(share: Tensor) -> str:
    return f"{100 * float(share):.0f}"
