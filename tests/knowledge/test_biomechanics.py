"""Eq. 1: joints stay inside their ranges."""

import math
from dataclasses import replace

import pytest
import torch

from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import ARTICULATED, AXES
from hand_recon.knowledge.biomechanics import pose_loss
from hand_recon.knowledge.functional_anatomy import FunctionalAnatomy
from hand_recon.knowledge.penetration.non_penetration import NonPenetration
from hand_recon.knowledge.pose_components import PoseComponents
from hand_recon.knowledge.prior import Prior, shape_loss
from hand_recon.knowledge.ranges import RangeOfMotion, load_ranges
from hand_recon.schema import HandParameters, HandPrediction
from tests.support import knowledge_reference as reference
from tests.support.tolerance import BATCH_SHAPES, assert_close


@pytest.fixture(scope="module")
def ranges() -> RangeOfMotion:
    """Bounds of −20° to 60° for every axis."""
    return RangeOfMotion(
        torch.full((15, 3), math.radians(-20), dtype=torch.float64),
        torch.full((15, 3), math.radians(60), dtype=torch.float64),
    )


def prediction(joint_angles: torch.Tensor, shape: torch.Tensor) -> HandPrediction:
    """A prediction of which the prior only needs the parameters."""
    count = len(joint_angles)
    parameters = HandParameters(
        joint_angles, shape, torch.eye(3).expand(count, 3, 3), torch.zeros(count, 3)
    )
    points = torch.zeros(count, 21, 3)
    return HandPrediction(
        parameters, points, points[:, :16], points, points[..., :2], points[..., :2],
        torch.eye(3).expand(count, 3, 3),
    )  # fmt: skip


def test_ten_degrees_past_one_limit_costs_ten_degrees_squared(ranges: RangeOfMotion) -> None:
    angles = torch.zeros(15, 3, dtype=torch.float64)
    angles[4, 0] = math.radians(70)
    assert_close(pose_loss(angles, ranges), torch.tensor(math.radians(10) ** 2))
    angles[9, 1] = math.radians(-40)
    expected = math.radians(10) ** 2 + math.radians(20) ** 2
    assert_close(pose_loss(angles, ranges), torch.tensor(expected))


def test_ten_degrees_cost_609_with_the_weight_of_the_paper() -> None:
    """λ₁ = 20000 against a data term in pixels: the balance the weights were chosen for."""
    assert 20_000 * math.radians(10) ** 2 == pytest.approx(609.2, abs=0.05)


@pytest.mark.parametrize("shape", BATCH_SHAPES)
def test_agrees_with_the_paper_written_out_joint_by_joint(
    ranges: RangeOfMotion, shape: tuple[int, ...]
) -> None:
    angles = torch.randn(*shape, 15, 3, dtype=torch.float64)
    expected = reference.pose_loss(angles.numpy(), ranges.lower.numpy(), ranges.upper.numpy())
    assert_close(pose_loss(angles, ranges), torch.as_tensor(expected))


def test_is_flat_inside_the_ranges(ranges: RangeOfMotion) -> None:
    inside = torch.rand(8, 15, 3, dtype=torch.float64)
    angles = (ranges.lower + inside * (ranges.upper - ranges.lower)).requires_grad_()
    loss = pose_loss(angles, ranges)
    loss.sum().backward()
    assert (loss == 0).all()
    assert angles.grad is not None
    assert angles.grad.count_nonzero() == 0


def test_gradient_matches_finite_differences(ranges: RangeOfMotion) -> None:
    angles = torch.randn(2, 15, 3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda angles: pose_loss(angles, ranges), angles)


def test_gradient_is_finite_on_the_bounds_and_far_outside(ranges: RangeOfMotion) -> None:
    for angles in (ranges.lower, ranges.upper, ranges.upper + 1e4):
        leaf = angles.clone().requires_grad_()
        pose_loss(leaf, ranges).backward()
        assert leaf.grad is not None
        assert torch.isfinite(leaf.grad).all()


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


def test_the_prior_adds_its_terms_with_the_weights_of_the_paper(hand: HandModel) -> None:
    prior = Prior(load_ranges("literature", hand.rest_angles), hand)
    angles = torch.zeros(2, 15, 3)
    angles[1, 0, 2] = math.radians(10)  # No finger twists.
    shape = torch.zeros(2, 10)
    shape[:, 0] = 2.0
    terms = prior(prediction(angles, shape))
    assert set(terms) == {"range_of_motion", "shape"}
    weighted = prior.weighted(terms)
    excess = weighted["range_of_motion"][1] - weighted["range_of_motion"][0]
    assert float(excess) == pytest.approx(609.2, abs=0.1)
    assert_close(weighted["shape"], torch.tensor([20.0, 20.0]))


def test_a_weight_of_zero_switches_a_term_off(hand: HandModel) -> None:
    prior = Prior(load_ranges("literature", hand.rest_angles), hand, range_of_motion=0.0)
    assert set(prior(prediction(torch.randn(3, 15, 3), torch.randn(3, 10)))) == {"shape"}


@pytest.fixture(scope="module")
def whole(hand: HandModel) -> Prior:
    """Rows 4 and 5 of Table 1."""
    return Prior(
        load_ranges("literature", hand.rest_angles),
        hand,
        functional_anatomy=True,
        non_penetration=20_000.0,
    )


def degrees_of(joint: str, **degrees: float) -> torch.Tensor:
    """One straight hand but for one joint."""
    angles = torch.zeros(1, 15, 3)
    for axis, value in degrees.items():
        angles[0, ARTICULATED.index(joint), AXES.index(axis)] = math.radians(value)
    return angles


def posed(hand: HandModel, joint_angles: torch.Tensor) -> HandPrediction:
    """The prediction with the surface of its pose."""
    found = prediction(joint_angles, torch.zeros(len(joint_angles), 10))
    return replace(found, vertices=hand.to_camera(found.parameters).vertices)


def test_every_source_of_knowledge_has_its_term_and_its_weight(
    hand: HandModel, whole: Prior
) -> None:
    """An index finger bent back to front through the palm: skin deeper inside than 6 mm, in metres."""
    angles = degrees_of("index MCP", bend=110.0)
    angles[0, ARTICULATED.index("index PIP"), 0] = math.radians(110)
    found = posed(hand, torch.cat([angles, torch.zeros(1, 15, 3)]))
    terms = whole(found)
    assert set(terms) == {"range_of_motion", "non_penetration", "shape"}
    depths = NonPenetration(hand).depths(found.vertices)
    expected = (depths - 0.006).clamp(min=0).sum(dim=-1)
    assert_close(terms["non_penetration"], expected)
    assert expected[0] > 0.01
    assert expected[1] == 0
    assert_close(whole.weighted(terms)["non_penetration"], 20_000 * expected)


def test_surfaces_are_looked_at_only_when_asked(hand: HandModel, whole: Prior) -> None:
    found = posed(hand, degrees_of("index MCP", bend=110.0))
    assert set(whole(found, contact=False)) == {"range_of_motion", "shape"}


@pytest.mark.parametrize("rules", [None, FunctionalAnatomy(splay_by_bend=False)])
def test_anatomy_narrows_the_ranges_of_the_prior(
    hand: HandModel, rules: FunctionalAnatomy | None
) -> None:
    """The index MCP bends to 84.7 and splays to 32.1: half bent, 16.05 is left of 20."""
    ranges = load_ranges("literature", hand.rest_angles)
    found = prediction(degrees_of("index MCP", bend=42.35, splay=20.0), torch.zeros(1, 10))
    free = Prior(ranges, hand, anatomy=rules)(found)["range_of_motion"]
    assert float(free) == 0.0
    refined = Prior(ranges, hand, functional_anatomy=True, anatomy=rules)(found)["range_of_motion"]
    expected = math.radians(20 - 16.05) ** 2 if rules is None else 0.0
    assert float(refined) == pytest.approx(expected, rel=1e-4)


def test_joint_positions_cannot_see_twist_and_neither_does_their_prior(hand: HandModel) -> None:
    ranges = load_ranges("literature", hand.rest_angles)
    # Ten degrees too far in bend (the PIP goes to 100), and any twist.
    angles = degrees_of("ring PIP", bend=110.0, twist=70.0)
    angles[0, 0, AXES.index("twist")] = -3.0
    prior = Prior(ranges, hand, twist=False, functional_anatomy=True)
    leaf = angles.clone().requires_grad_()
    loss = prior(prediction(leaf, torch.zeros(1, 10)))["range_of_motion"]
    assert loss.item() == pytest.approx(math.radians(10) ** 2, rel=1e-4)
    loss.sum().backward()
    assert leaf.grad is not None
    assert leaf.grad[..., AXES.index("twist")].count_nonzero() == 0
    assert torch.isfinite(leaf.grad).all()
    assert (ranges.upper[:, AXES.index("twist")] == 0).all()  # The table itself stays.


def test_the_distance_to_a_mean_pose_is_a_term_where_it_is_asked_for(hand: HandModel) -> None:
    ranges = load_ranges("literature", hand.rest_angles)
    prior = Prior(ranges, hand, range_of_motion=0.0, pose_components=10.0)
    angles = torch.randn(3, 15, 3)
    terms = prior(prediction(angles, torch.zeros(3, 10)))
    assert set(terms) == {"shape", "pose_components"}
    assert_close(prior.weighted(terms)["pose_components"], 10 * PoseComponents()(angles))
