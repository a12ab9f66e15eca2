"""Plain versions of the published formulas give the values of the fast ones."""

from collections.abc import Callable

import numpy as np
import pytest
import torch

from hand_recon.hand.anatomical_frame import joint_rotations
from hand_recon.hand.model import HandModel
from hand_recon.hand.open_hand import open_hand
from hand_recon.knowledge.penetration.closed_parts import closed_parts
from hand_recon.speed.poses import KINDS, blended_hand, joint_angles, posed_surface, shapes
from hand_recon.speed.published.depth_by_definition import winding_numbers as by_definition
from hand_recon.speed.published.hand_layer import PublishedLayer
from hand_recon.speed.published.non_penetration import (
    INSIDE,
    PublishedNonPenetration,
    winding_numbers,
)
from hand_recon.speed.suites.physics import agreement
from tests.support.tolerance import assert_close


@pytest.mark.parametrize("make", [open_hand, blended_hand])
@pytest.mark.parametrize("kind", KINDS)
def test_the_layer_is_that_of_the_literature(make: Callable[[], HandModel], kind: str) -> None:
    hand = make().double()
    # Weights of single precision do not sum exactly to one, which moves the two forms apart by nanometres.
    weights = hand.skinning_weights / hand.skinning_weights.sum(dim=1, keepdim=True)
    hand = hand.with_arrays(skinning_weights=weights)
    rotations = joint_rotations(joint_angles(kind, 5).double(), hand.frames, hand.rest_angles)
    shape = shapes(5).double()
    vertices, joints = PublishedLayer(hand)(rotations, shape)
    geometry = hand.pose(rotations, shape)
    assert_close(geometry.vertices, vertices)
    assert_close(geometry.joints, joints)


@pytest.mark.parametrize("kind", KINDS)
def test_winding_numbers_are_those_of_the_definition(kind: str) -> None:
    hand = open_hand()
    surface = posed_surface(hand, kind, 1)[0].double()
    parts = closed_parts(hand)
    points = torch.cat([surface, torch.from_numpy(parts.centres) @ surface])
    palm = torch.from_numpy(parts.faces[0])
    found = winding_numbers(surface, points, palm)
    expected = by_definition(surface.numpy(), points.numpy()[parts.faces[0]])
    # A vertex of the surface itself sees its own triangles at an angle that is undefined.
    own = np.isin(np.arange(len(surface)), parts.faces[0])
    assert_close(found[~own], torch.from_numpy(expected[~own]))


def test_the_published_recipe_finds_a_finger_inside_the_palm() -> None:
    hand = open_hand()
    recipe = PublishedNonPenetration(hand)
    flat, crossed = torch.zeros(2, 15, 3).unbind()
    # Index finger bent far backwards through the back of the hand.
    crossed[0, 0], crossed[1, 0] = -1.6, -1.5
    surfaces = [hand(angles, torch.zeros(10)).vertices for angles in (flat, crossed)]
    losses = recipe(torch.stack(surfaces))
    assert losses[0] == 0
    assert losses[1] > 0
    inside = recipe.inside(surfaces[1])
    assert 0 < inside.sum() < len(inside) / 2
    assert 0.9 < INSIDE < 1


def test_the_recipe_has_a_gradient_that_moves_parts_apart() -> None:
    hand = open_hand()
    surface = posed_surface(hand, "wild", 2).requires_grad_()
    recipe = PublishedNonPenetration(hand)
    loss = recipe(surface).sum()
    (gradient,) = torch.autograd.grad(loss, surface)
    moved = surface.detach() - 1e-3 * gradient / gradient.norm()
    assert recipe(moved).sum() < loss


@pytest.mark.parametrize("kind", KINDS)
def test_depths_agree_with_their_definition(kind: str) -> None:
    largest, inside = agreement(kind, 2).split(", ")
    assert float(largest.split()[0]) < 1e-7
    assert inside.startswith("0 of ")
