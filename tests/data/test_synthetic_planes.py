"""Vectors as planes agree with NumPy's own functions; creases and nails are computed wherever they show."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hand_recon.data.synthetic.levels import DIFFICULTIES
from hand_recon.data.synthetic.planes import cross, length, mixed
from hand_recon.data.synthetic.recipe import Recipe
from hand_recon.data.synthetic.skin import SkinSpots, sample_tone, skin_albedo
from hand_recon.data.synthetic.skin_map import CREASE_REACH, NAIL, NAIL_BED, SkinMap, skin_map
from hand_recon.data.synthetic.surface import tube_faces, vertex_normals
from hand_recon.hand.open_hand import open_hand


@given(seed=st.integers(0, 2**32 - 1), kind=st.sampled_from([np.float32, np.float64]))
@settings(max_examples=30, deadline=None)
def test_vectors_as_planes_have_numpys_cross_products_and_lengths_to_the_bit(
    seed: int, kind: type[np.floating]
) -> None:
    first, second = np.random.default_rng(seed).normal(size=(2, 50, 3)).astype(kind)
    assert np.array_equal(cross(first.T, second.T).T, np.cross(first, second))
    assert np.array_equal(length(first.T), np.linalg.norm(first, axis=1))


def test_a_quarter_of_the_way_from_one_colour_to_another() -> None:
    found = mixed(np.array([0.0, 0.4, 1.0]), np.array([1.0, 0.0, 1.0]), np.array([[0.25, 1.0]]))
    assert found.shape == (3, 1, 2)
    assert found[:, 0, 0] == pytest.approx([0.25, 0.3, 1.0])
    assert found[:, 0, 1] == pytest.approx([1.0, 0.0, 1.0])


def test_normals_are_the_means_of_the_triangles_around_weighted_by_area() -> None:
    random = np.random.default_rng(0)
    vertices, faces = (
        random.normal(size=(9, 3)),
        random.permuted(np.tile(np.arange(9), (12, 1)), axis=1),
    )
    faces = faces[:, :3]
    sums = np.zeros((9, 3))
    for face in faces:
        a, b, c = vertices[face]
        for corner in face:
            sums[corner] += np.cross(b - a, c - a)
    expected = sums / np.linalg.norm(sums, axis=1, keepdims=True)
    assert vertex_normals(vertices, faces) == pytest.approx(expected, abs=1e-12)


def test_the_triangles_of_a_tube_are_made_once_and_cannot_be_changed() -> None:
    faces = tube_faces(3, 5)
    assert faces is tube_faces(3, 5)
    with pytest.raises(ValueError, match="read-only"):
        faces[0, 0] = 7


@pytest.fixture(scope="module")
def skin() -> SkinMap:
    return skin_map(open_hand("knuckle"))


def spots_on_the_hand(count: int, seed: int) -> SkinSpots:
    """Random points on random triangles of the hand at rest, with the attributes of skin at random."""
    random, model = np.random.default_rng(seed), open_hand("knuckle")
    faces = model.faces.numpy()[random.integers(len(model.faces), size=count)]
    vertices = model.rest(model.template.new_zeros(10))[0].numpy()
    points = np.einsum("hc,hcx->hx", random.dirichlet([0.5] * 3, size=count), vertices[faces])
    return SkinSpots(
        points.T.astype(np.float32),
        random.uniform(-1, 1, size=count).astype(np.float32),
        random.uniform(0, 1, size=count).astype(np.float32),
        faces[:, 0],
    )


@pytest.mark.parametrize("seed", range(4))
def test_creases_and_nails_are_left_out_only_where_they_change_no_bit(
    skin: SkinMap, seed: int
) -> None:
    everywhere = np.ones_like(skin.creased)
    slow = replace(skin, creased=everywhere, nailed=everywhere)
    tone = sample_tone(
        Recipe("train", DIFFICULTIES["easy"], 64, seed).random(seed, "tone"), held_out=False
    )
    spots = spots_on_the_hand(20_000, seed)
    assert np.array_equal(skin_albedo(tone, skin, spots), skin_albedo(tone, slow, spots))


def test_most_of_the_hand_has_neither_creases_nor_nails_nearby(
    skin: SkinMap,
) -> None:
    assert 0.02 < skin.nailed.mean() < 0.3
    assert 0.1 < skin.creased.mean() < 0.6


def test_every_vertex_in_the_box_of_its_crease_or_under_its_nail_is_marked(
    skin: SkinMap,
) -> None:
    vertices = open_hand("knuckle").rest(open_hand("knuckle").template.new_zeros(10))[0].numpy()
    begins = np.isin(np.arange(len(vertices)), open_hand("knuckle").faces.numpy()[:, 0])
    which = skin.crease_of
    local = np.einsum("vij,vj->vi", skin.frames[which], vertices - skin.joints[which])
    inside = (np.abs(local) < CREASE_REACH).all(axis=1) & begins
    assert inside.any()
    assert skin.creased[inside].all()
    which = skin.nail_of
    local = np.einsum("vij,vj->vi", skin.nail_frames[which], vertices - skin.nail_centres[which])
    size = NAIL * skin.nail_size[which][:, None]
    inside = (np.abs(local[:, ::2]) < size).all(axis=1) & (local[:, 1] > NAIL_BED) & begins
    assert inside.any()
    assert skin.nailed[inside].all()
