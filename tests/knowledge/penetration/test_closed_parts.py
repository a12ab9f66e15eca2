"""The hand's surface cut into closed parts, and geodesic distances on it."""

import math

import numpy as np
import pytest
import torch
import trimesh

from hand_recon.hand.model import HandAsset, HandModel
from hand_recon.hand.open_hand import load_open_hand
from hand_recon.hand.skeleton import JOINTS
from hand_recon.knowledge.penetration.closed_parts import (
    PARTS,
    ClosedParts,
    closed_parts,
    geodesic_distances,
)
from hand_recon.knowledge.penetration.non_penetration import NonPenetration
from hand_recon.knowledge.penetration.winding_number import winding_number
from tests.support.random_surfaces import capped, random_vertices
from tests.support.tolerance import assert_close


@pytest.fixture(scope="module")
def parts(hand: HandModel) -> ClosedParts:
    return closed_parts(hand)


def test_the_palm_and_fourteen_phalanges_are_each_closed(
    hand: HandModel, parts: ClosedParts
) -> None:
    points = np.concatenate([hand.template.numpy(), parts.centres @ hand.template.numpy()])
    for part, faces in enumerate(parts.faces):
        mesh = trimesh.Trimesh(points, faces, process=False)
        assert mesh.is_watertight, JOINTS[PARTS[part]]
        assert mesh.is_winding_consistent, JOINTS[PARTS[part]]
        assert mesh.volume > 1e-6, JOINTS[PARTS[part]]


def test_the_wrist_is_capped_with_the_right_side_out(hand: HandModel) -> None:
    points, faces = capped(hand, hand.template[None])
    mesh = trimesh.Trimesh(points[0].numpy(), faces.numpy(), process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    # A hand of about 0.3 litres.
    assert 1e-4 < mesh.volume < 5e-4


def test_the_parts_together_wind_as_the_whole_hand_does(
    hand: HandModel, parts: ClosedParts
) -> None:
    """Adjacent parts share the fans between them, which cancel in the sum."""
    vertices = random_vertices(hand, 2, spread=0.9).double()
    places = vertices.flatten(0, 1)[torch.randint(1556, (300,))] + 0.004 * torch.randn(300, 3)
    asked = torch.arange(300) % 2
    points = torch.cat([vertices, torch.from_numpy(parts.centres) @ vertices], dim=1)
    each = [winding_number(places, asked, points, torch.from_numpy(f)) for f in parts.faces]
    whole = winding_number(places, asked, *capped(hand, vertices))
    assert int((whole.round() == 2).sum()) > 0
    assert_close(torch.stack(each).sum(dim=0), whole)


def test_every_triangle_belongs_to_one_part(hand: HandModel, parts: ClosedParts) -> None:
    skin = [faces[(faces < 778).all(axis=1)] for faces in parts.faces]
    together = {tuple(face) for face in np.concatenate(skin).tolist()}
    assert together == {tuple(face) for face in hand.faces.tolist()}
    assert sum(len(faces) for faces in skin) == len(hand.faces)


def test_a_vertex_cannot_penetrate_its_own_part_or_the_next(
    hand: HandModel, parts: ClosedParts
) -> None:
    tip = int(hand.landmark_regressor[8, :778].argmax())
    opponents = {JOINTS[PARTS[part]] for part in np.flatnonzero(parts.opponents[tip])}
    assert opponents == {JOINTS[part] for part in PARTS} - {"index PIP", "index DIP"}


def test_an_open_surface_is_refused(hand: HandModel) -> None:
    asset = load_open_hand()
    torn = HandAsset(**{**vars(asset), "faces": asset.faces[1:]})
    with pytest.raises(ValueError, match="found 3 edges with one side and 0 with more than two"):
        NonPenetration(HandModel(torn))


def test_geodesic_distances_go_around_the_corners_of_a_surface() -> None:
    """Two unit squares that meet at a right angle: diagonals, then edges."""
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [1, 0, 1], [1, 1, 1.0]])
    faces = np.array([[0, 1, 2], [0, 2, 3], [1, 4, 5], [1, 5, 2]])
    distances = geodesic_distances(points, faces)
    assert distances[0, 2] == pytest.approx(math.sqrt(2))
    assert distances[0, 5] == pytest.approx(1 + math.sqrt(2))
    assert distances[3, 4] == pytest.approx(3)
    np.testing.assert_allclose(distances, distances.T)
