"""Eq. 2-3: the pose narrows the ranges, rule by rule and variant by variant."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from hydra.utils import instantiate
from omegaconf import OmegaConf
from torch import Tensor

from hand_recon.hand.skeleton import ARTICULATED, AXES
from hand_recon.knowledge.biomechanics import pose_loss
from hand_recon.knowledge.functional_anatomy import VARIANTS, FunctionalAnatomy
from hand_recon.knowledge.ranges import RangeOfMotion, load_ranges
from tests.tolerance import BATCH_SHAPES, assert_close

RULES = ("splay_by_bend", "bend_by_splay", "pip_by_dip", "thumb_cmc")
Degrees = dict[tuple[str, str], float]
NO_RULE = FunctionalAnatomy(
    splay_by_bend=False, bend_by_splay=False, pip_by_dip=False, thumb_cmc=False
)
FINGER_JOINTS = {"MCP": {"bend": (-20, 80), "splay": (-30, 10)}, "PIP": {"bend": (-10, 100)}}


def place(joint: str, axis: str) -> tuple[int, int]:
    return ARTICULATED.index(joint), AXES.index(axis)


def only(rule: str, variant: str = "paper") -> FunctionalAnatomy:
    """One rule and no other."""
    return replace(NO_RULE, variant=variant, **{rule: True})


def pose(degrees: Degrees) -> Tensor:
    """Straight fingers but for the given angles."""
    angles = torch.zeros(15, 3, dtype=torch.float64)
    for (joint, axis), value in degrees.items():
        angles[place(joint, axis)] = math.radians(value)
    return angles


@pytest.fixture(scope="module")
def ranges() -> RangeOfMotion:
    """Round numbers: MCP bend −20 to 80, splay −30 to 10; PIP −10 to 100; CMC −20 to 40, −30 to 12."""
    bounds = torch.zeros(2, 15, 3, dtype=torch.float64)
    for joint in ARTICULATED:
        rows = {"bend": (0, 80)}
        if joint == "thumb CMC":
            rows = {"bend": (-20, 40), "splay": (-30, 12)}
        elif not joint.startswith("thumb"):
            rows = FINGER_JOINTS.get(joint.split()[1], rows)
        for axis, ends in rows.items():
            bounds[(slice(None), *place(joint, axis))] = torch.tensor(ends, dtype=torch.float64)
    bounds = bounds.deg2rad()
    return RangeOfMotion(bounds[0], bounds[1])


def refined_degrees(
    anatomy: FunctionalAnatomy, ranges: RangeOfMotion, degrees: Degrees, joint: str, axis: str
) -> tuple[float, float]:
    """The bounds of one joint and axis in a pose."""
    refined = anatomy.refine(ranges, pose(degrees))
    where = place(joint, axis)
    return (
        round(math.degrees(refined.lower[where]), 6),
        round(math.degrees(refined.upper[where]), 6),
    )


@pytest.mark.parametrize(
    ("variant", "bend", "expected"),
    [
        # A quarter of the way to the limit leaves three quarters of both bounds …
        ("paper", 20, (-22.5, 7.5)),
        ("paper", -5, (-22.5, 7.5)),
        ("paper", 0, (-30, 10)),
        # … nothing is left at either limit, nor beyond it …
        ("paper", 80, (0, 0)),
        ("paper", -20, (0, 0)),
        ("paper", 170, (0, 0)),
        # … to the letter, only the upper one in flexion and only the lower one in extension …
        ("printed", 20, (-30, 7.5)),
        ("printed", -5, (-22.5, 10)),
        ("printed", 80, (-30, 0)),
        # … and in the released code 70 degrees close it, and extension does not.
        ("release", 35, (-15, 5)),
        ("release", 70, (0, 0)),
        ("release", 80, (0, 0)),
        ("release", -5, (-30, 10)),
    ],
)
def test_a_bent_mcp_splays_less(
    ranges: RangeOfMotion, variant: str, bend: float, expected: tuple[float, float]
) -> None:
    anatomy = only("splay_by_bend", variant)
    for finger in ("index", "middle", "little", "ring"):
        degrees = {(f"{finger} MCP", "bend"): float(bend)}
        found = refined_degrees(anatomy, ranges, degrees, f"{finger} MCP", "splay")
        assert found == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("variant", "splay", "expected"),
    [
        ("paper", 5, (-10, 40)),
        ("paper", -15, (-10, 40)),
        ("paper", 10, (0, 0)),
        ("paper", -90, (0, 0)),
        ("printed", 5, (-20, 40)),
        ("printed", -15, (-10, 80)),
        ("release", 5, (-20, 80)),  # Not coded.
    ],
)
def test_a_splayed_mcp_bends_less(
    ranges: RangeOfMotion, variant: str, splay: float, expected: tuple[float, float]
) -> None:
    degrees = {("ring MCP", "splay"): float(splay)}
    found = refined_degrees(only("bend_by_splay", variant), ranges, degrees, "ring MCP", "bend")
    assert found == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("variant", "dip", "lower"),
    [
        ("paper", 1, 0),
        ("paper", 0, -10),
        ("paper", -5, -10),
        ("printed", 1, 0),
        ("release", 60, -10),
    ],
)
def test_a_flexed_dip_straightens_its_pip(
    ranges: RangeOfMotion, variant: str, dip: float, lower: float
) -> None:
    """The released code asks the DIP's limit instead of its angle, so that its rule never fires."""
    degrees = {("middle DIP", "bend"): float(dip)}
    anatomy = only("pip_by_dip", variant)
    found = refined_degrees(anatomy, ranges, degrees, "middle PIP", "bend")
    assert found == pytest.approx((lower, 100), abs=1e-6)
    assert refined_degrees(anatomy, ranges, degrees, "index PIP", "bend")[0] == -10


def test_the_released_rule_would_fire_if_a_table_let_no_dip_be_straight(
    ranges: RangeOfMotion,
) -> None:
    lower = ranges.lower.clone()
    lower[place("middle DIP", "bend")] = math.radians(3)
    odd = RangeOfMotion(lower, ranges.upper)
    found = refined_degrees(only("pip_by_dip", "release"), odd, {}, "middle PIP", "bend")
    assert found[0] == 0


@pytest.mark.parametrize(
    ("variant", "bend", "expected"),
    [
        ("paper", 10, (-30, 9)),  # Only abduction closes: a flexed thumb lies in the palm.
        ("paper", 40, (-30, 0)),
        ("paper", -10, (-30, 12)),
        ("printed", 10, (-30, 9)),
        ("release", 35, (-15, 6)),
        ("release", -10, (-30, 12)),
    ],
)
def test_a_flexed_thumb_abducts_less(
    ranges: RangeOfMotion, variant: str, bend: float, expected: tuple[float, float]
) -> None:
    degrees = {("thumb CMC", "bend"): float(bend)}
    found = refined_degrees(only("thumb_cmc", variant), ranges, degrees, "thumb CMC", "splay")
    assert found == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("rule", "degrees", "excess"),
    [
        # Index MCP: bend to 84.7, splay to 32.1. Half bent, 16.05 is left of 20.
        ("splay_by_bend", {("index MCP", "bend"): 42.35, ("index MCP", "splay"): 20.0}, 3.95),
        # Half splayed, 42.35 is left of 50.
        ("bend_by_splay", {("index MCP", "bend"): 50.0, ("index MCP", "splay"): 16.05}, 7.65),
        # A swan neck: PIP to −10, but straight while the DIP is flexed.
        ("pip_by_dip", {("index PIP", "bend"): -8.0, ("index DIP", "bend"): 30.0}, 8.0),
        # Thumb CMC: bend to 33, splay to 12. A third bent, 8 is left of 10.
        ("thumb_cmc", {("thumb CMC", "bend"): 11.0, ("thumb CMC", "splay"): 10.0}, 2.0),
    ],
)
def test_every_rule_costs_a_pose_that_the_literature_alone_allows(
    rule: str, degrees: Degrees, excess: float
) -> None:
    literature, angles = load_ranges("literature"), pose(degrees)
    assert pose_loss(angles, literature) == 0
    loss = pose_loss(angles, only(rule).refine(literature, angles))
    assert float(loss) == pytest.approx(math.radians(excess) ** 2, rel=1e-4)
    others = replace(FunctionalAnatomy(), **{rule: False})  # type: ignore[arg-type]
    if rule not in ("splay_by_bend", "bend_by_splay"):  # These two cost the same poses.
        assert pose_loss(angles, others.refine(literature, angles)) == 0


def test_the_two_couplings_of_an_mcp_forbid_the_same_poses(ranges: RangeOfMotion) -> None:
    """Both leave the poses whose shares of bend and splay add up to one; they price the rest apart."""
    angles = torch.zeros(4000, 15, 3, dtype=torch.float64)
    span = ranges.upper[0] - ranges.lower[0]
    angles[:, 0] = ranges.lower[0] + torch.rand(4000, 3, dtype=torch.float64) * span
    costs = [
        pose_loss(angles, only(rule).refine(ranges, angles))
        for rule in ("splay_by_bend", "bend_by_splay")
    ]
    assert torch.equal(costs[0] > 1e-12, costs[1] > 1e-12)
    assert 0.3 < float((costs[0] > 1e-12).double().mean()) < 0.7
    # In flexion and ulnar splay, a share too many is 30 degrees of splay but 80 of bend.
    angles = pose({("index MCP", "bend"): 60.0, ("index MCP", "splay"): -15.0})
    for rule, degrees in (("splay_by_bend", 7.5), ("bend_by_splay", 20.0)):
        cost = pose_loss(angles, only(rule).refine(ranges, angles))
        assert float(cost) == pytest.approx(math.radians(degrees) ** 2)


def test_without_rules_the_ranges_stay(ranges: RangeOfMotion) -> None:
    refined = NO_RULE.refine(ranges, torch.randn(5, 15, 3, dtype=torch.float64))
    assert_close(refined.lower, ranges.lower.expand(5, 15, 3))
    assert_close(refined.upper, ranges.upper.expand(5, 15, 3))


@pytest.mark.parametrize("rule", RULES)
def test_a_rule_touches_nothing_but_what_it_is_about(ranges: RangeOfMotion, rule: str) -> None:
    touched = {
        "splay_by_bend": [place(joint, "splay") for joint in ARTICULATED if "MCP" in joint],
        "bend_by_splay": [place(joint, "bend") for joint in ARTICULATED if "MCP" in joint],
        "pip_by_dip": [place(joint, "bend") for joint in ARTICULATED if "PIP" in joint],
        "thumb_cmc": [place("thumb CMC", "splay")],
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
    """How much of the other axis' freedom an angle takes."""
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
    pose_loss(angles, refined).backward()
    assert angles.grad is not None
    # 9 degrees where 10 · (1 − 60/80) = 2.5 are left; the bend that left them is not pulled.
    assert float(angles.grad[place("index MCP", "splay")]) == pytest.approx(2 * math.radians(6.5))
    assert angles.grad.count_nonzero() == 1


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_gradient_is_that_of_eq_1_with_the_refined_bounds_held(
    ranges: RangeOfMotion, variant: str
) -> None:
    angles = torch.randn(2, 15, 3, dtype=torch.float64, requires_grad=True)
    held = FunctionalAnatomy(variant=variant).refine(ranges, angles)
    assert torch.autograd.gradcheck(lambda moved: pose_loss(moved, held), angles)
    (expected,) = torch.autograd.grad(pose_loss(angles, held).sum(), angles)
    live = FunctionalAnatomy(variant=variant).refine(ranges, angles)
    (found,) = torch.autograd.grad(pose_loss(angles, live).sum(), angles)
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
        loss = pose_loss(leaf, FunctionalAnatomy(variant=variant).refine(bounds, leaf))
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
