"""Eq. 5: the terms of the prior, their weights, and which of them are evaluated."""

import math

import pytest
import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import ARTICULATED, AXES
from hand_recon.knowledge.functional_anatomy import FunctionalAnatomy
from hand_recon.knowledge.penetration.non_penetration import NonPenetration
from hand_recon.knowledge.pose_components import PoseComponents, PoseComponentsTerm
from hand_recon.knowledge.prior import Prior
from hand_recon.knowledge.ranges import load_ranges
from hand_recon.knowledge.terms import (
    NonPenetrationTerm,
    RangeOfMotionTerm,
    ShapeTerm,
    Term,
    shape_loss,
)
from hand_recon.schema import HandParameters
from tests.support.tolerance import assert_close


def hands(joint_angles: Tensor, shape: Tensor) -> HandParameters:
    count = len(joint_angles)
    return HandParameters(
        joint_angles, shape, torch.eye(3).expand(count, 3, 3), torch.zeros(count, 3)
    )


def degrees_of(joint: str, **degrees: float) -> Tensor:
    """One straight hand except for one joint."""
    angles = torch.zeros(1, 15, 3)
    for axis, value in degrees.items():
        angles[0, ARTICULATED.index(joint), AXES.index(axis)] = math.radians(value)
    return angles


@pytest.fixture(scope="module")
def default(hand: HandModel) -> Prior:
    return Prior.default(hand)


def test_shape_loss_is_the_norm_with_a_finite_gradient_at_the_mean() -> None:
    shape = torch.zeros(2, 10, dtype=torch.float64)
    shape[1, :2] = torch.tensor([3.0, 4.0])
    shape.requires_grad_()
    loss = shape_loss(shape)
    loss.sum().backward()
    assert shape.grad is not None
    assert loss[0].item() < 1e-5
    assert loss[1].item() == pytest.approx(5.0)
    assert torch.isfinite(shape.grad).all()
    assert_close(shape.grad[1, :2], torch.tensor([0.6, 0.8]))


def test_the_default_is_eq_5_with_the_weights_of_section_4_1(default: Prior) -> None:
    assert list(default.weights.items()) == [
        ("range_of_motion", 20_000.0), ("non_penetration", 20_000.0), ("shape", 10.0)
    ]  # fmt: skip


def test_ten_degrees_cost_609_with_the_weight_of_the_paper(hand: HandModel) -> None:
    """λ₁ = 20000 · (10°)² against a data term in pixels, and λ₃ = 10 for two standard deviations."""
    prior = Prior({"range_of_motion": RangeOfMotionTerm(hand), "shape": ShapeTerm(hand)})
    angles = torch.zeros(2, 15, 3)
    angles[1, 0, 2] = math.radians(10)  # No finger twists.
    shape = torch.zeros(2, 10)
    shape[:, 0] = 2.0
    values = prior(hands(angles, shape))
    assert set(values) == {"range_of_motion", "shape"}
    weighted = prior.weighted(values)
    excess = weighted["range_of_motion"][1] - weighted["range_of_motion"][0]
    assert float(excess) == pytest.approx(609.2, abs=0.1)
    assert_close(weighted["shape"], torch.tensor([20.0, 20.0]))


def test_a_weight_of_zero_switches_a_term_off(hand: HandModel) -> None:
    off = RangeOfMotionTerm(hand, weight=0.0)
    prior = Prior({"range_of_motion": off, "shape": ShapeTerm(hand)})
    assert set(prior(hands(torch.randn(3, 15, 3), torch.randn(3, 10)))) == {"shape"}


def test_non_penetration_is_metres_deeper_than_the_tolerance(
    hand: HandModel, default: Prior
) -> None:
    """An index finger bent back to front through the palm: skin deeper inside than 6 mm, in metres."""
    angles = degrees_of("index MCP", bend=110.0)
    angles[0, ARTICULATED.index("index PIP"), 0] = math.radians(110)
    parameters = hands(torch.cat([angles, torch.zeros(1, 15, 3)]), torch.zeros(2, 10))
    vertices = hand.to_camera(parameters).vertices
    values = default(parameters, vertices)
    assert set(values) == {"range_of_motion", "non_penetration", "shape"}
    depths = NonPenetration(hand).depths(vertices)
    expected = (depths - 0.006).clamp(min=0).sum(dim=-1)
    assert_close(values["non_penetration"], expected)
    assert expected[0] > 0.01
    assert expected[1] == 0
    assert_close(default.weighted(values)["non_penetration"], 20_000 * expected)


def test_a_larger_tolerance_costs_less(hand: HandModel) -> None:
    angles = degrees_of("index MCP", bend=110.0)
    angles[0, ARTICULATED.index("index PIP"), 0] = math.radians(110)
    parameters = hands(angles, torch.zeros(1, 10))
    vertices = hand.to_camera(parameters).vertices
    near, far = (
        NonPenetrationTerm(hand, tolerance=tolerance)(parameters, vertices)
        for tolerance in (0.006, 0.008)
    )
    assert 0 < float(far) < float(near)


def test_without_vertices_there_is_no_non_penetration(hand: HandModel, default: Prior) -> None:
    parameters = hands(degrees_of("index MCP", bend=110.0), torch.zeros(1, 10))
    assert set(default(parameters)) == {"range_of_motion", "shape"}
    with pytest.raises(ValueError, match=r"needs the vertices.*hand\.to_camera"):
        NonPenetrationTerm(hand)(parameters, None)


@pytest.mark.parametrize("rules", [FunctionalAnatomy(), FunctionalAnatomy(splay_by_bend=False)])
def test_anatomy_narrows_the_ranges_of_the_prior(hand: HandModel, rules: FunctionalAnatomy) -> None:
    """The index MCP bends to 84.7 and splays to 32.1: half bent, 16.05 is left of 20."""
    found = hands(degrees_of("index MCP", bend=42.35, splay=20.0), torch.zeros(1, 10))
    assert float(RangeOfMotionTerm(hand)(found, None)) == 0.0
    refined = RangeOfMotionTerm(hand, anatomy=rules)(found, None)
    expected = math.radians(20 - 16.05) ** 2 if rules.splay_by_bend else 0.0
    assert float(refined) == pytest.approx(expected, rel=1e-4)


def test_joint_positions_cannot_see_twist_and_neither_does_their_prior(hand: HandModel) -> None:
    ranges = load_ranges("literature", hand.rest_angles)
    # Ten degrees too far in bend (the PIP goes to 100), and any twist.
    angles = degrees_of("ring PIP", bend=110.0, twist=70.0)
    angles[0, 0, AXES.index("twist")] = -3.0
    term = RangeOfMotionTerm(hand, ranges=ranges, twist=False, anatomy=FunctionalAnatomy())
    leaf = angles.clone().requires_grad_()
    loss = term(hands(leaf, torch.zeros(1, 10)), None)
    assert loss.item() == pytest.approx(math.radians(10) ** 2, rel=1e-4)
    loss.sum().backward()
    assert leaf.grad is not None
    assert leaf.grad[..., AXES.index("twist")].count_nonzero() == 0
    assert torch.isfinite(leaf.grad).all()
    assert (ranges.upper[:, AXES.index("twist")] == 0).all()  # The table itself stays.


def test_the_distance_to_a_mean_pose_is_a_term_where_it_is_asked_for(hand: HandModel) -> None:
    prior = Prior(
        {"shape": ShapeTerm(hand), "pose_components": PoseComponentsTerm(hand, weight=10.0)}
    )
    angles = torch.randn(3, 15, 3)
    values = prior(hands(angles, torch.zeros(3, 10)))
    assert set(values) == {"shape", "pose_components"}
    assert_close(prior.weighted(values)["pose_components"], 10 * PoseComponents()(angles))


class Straight(Term):
    """A term that somebody else wrote: the sum of all angles."""

    def forward(
        self, parameters: HandParameters, vertices: Float[Tensor, "*batch vertex 3"] | None
    ) -> Float[Tensor, "*batch"]:
        return parameters.joint_angles.sum(dim=(-2, -1))


def test_a_term_of_ones_own_is_added_like_any_other(hand: HandModel) -> None:
    prior = Prior({"straight": Straight(hand, weight=3.0)})
    values = prior(hands(torch.ones(2, 15, 3), torch.zeros(2, 10)))
    assert_close(prior.weighted(values)["straight"], torch.full((2,), 3.0 * 45))
