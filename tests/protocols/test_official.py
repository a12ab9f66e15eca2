"""The official scripts' own output, to its printed digits: every case, every protocol.

`tests/golden/scores.json` is what the unmodified scripts printed for `arrays.npz` (random hands).
"""

import numpy as np
import pytest

from hand_recon.protocols.official import dexycb_scores, freihand_scores, ho3d_scores
from tests.support.golden import SCORES, golden_hands


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
