"""Eq. 2-3, rule by rule and variant by variant, against numbers worked out by hand."""

import math
from dataclasses import replace

import pytest
import torch

from hand_recon.knowledge.functional_anatomy import FunctionalAnatomy
from hand_recon.knowledge.range_of_motion import range_of_motion_loss
from hand_recon.knowledge.ranges import RangeOfMotion, load_ranges
from tests.support.anatomy import Degrees, angle_index, only, pose, round_ranges


@pytest.fixture(scope="module")
def ranges() -> RangeOfMotion:
    return round_ranges()


def refined_degrees(
    anatomy: FunctionalAnatomy, ranges: RangeOfMotion, degrees: Degrees, joint: str, axis: str
) -> tuple[float, float]:
    """The bounds of one joint and axis in a pose."""
    refined = anatomy.refine(ranges, pose(degrees))
    where = angle_index(joint, axis)
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
    """The released code tests the DIP's bound instead of its angle, so its rule never applies."""
    degrees = {("middle DIP", "bend"): float(dip)}
    anatomy = only("pip_by_dip", variant)
    found = refined_degrees(anatomy, ranges, degrees, "middle PIP", "bend")
    assert found == pytest.approx((lower, 100), abs=1e-6)
    assert refined_degrees(anatomy, ranges, degrees, "index PIP", "bend")[0] == -10


def test_the_released_rule_would_fire_if_a_table_let_no_dip_be_straight(
    ranges: RangeOfMotion,
) -> None:
    lower = ranges.lower.clone()
    lower[angle_index("middle DIP", "bend")] = math.radians(3)
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
    assert range_of_motion_loss(angles, literature) == 0
    loss = range_of_motion_loss(angles, only(rule).refine(literature, angles))
    assert float(loss) == pytest.approx(math.radians(excess) ** 2, rel=1e-4)
    others = replace(FunctionalAnatomy(), **{rule: False})  # type: ignore[arg-type]
    if rule not in ("splay_by_bend", "bend_by_splay"):  # These two cost the same poses.
        assert range_of_motion_loss(angles, others.refine(literature, angles)) == 0


def test_the_two_couplings_of_an_mcp_forbid_the_same_poses(ranges: RangeOfMotion) -> None:
    """Both allow shares of bend and splay that add up to at most one; the losses of other poses differ."""
    angles = torch.zeros(4000, 15, 3, dtype=torch.float64)
    span = ranges.upper[0] - ranges.lower[0]
    angles[:, 0] = ranges.lower[0] + torch.rand(4000, 3, dtype=torch.float64) * span
    costs = [
        range_of_motion_loss(angles, only(rule).refine(ranges, angles))
        for rule in ("splay_by_bend", "bend_by_splay")
    ]
    assert torch.equal(costs[0] > 1e-12, costs[1] > 1e-12)
    assert 0.3 < float((costs[0] > 1e-12).double().mean()) < 0.7
    # In flexion and ulnar splay, a share too many is 30 degrees of splay but 80 of bend.
    angles = pose({("index MCP", "bend"): 60.0, ("index MCP", "splay"): -15.0})
    for rule, degrees in (("splay_by_bend", 7.5), ("bend_by_splay", 20.0)):
        cost = range_of_motion_loss(angles, only(rule).refine(ranges, angles))
        assert float(cost) == pytest.approx(math.radians(degrees) ** 2)
