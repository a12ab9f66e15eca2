"""σ and confidences of landmarks in `hand_recon.fit`: their effect, and what is in the file of hands."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from hand_recon.hand.model import HandModel
from hand_recon.runs.fit_run import fit
from tests.support.fit_command import asked, entries_of, seen, write_landmarks


@pytest.fixture
def landmarks(hand: HandModel, tmp_path: Path) -> Path:
    return write_landmarks(hand, tmp_path)


def test_how_sure_the_detector_was_matters(hand: HandModel, tmp_path: Path) -> None:
    """A wrong tip, believed in or not: the surer the detector, the nearer to what it said."""
    pixels, _ = seen(hand, 1)
    wrong = pixels.clone()
    wrong[0, 8] += torch.tensor([30.0, -30.0])
    off = []
    for confidence in (0.9, 0.05):
        path = tmp_path / f"{confidence}.json"
        third = torch.full((1, 21, 1), 0.9)
        third[0, 8] = confidence
        path.write_text(json.dumps(torch.cat([wrong, third], dim=-1).tolist()))
        output = tmp_path / f"out_{confidence}"
        fit(
            asked(
                output,
                f"landmarks={path}",
                "third_value=confidence",
                "data_term=nll",
                "descent.steps=80",
            )
        )
        tip = entries_of(output)[0]["landmarks_2d"][8]
        off.append(float(np.hypot(*np.subtract(tip, wrong[0, 8].numpy()))))
    assert off[1] > off[0] + 5


def test_given_sigma_is_in_the_result_and_is_read_again(hand: HandModel, tmp_path: Path) -> None:
    """σ in the file of hands is the one of the landmarks; without one there is none."""
    points, sigma = seen(hand, 1)[0].numpy(), np.linspace(2.0, 6.0, 21)
    plain, with_sigma, output = (tmp_path / name for name in ("a.json", "b.json", "out"))
    plain.write_text(json.dumps([{"landmarks": points[0].tolist()}]))
    with_sigma.write_text(json.dumps([{"landmarks": points[0].tolist(), "sigma": sigma.tolist()}]))
    results = []
    for path in (plain, with_sigma, output / "b" / "hands.json"):
        folder = output / path.stem
        fit(asked(folder, f"landmarks={path}", "descent.starts=1"))
        results.append(entries_of(folder)[0])
    assert results[0]["sigma_2d"] is None
    np.testing.assert_allclose(results[1]["sigma_2d"], np.stack([sigma, sigma], 1), rtol=1e-5)
    np.testing.assert_allclose(results[2]["sigma_2d"], results[1]["sigma_2d"], rtol=1e-5)
    np.testing.assert_allclose(results[2]["landmarks_3d"], results[1]["landmarks_3d"], atol=1e-4)
    assert np.linalg.eigvalsh(results[1]["covariance_3d"]).min() > 0


def test_sigma_of_a_confidence_is_read_again(landmarks: Path, tmp_path: Path) -> None:
    """Fitted again with the σ that its confidences gave, a hand is the same."""
    results: list[list[dict[str, Any]]] = []
    for path in (landmarks, tmp_path / "first" / "hands.json"):
        folder = tmp_path / ("second" if results else "first")
        fit(asked(folder, f"landmarks={path}", "third_value=confidence", "descent.starts=1"))
        results.append(entries_of(folder))
    first, second = results
    assert [hand["sigma_2d"] is None for hand in first] == [False, False, True]
    np.testing.assert_allclose(second[0]["sigma_2d"], first[0]["sigma_2d"], rtol=1e-5)
    np.testing.assert_allclose(second[0]["landmarks_3d"], first[0]["landmarks_3d"], atol=1e-4)


def test_a_hand_without_sigma_beside_one_with_has_none(hand: HandModel, tmp_path: Path) -> None:
    points = seen(hand, 2)[0].tolist()
    path = tmp_path / "mixed.json"
    path.write_text(
        json.dumps([{"landmarks": points[0], "sigma": [4.0] * 21}, {"landmarks": points[1]}])
    )
    fit(asked(tmp_path / "out", f"landmarks={path}", "descent.starts=1"))
    sigma = [one["sigma_2d"] for one in entries_of(tmp_path / "out")]
    np.testing.assert_allclose(sigma[0], 4.0, rtol=1e-5)
    assert sigma[1] is None
