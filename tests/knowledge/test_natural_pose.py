"""Natural poses: the table, its distance against nested loops, and what it says about fingers."""

import math
from pathlib import Path

import pytest
import torch

from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import ARTICULATED
from hand_recon.knowledge import natural_pose
from hand_recon.knowledge.natural_pose import NaturalPoseTerm, natural_poses
from hand_recon.knowledge.pose_distance import PoseDistance
from hand_recon.schema import HandParameters


def bend(name: str) -> int:
    """Place of a joint's bend among the 45 angles."""
    return 3 * ARTICULATED.index(name)


def hands(angles: torch.Tensor) -> HandParameters:
    """Hands of these joint angles."""
    count = len(angles)
    return HandParameters(
        angles, torch.zeros(count, 10), torch.eye(3).expand(count, 3, 3), torch.zeros(count, 3)
    )


def test_the_distance_is_that_of_nested_loops() -> None:
    mean, root = torch.randn(45), torch.randn(45, 45)
    covariance = root @ root.mT / 45 + 0.1 * torch.eye(45)
    angles = torch.randn(2, 15, 3)
    found = PoseDistance.of_gaussian(mean, covariance)(angles)
    inverse = torch.linalg.inv(covariance.double()).tolist()
    for hand in range(2):
        away = (angles[hand].flatten() - mean).tolist()
        expected = sum(away[i] * inverse[i][j] * away[j] for i in range(45) for j in range(45))
        assert float(found[hand]) == pytest.approx(expected, rel=1e-3)


def test_the_mean_pose_costs_nothing_and_a_standard_deviation_one(hand: HandModel) -> None:
    mean, covariance = natural_poses()
    values, vectors = torch.linalg.eigh(covariance.double())
    along = (values.sqrt() * vectors).mT.float()
    angles = torch.cat([mean[None], mean + along]).unflatten(1, (15, 3))
    found = NaturalPoseTerm(hand)(hands(angles), None)
    torch.testing.assert_close(found, torch.tensor([0.0] + 45 * [1.0]), rtol=0, atol=2e-3)


def test_the_table_is_a_covariance_of_angles() -> None:
    mean, covariance = natural_poses()
    torch.testing.assert_close(covariance, covariance.mT)
    assert float(torch.linalg.eigvalsh(covariance.double()).amin()) > 0
    deviation = covariance.diagonal().sqrt()
    assert float(mean.abs().amax()) < math.radians(60)
    assert float(deviation.amax()) < math.radians(45)


@pytest.mark.parametrize("finger", ["index", "middle", "ring", "little"])
def test_pip_and_dip_bend_together(finger: str) -> None:
    _, covariance = natural_poses()
    pip, dip = bend(f"{finger} PIP"), bend(f"{finger} DIP")
    correlation = covariance[pip, dip] / (covariance[pip, pip] * covariance[dip, dip]).sqrt()
    slope = covariance[pip, dip] / covariance[pip, pip]
    assert float(correlation) > 0.6
    assert 0.4 < float(slope) < 0.9  # Two thirds, after Rijpkema and Girard (1991).


def test_neighbours_bend_together_more_than_others() -> None:
    _, covariance = natural_poses()
    deviation = covariance.diagonal().sqrt()
    correlation = covariance / deviation / deviation[:, None]
    near = correlation[bend("middle PIP"), bend("ring PIP")]
    far = correlation[bend("index PIP"), bend("little PIP")]
    assert near > far > 0


def test_the_gradient_is_finite_differences(hand: HandModel) -> None:
    term = NaturalPoseTerm(hand).double()
    angles = torch.randn(2, 15, 3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda a: term.distance(a), angles)


def test_a_missing_table_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(natural_pose, "TABLE", str(Path("tables") / "absent.npz"))
    with pytest.raises(FileNotFoundError, match="learn_from_landmarks"):
        natural_poses()
