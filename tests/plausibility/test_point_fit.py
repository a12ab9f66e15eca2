"""Hands fitted to 3D landmarks with hardly any knowledge."""

import copy

import pytest
import torch

from hand_recon.fitting.second_order.projection import LandmarkProjection
from hand_recon.fitting.second_order.unknowns import COUNT, PLACE, Unknowns
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import AXES
from hand_recon.plausibility.point_fit import PointFitter, PointProblem, wide_prior
from tests.support.audited_hands import bent, natural_angles, parameters_of, points_of


@pytest.fixture(scope="module")
def fitter(hand: HandModel) -> PointFitter:
    return PointFitter(hand)


def test_natural_poses_come_back_from_points_alone(hand: HandModel, fitter: PointFitter) -> None:
    angles = natural_angles(60)
    points = points_of(hand, angles)
    found = fitter(points)
    off = (found.parameters.joint_angles - angles).abs().rad2deg()
    assert float(off[..., AXES.index("bend")].mean()) < 1.0
    assert float(off[..., AXES.index("bend")].max()) < 8.0
    assert float((found.landmarks - points).norm(dim=-1).mean()) < 5e-4


def test_a_joint_far_outside_its_range_is_seen(hand: HandModel, fitter: PointFitter) -> None:
    for name, index in (("index_PIP_bend", (1, 0)), ("ring_DIP_bend", (11, 0))):
        found = fitter(points_of(hand, bent(**{name: -60.0}))).parameters.joint_angles
        assert float(found[0][index].rad2deg()) == pytest.approx(-60.0, abs=5.0)


def test_gradient_and_curvature_match_finite_differences(hand: HandModel) -> None:
    """In double precision; the curvature is Gauss–Newton's, exact where the residual is zero."""
    exact = copy.deepcopy(hand).double()
    points = points_of(hand, natural_angles(2)).double()
    points[0, 3] = torch.nan
    problem = PointProblem.of(LandmarkProjection(exact), wide_prior(exact), points, sigma=0.01)
    parameters = parameters_of(natural_angles(2, seed=5), seed=1).to(torch.float64)
    here = Unknowns(
        parameters.joint_angles, parameters.root_rotation,
        torch.zeros(2, 3, dtype=torch.float64), parameters.shape,
    )  # fmt: skip
    model = problem(here)
    for unknown in (0, 7, 20, 44, 45, 46, 47, 51, 60):
        step = torch.zeros(2, COUNT, dtype=torch.float64)
        step[:, unknown] = 1e-6
        slope = (problem(here.moved(step)).value - problem(here.moved(-step)).value) / 2e-6
        assert torch.allclose(model.gradient[:, unknown], slope, rtol=1e-5, atol=1e-4)
    assert torch.allclose(model.curvature, model.curvature.mT)
    assert float(model.gradient[:, PLACE].abs().max()) == 0.0


def test_translated_and_rotated_points_give_the_same_pose(
    hand: HandModel, fitter: PointFitter
) -> None:
    points = points_of(hand, natural_angles(10))
    turn = torch.linalg.qr(torch.randn(3, 3))[0]
    turn = turn * torch.linalg.det(turn)
    first, second = fitter(points), fitter(points @ turn.mT + 3.0)
    apart = (first.parameters.joint_angles - second.parameters.joint_angles).abs()
    assert float(apart.max()) < 0.02
    assert float(((first.landmarks @ turn.mT + 3.0) - second.landmarks).norm(dim=-1).max()) < 1e-3


def test_missing_landmarks_do_not_change_what_the_others_show(
    hand: HandModel, fitter: PointFitter
) -> None:
    angles = natural_angles(8)
    points = points_of(hand, angles)
    fewer = points.clone()
    fewer[:, 20] = torch.nan
    found = fitter(fewer)
    assert bool(found.landmarks.isfinite().all())
    off = (found.parameters.joint_angles - angles)[:, :6, 0].abs().rad2deg()
    assert float(off.mean()) < 1.5
    assert float((found.landmarks[:, :20] - points[:, :20]).norm(dim=-1).mean()) < 1e-3


def test_a_mirrored_hand_fits_worse(hand: HandModel, fitter: PointFitter) -> None:
    points = points_of(hand, natural_angles(40))
    points = points + 0.002 * torch.randn(points.shape)
    right, mirrored = fitter(points), fitter(points * torch.tensor([-1.0, 1.0, 1.0]))
    assert bool((right.loss < mirrored.loss).all())
