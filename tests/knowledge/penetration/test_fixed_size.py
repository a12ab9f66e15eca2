"""Non-penetration in lists of fixed length has the values of lists by pose, and says what had no place."""

import copy
import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch
from torch import Tensor

from hand_recon.data.synthetic.unnatural import sample_unnatural_pose
from hand_recon.hand.model import HandModel
from hand_recon.knowledge.penetration.fixed_size import FixedSizeNonPenetration
from hand_recon.knowledge.penetration.non_penetration import NonPenetration
from hand_recon.knowledge.penetration.places import LISTS, Places, warn_of_left_out
from hand_recon.knowledge.terms import NonPenetrationTerm
from hand_recon.speed.poses import posed_surface
from tests.support.largest_tensor import LargestTensor
from tests.support.random_surfaces import random_vertices
from tests.support.tolerance import BATCH_SHAPES, assert_close
from tests.support.value_and_gradient import value_and_gradient

HANDS = 8


@pytest.fixture(scope="module")
def by_pose(hand: HandModel) -> NonPenetration:
    return NonPenetration(hand)


@pytest.fixture(scope="module")
def fixed(hand: HandModel) -> FixedSizeNonPenetration:
    return FixedSizeNonPenetration(hand)


def pushed_together(hand: HandModel) -> Tensor:
    """Hands whose fingers were bent until they penetrate."""
    random = np.random.default_rng(0)
    poses = [sample_unnatural_pose(random, "penetrating").joint_angles for _ in range(HANDS)]
    return hand(torch.tensor(np.stack(poses)).float(), torch.randn(HANDS, 10)).vertices


def no_hands(hand: HandModel) -> Tensor:
    """Surfaces of a hand's triangles that no hand has: one point, flat, inside out, and far too large."""
    return torch.stack(
        [
            torch.zeros(778, 3),
            hand.template * torch.tensor([1.0, 0, 1]),
            -hand.template,
            1e3 * hand.template,
        ]
    )


POSES: dict[str, Callable[[HandModel], Tensor]] = {
    "natural": lambda hand: posed_surface(hand, "natural", HANDS),
    "random": lambda hand: random_vertices(hand, HANDS),
    "any angle": lambda hand: random_vertices(hand, HANDS, spread=3.0),
    "penetrating": pushed_together,
    "no hands": no_hands,
}


def taken(term: FixedSizeNonPenetration) -> dict[str, int]:
    return term.left_out.take()[0]


@pytest.mark.parametrize("kind", POSES)
def test_loss_gradient_depths_and_inside_sets_are_those_of_lists_by_pose(
    hand: HandModel, by_pose: NonPenetration, fixed: FixedSizeNonPenetration, kind: str
) -> None:
    vertices = POSES[kind](hand)
    for found, expected in zip(
        value_and_gradient(fixed, vertices), value_and_gradient(by_pose, vertices), strict=True
    ):
        assert_close(found, expected)
    depths, expected = fixed.depths(vertices), by_pose.depths(vertices)
    assert torch.equal(depths > 0, expected > 0)
    assert_close(depths, expected)
    if kind != "no hands":
        assert float(expected.amax()) > 0.003
    assert taken(fixed) == dict.fromkeys(LISTS, 0)


def test_the_gradient_is_that_of_finite_differences(hand: HandModel) -> None:
    exact = FixedSizeNonPenetration(copy.deepcopy(hand).double())
    vertices = random_vertices(hand, 1, spread=0.7).double()
    _, gradient = value_and_gradient(exact, vertices)
    direction = torch.randn(1, 778, 3, dtype=torch.float64)
    ahead, behind = (exact(vertices + step * direction) for step in (1e-7, -1e-7))
    slope = float(ahead - behind) / 2e-7
    assert abs(slope) > 0.1
    assert float((gradient * direction).sum()) == pytest.approx(slope, rel=1e-4)


@pytest.mark.parametrize("shape", [*BATCH_SHAPES, (0,)])
def test_serves_any_batch_and_each_hand_for_itself(
    hand: HandModel, fixed: FixedSizeNonPenetration, shape: tuple[int, ...]
) -> None:
    vertices = random_vertices(hand, math.prod(shape)).view(*shape, 778, 3)
    loss = fixed(vertices)
    assert loss.shape == shape
    assert fixed.depths(vertices).shape == (*shape, 778)
    for one, alone in zip(loss.flatten(), vertices.view(-1, 778, 3), strict=True):
        assert_close(one, fixed(alone))


def test_a_hand_that_is_no_number_leaves_the_others_as_they_are(
    hand: HandModel, fixed: FixedSizeNonPenetration
) -> None:
    vertices = random_vertices(hand, 3, spread=0.8)
    loss, gradient = value_and_gradient(fixed, vertices)
    broken = vertices.clone()
    broken[1] = torch.nan
    found, moved = value_and_gradient(fixed, broken)
    assert_close(found[[0, 2]], loss[[0, 2]])
    assert_close(moved[[0, 2]], gradient[[0, 2]])
    assert torch.isfinite(moved).all()


@pytest.mark.parametrize("name", ["candidates", "tested", "inside"])
def test_each_place_less_leaves_one_vertex_more_out_and_says_so(
    hand: HandModel, fixed: FixedSizeNonPenetration, name: str
) -> None:
    """One hand, and lists of so few places that all of them are filled."""
    vertices = random_vertices(hand, 1, spread=0.8)
    expected = float(fixed(vertices))
    assert taken(fixed) == dict.fromkeys(LISTS, 0)
    short, losses, counts = FixedSizeNonPenetration(hand), [], []
    for places in (1, 2, 3):
        short.places = replace(Places(), **{name: places}, spare=0)
        losses.append(float(short(vertices)))
        counts.append(taken(short)[name])
    lists = 1 if name == "inside" else 2  # One for the palm, where there is a vertex near it.
    steps = {before - after for before, after in pairwise(counts)}
    assert counts[-1] > 0
    assert steps <= set(range(1, lists + 1))
    assert losses == sorted(losses)
    assert losses[-1] <= expected


def test_with_too_few_places_the_deepest_vertices_have_them(
    hand: HandModel, fixed: FixedSizeNonPenetration
) -> None:
    vertices = random_vertices(hand, 8, spread=0.8)
    contacts, counting = fixed.fixed_contacts(vertices, 0.006)
    depths = contacts.depths(vertices)[counting].sort(descending=True).values
    # The hands share the places.
    each = len(depths) // 16
    assert each > 1
    short = FixedSizeNonPenetration(hand, places=Places(inside=each, spare=0))
    # Not exactly the deepest, since the bound of a depth is not the depth.
    assert float(short(vertices).sum()) > 0.8 * float((depths[: 8 * each] - 0.006).sum())


def test_too_few_triangles_are_counted_where_a_nearer_one_may_be_missing(
    hand: HandModel, by_pose: NonPenetration
) -> None:
    vertices = random_vertices(hand, 4, spread=0.8)
    expected = by_pose.depths(vertices)
    for triangles in (1, 8):
        few = FixedSizeNonPenetration(hand, places=Places(triangles=triangles))
        depths = few.depths(vertices)
        wrong = int(((depths - expected).abs() > 1e-7).sum())
        assert wrong <= taken(few)["triangles"]
        assert (depths >= expected - 1e-7)[depths > 0].all()
        if triangles == 1:
            assert wrong > 0


def test_what_is_left_out_is_said_aloud_once(
    hand: HandModel, caplog: pytest.LogCaptureFixture
) -> None:
    term = NonPenetrationTerm(hand, sizes="fixed")
    assert isinstance(term.non_penetration, FixedSizeNonPenetration)
    term.non_penetration.places = Places(inside=1, spare=0)
    vertices = random_vertices(hand, 2, spread=0.8)
    term.non_penetration(vertices)
    warn_of_left_out(term)
    assert "left out the least deep: candidates 0, tested 0, inside" in caplog.text
    assert "of 2 hands. Set prior.non_penetration.sizes=by_pose" in caplog.text
    caplog.clear()
    warn_of_left_out(term)
    assert not caplog.text


def test_the_bound_on_memory_is_kept_and_changes_no_value(hand: HandModel) -> None:
    vertices = random_vertices(hand, 4, spread=1.0)
    small, large = (FixedSizeNonPenetration(hand, at_once=bound) for bound in (20_000, 1 << 22))
    with LargestTensor() as bounded:
        found = small(vertices)
    with LargestTensor() as free:
        expected = large(vertices)
    assert_close(found, expected)
    # Three corners in space for each; else pairs of vertex and phalanx, heights, or corners of the skin.
    fixed_part = 4 * max(14 * 778, 32 * (778 + 15), 9 * len(hand.faces))
    assert bounded.numbers <= max(9 * 20_000, fixed_part)
    assert free.numbers > 3 * bounded.numbers


def test_on_a_processor_auto_is_by_pose_bit_for_bit(hand: HandModel) -> None:
    vertices = random_vertices(hand, 6)
    found = [
        value_and_gradient(NonPenetrationTerm(hand, sizes=sizes).non_penetration, vertices)
        for sizes in ("auto", "by_pose")
    ]
    assert torch.equal(found[0][0], found[1][0])
    assert torch.equal(found[0][1], found[1][1])
    with pytest.raises(ValueError, match=r"sizes='large'; expected one of auto, by_pose, fixed"):
        NonPenetrationTerm(hand, sizes="large")


def test_lists_without_places_are_refused() -> None:
    with pytest.raises(ValueError, match="expected at least one place in each list"):
        Places(inside=0)
