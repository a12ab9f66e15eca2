"""The official scripts' own output, to its printed digits: every case, every protocol.

`tests/golden/scores.json` is what the unmodified scripts printed for `arrays.npz` (random hands).
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from hand_recon.evaluation.scores import HandPoints
from hand_recon.protocols.official import dexycb_scores, freihand_scores, ho3d_scores

GOLDEN = Path(__file__).parents[1] / "golden"
SCORES: dict[str, dict[str, Any]] = json.loads((GOLDEN / "scores.json").read_text())


def golden_hands(case: str) -> tuple[HandPoints, HandPoints]:
    """Ground truth and prediction of a golden case."""
    arrays = {
        name: torch.from_numpy(array).double()
        for name, array in np.load(GOLDEN / "arrays.npz").items()
    }
    truth = HandPoints(arrays["gt_joints"], arrays["gt_verts"])
    factor = {"mirror_x": torch.tensor([-1.0, 1.0, 1.0]), "zeros": torch.zeros(3)}
    shift = {"shift_10mm_x": torch.tensor([0.01, 0.0, 0.0], dtype=torch.float64)}
    if case == "noise":
        return truth, HandPoints(arrays["pred_joints"], arrays["pred_verts"])

    def changed(points: torch.Tensor) -> torch.Tensor:
        return points * factor.get(case, torch.ones(3)) + shift.get(case, torch.zeros(3))

    return truth, HandPoints(changed(arrays["gt_joints"]), changed(arrays["gt_verts"]))


@pytest.mark.parametrize("case", SCORES)
def test_freihand_prints_the_same_digits(case: str) -> None:
    scores = freihand_scores(*golden_hands(case))
    assert {name: round(value, 6) for name, value in scores.items()} == SCORES[case]["freihand"]


@pytest.mark.parametrize("case", [case for case in SCORES if "ho3d_v3" in SCORES[case]])
def test_ho3d_prints_the_same_digits(case: str) -> None:
    scores = ho3d_scores(*golden_hands(case))
    assert {name: round(value, 6) for name, value in scores.items()} == SCORES[case]["ho3d_v3"]


@pytest.mark.parametrize("case", SCORES)
def test_dexycb_computes_the_same_numbers(case: str) -> None:
    scores = dexycb_scores(*golden_hands(case))
    expected = SCORES[case]["dexycb_hpe_formula"]
    assert scores.keys() == expected.keys()
    for alignment, values in scores.items():
        assert values == pytest.approx(expected[alignment], rel=1e-9, abs=1e-12)


def test_zeros_have_a_finite_score_under_every_protocol() -> None:
    assert all(np.isfinite(list(ho3d_scores(*golden_hands("zeros")).values())))
