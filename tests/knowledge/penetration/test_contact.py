"""Vertices inside another part, and the memory that finding them takes."""

import numpy as np
import torch
import trimesh

from hand_recon.hand.model import HandModel
from hand_recon.knowledge.penetration.closed_parts import closed_parts
from hand_recon.knowledge.penetration.contact import first_of_each
from hand_recon.knowledge.penetration.non_penetration import NonPenetration
from tests.support.largest_tensor import LargestTensor
from tests.support.random_surfaces import random_vertices
from tests.support.tolerance import assert_close


def test_what_is_inside_is_inside_for_trimesh(hand: HandModel) -> None:
    """Against trimesh's ray test of each part, which may be wrong within 1 mm of the skin."""
    parts = closed_parts(hand)
    for vertices in random_vertices(hand, 3):
        points = np.concatenate([vertices.numpy(), parts.centres @ vertices.numpy()])
        inside = np.zeros(len(vertices), dtype=bool)
        for part, faces in enumerate(parts.faces):
            asked = np.flatnonzero(parts.opponents[:, part])
            mesh = trimesh.Trimesh(points, faces, process=False)
            inside[asked] |= mesh.contains(vertices[asked].numpy())
        depths = NonPenetration(hand, geodesic=0.0).depths(vertices).numpy()
        assert inside.sum() > 20
        assert inside[depths > 0.001].all()
        assert ((depths > 0) == inside).mean() > 0.995


def test_the_bound_on_memory_is_kept_and_changes_no_value(hand: HandModel) -> None:
    vertices = random_vertices(hand, 8, spread=1.0)
    small, large = (NonPenetration(hand, at_once=bound) for bound in (4000, 10**9))
    expected = NonPenetration(hand)(vertices)
    assert_close(small(vertices), expected)
    assert_close(large(vertices), expected)
    with LargestTensor() as bounded:
        small.depths(vertices)
    with LargestTensor() as free:
        large.depths(vertices)
    # The centres of 15 openings are weighted sums of each hand's vertices, whatever the pose.
    assert bounded.numbers <= max(9 * 4000, 8 * 15 * 778)
    assert free.numbers > 3 * bounded.numbers


def test_the_first_of_each_group_has_the_least_value() -> None:
    group = torch.tensor([3, 0, 3, 3, 0])
    value = torch.tensor([2.0, 5.0, 1.0, 4.0, 6.0])
    assert first_of_each(group, value).tolist() == [1, 2]
    assert first_of_each(group[:0], value[:0]).tolist() == []
