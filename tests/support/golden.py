"""Random hands and the scores that the official scripts printed for them (tests/golden)."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import torch

from hand_recon.evaluation.scores import HandPoints

GOLDEN = Path(__file__).parents[1] / "golden"
"""`arrays.npz` has the hands; `scores.json` is the output of the unmodified scripts."""

SCORES: dict[str, dict[str, Any]] = json.loads((GOLDEN / "scores.json").read_text())
"""Official scores by case and protocol."""


def golden_hands(case: str) -> tuple[HandPoints, HandPoints]:
    """Ground truth and prediction of a golden case."""
    arrays = {
        name: torch.from_numpy(array).double()
        for name, array in np.load(GOLDEN / "arrays.npz").items()
    }
    ground_truth = HandPoints(arrays["gt_joints"], arrays["gt_verts"])
    factor = {"mirror_x": torch.tensor([-1.0, 1.0, 1.0]), "zeros": torch.zeros(3)}
    shift = {"shift_10mm_x": torch.tensor([0.01, 0.0, 0.0], dtype=torch.float64)}
    if case == "noise":
        return ground_truth, HandPoints(arrays["pred_joints"], arrays["pred_verts"])

    def changed(points: torch.Tensor) -> torch.Tensor:
        return points * factor.get(case, torch.ones(3)) + shift.get(case, torch.zeros(3))

    return ground_truth, HandPoints(changed(arrays["gt_joints"]), changed(arrays["gt_verts"]))
