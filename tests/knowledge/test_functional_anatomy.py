"""Eq. 2-3: a slow reference, properties of all rules, batches, gradients and switches."""

import math

import numpy as np
import pytest
import torch
from hydra.utils import instantiate
from omegaconf import OmegaConf

from hand_recon.hand.skeleton import ARTICULATED
from hand_recon.knowledge.functional_anatomy import VARIANTS, FunctionalAnatomy
from hand_recon.knowledge.range_of_motion import range_of_motion_loss
from hand_recon.knowledge.ranges import RangeOfMotion, load_ranges
from tests.support.anatomy import NO_RULE, RULES, angle_index, only, pose, round_ranges
from tests.support.tolerance import BATCH_SHAPES, assert_close


@pytest.fixture(scope="module")
def ranges() -> RangeOfMotion:
    return round_ranges()


def test_without_rules_the_ranges_stay(ranges: RangeOfMotion) -> None:
    refined = NO_RULE.refine(ranges, torch.randn(5, 15, 3, dtype=torch.float64))
    assert_close(refined.lower, ranges.lower.expand(5, 15, 3))
    assert_close(refined.upper, ranges.upper.expand(5, 15, 3))


@pytest.mark.parametrize("rule", RULES)
def test_a_rule_touches_nothing_but_what_it_is_about(ranges: RangeOfMotion, rule: str) -> None:
    touched = {
        "splay_by_bend": [angle_index(joint, "splay") for joint in ARTICULATED if "MCP" in joint],
        "bend_by_splay": [angle_index(joint, "bend") for joint in ARTICULATED if "MCP" in joint],
        "pip_by_dip": [angle_index(joint, "bend") for joint in ARTICULATED if "PIP" in joint],
        "thumb_cmc": [angle_index("thumb CMC", "splay")],
    }[rule]
    touched = [where for where in touched if where[0] != ARTICULATED.index("thumb MCP")]
    refined = only(rule).refine(ranges, torch.full((15, 3), 0.15, dtype=torch.float64))
    changed = (refined.lower != ranges.lower) | (refined.upper != ranges.upper)
    assert [tuple(where) for where in changed.nonzero().tolist()] == sorted(touched)


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("shape", BATCH_SHAPES)
@pytest.mark.parametrize("reverse", [True, False])
def test_agrees_with_the_rules_written_out_finger_by_finger(
    ranges: RangeOfMotion, variant: str, shape: tuple[int, ...], *, reverse: bool
) -> None:
    angles = torch.randn(*shape, 15, 3, dtype=torch.float64)
    anatomy = FunctionalAnatomy(variant=variant, bend_by_splay=reverse)
    refined = anatomy.refine(ranges, angles)
    assert refined.lower.shape == refined.upper.shape == (*shape, 15, 3)
    hands = angles.reshape(-1, 15, 3).numpy()
    base = ranges.lower.numpy(), ranges.upper.numpy()
    expected = np.array([_written_out(hand, base, variant, reverse=reverse) for hand in hands])
    expected = expected.transpose(1, 0, 2, 3).reshape(2, *shape, 15, 3)
    assert_close(refined.lower, torch.as_tensor(expected[0]))
    assert_close(refined.upper, torch.as_tensor(expected[1]))


def _written_out(
    hand: np.ndarray, base: tuple[np.ndarray, np.ndarray], variant: str, *, reverse: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Eq. 2–3 of one hand, one joint at a time."""
    lower, upper = base[0].copy(), base[1].copy()
    clipped = np.clip(hand, *base)
    for knuckle in (0, 3, 6, 9):
        for driver, driven in ((0, 1), (1, 0)):
            if driver == 1 and (variant == "release" or not reverse):
                continue
            angle = clipped[knuckle, driver]
            share = _share(angle, base[0][knuckle, driver], base[1][knuckle, driver], variant)
            if angle < 0 or variant != "printed":
                lower[knuckle, driven] *= 1 - share
            if angle > 0 or variant != "printed":
                upper[knuckle, driven] *= 1 - share
        if hand[knuckle + 2, 0] > 0 and variant != "release":
            lower[knuckle + 1, 0] = 0
    if clipped[12, 0] > 0:
        share = _share(clipped[12, 0], base[0][12, 0], base[1][12, 0], variant)
        upper[12, 1] *= 1 - share
        lower[12, 1] *= 1 - share if variant == "release" else 1
    return lower, upper


def _share(angle: float, lower: float, upper: float, variant: str) -> float:
    """Share of the other axis' range that an angle takes away."""
    if variant == "release":
        return min(max(angle, 0), math.radians(70)) / math.radians(70)
    return angle / lower if angle < 0 else angle / upper


def test_every_hand_may_have_ranges_of_its_own(ranges: RangeOfMotion) -> None:
    scale = torch.tensor([1.0, 0.5], dtype=torch.float64)[:, None, None]
    each = RangeOfMotion(ranges.lower * scale, ranges.upper * scale)
    angles = torch.full((2, 15, 3), math.radians(20), dtype=torch.float64)
    refined = only("splay_by_bend").refine(each, angles)
    ends = refined.upper[:, 0, 1].rad2deg().round(decimals=6).tolist()
    assert ends == [7.5, 2.5]  # 10 · (1 − 20/80) and 5 · (1 − 20/40).


@pytest.mark.parametrize("variant", VARIANTS)
def test_bounds_never_cross_nor_leave_the_tables_whatever_the_table(variant: str) -> None:
    ends = torch.randn(2, 500, 15, 3, dtype=torch.float64).sort(dim=0).values
    ends[:, :100] = 0.0  # No freedom at all.
    ends[1, 100:200] = ends[1, 100:200].clamp(max=0)  # The limit is zero or below.
    ends[0, 100:200] = ends[0, 100:200].clamp(max=0)
    base = RangeOfMotion(ends[0], ends[1])
    refined = FunctionalAnatomy(variant=variant).refine(
        base, 3 * torch.randn(500, 15, 3, dtype=torch.float64)
    )
    assert bool((refined.lower <= refined.upper).all())
    assert bool((refined.lower >= base.lower).all())
    assert bool((refined.upper <= base.upper).all())


def test_no_gradient_flows_through_the_bounds(ranges: RangeOfMotion) -> None:
    angles = pose({("index MCP", "bend"): 60.0, ("index MCP", "splay"): 9.0}).requires_grad_()
    refined = only("splay_by_bend").refine(ranges, angles)
    assert not refined.lower.requires_grad
    assert not refined.upper.requires_grad
    range_of_motion_loss(angles, refined).backward()
    assert angles.grad is not None
    # 9 degrees where 10 · (1 − 60/80) = 2.5 are left; the bend that causes this has no gradient.
    assert float(angles.grad[angle_index("index MCP", "splay")]) == pytest.approx(
        2 * math.radians(6.5)
    )
    assert angles.grad.count_nonzero() == 1


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_gradient_is_that_of_eq_1_with_the_refined_bounds_held(
    ranges: RangeOfMotion, variant: str
) -> None:
    angles = torch.randn(2, 15, 3, dtype=torch.float64, requires_grad=True)
    held = FunctionalAnatomy(variant=variant).refine(ranges, angles)
    assert torch.autograd.gradcheck(lambda moved: range_of_motion_loss(moved, held), angles)
    (expected,) = torch.autograd.grad(range_of_motion_loss(angles, held).sum(), angles)
    live = FunctionalAnatomy(variant=variant).refine(ranges, angles)
    (found,) = torch.autograd.grad(range_of_motion_loss(angles, live).sum(), angles)
    assert_close(found, expected)


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("table", ["literature", "paper_release"])
def test_gradients_are_finite_on_the_bounds_at_zero_and_far_outside(
    table: str, variant: str
) -> None:
    bounds = load_ranges(table)
    zero = torch.zeros(15, 3)
    for angles in (bounds.lower, bounds.upper, zero, -zero, bounds.upper + 1e4, bounds.lower - 1e4):
        leaf = angles.clone().requires_grad_()
        loss = range_of_motion_loss(leaf, FunctionalAnatomy(variant=variant).refine(bounds, leaf))
        loss.backward()
        assert leaf.grad is not None
        assert torch.isfinite(loss)
        assert torch.isfinite(leaf.grad).all()


def test_the_neutral_hand_keeps_the_ranges_of_the_table() -> None:
    literature, neutral = load_ranges("literature"), torch.zeros(15, 3)
    refined = FunctionalAnatomy().refine(literature, neutral)
    assert_close(refined.lower, literature.lower)
    assert_close(refined.upper, literature.upper)


def test_a_table_in_single_precision_serves_angles_in_double(ranges: RangeOfMotion) -> None:
    single = RangeOfMotion(ranges.lower.float(), ranges.upper.float())
    refined = FunctionalAnatomy().refine(single, torch.zeros(4, 15, 3, dtype=torch.float64))
    assert refined.lower.dtype == torch.float64


def test_hydra_builds_it_from_names_and_switches() -> None:
    name = "hand_recon.knowledge.functional_anatomy.FunctionalAnatomy"
    config = OmegaConf.create({"_target_": name, "variant": "release", "thumb_cmc": False})
    assert instantiate(config) == FunctionalAnatomy(variant="release", thumb_cmc=False)


def test_an_unknown_variant_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ValueError, match=r"'papre'.*paper.*printed.*release"):
        FunctionalAnatomy(variant="papre")
