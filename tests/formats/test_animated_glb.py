"""Animated GLB files, read back by an independent reader, hold the motion that was written."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import trimesh
from scipy.spatial.transform import Rotation, Slerp

from hand_recon.detection.detector import Side
from hand_recon.formats.animated_glb import animated_glb, write_animated_glb
from hand_recon.hand.anatomical_frame import joint_rotations
from hand_recon.hand.model import HandModel
from hand_recon.motion.trajectory import Trajectory
from tests.support.glb_reader import GlbReader
from tests.support.trajectories import (
    MIRROR,
    TO_GLTF,
    Clip,
    in_camera,
    in_world,
    moving_hand,
    still_hand,
    without_frames,
)

TENTH_OF_A_MILLIMETRE = 1e-4
SIDES: list[Side] = ["right", "left"]


def read(hands: list[Trajectory], hand: HandModel, duration: float | None = None) -> GlbReader:
    return GlbReader(animated_glb(hands, hand, duration))


def pair() -> list[Trajectory]:
    """A left hand in frames 0 to 19, and a right one in frames 6 to 13."""
    return [moving_hand(1, "left"), moving_hand(2, "right", Clip(frames=8, start=6, seed=1))]


def test_posed_vertices_are_the_hand_models_at_every_frame(hand: HandModel) -> None:
    hands = pair()
    glb = read(hands, hand)
    for trajectory in hands:
        expected = in_world(in_camera(trajectory, hand).vertices)
        for time, vertices in zip(trajectory.times.tolist(), expected, strict=True):
            # A viewer's clock does not meet a key exactly; just after it, the key's pose is shown.
            found = glb.posed(f"hand_{trajectory.hand}_{trajectory.side}", time + 1e-6)
            assert np.abs(found - vertices).max() < TENTH_OF_A_MILLIMETRE


@pytest.mark.parametrize("side", SIDES)
def test_between_frames_joints_rotate_on_the_shortest_arc(hand: HandModel, side: Side) -> None:
    trajectory = moving_hand(1, side)
    glb = read([trajectory], hand)
    ends = joint_rotations(
        torch.as_tensor(trajectory.joint_angles).float(), hand.frames, hand.rest_angles
    ).numpy()
    mirror = np.diag(MIRROR.numpy() if side == "left" else np.ones(3))
    wrists = in_camera(trajectory, hand).joints[:, 0].double().numpy()
    for frame, share in zip(range(19), np.linspace(0.05, 0.95, 19).tolist(), strict=True):
        pair_of_frames = slice(frame, frame + 2)
        fingers = np.stack(
            [
                Slerp([0, 1], Rotation.from_matrix(ends[pair_of_frames, joint]))(share).as_matrix()
                for joint in range(15)
            ]
        )
        shape = torch.as_tensor(trajectory.shape).float()
        posed = hand.pose(torch.as_tensor(fingers).float(), shape)
        local = (posed.vertices - posed.joints[0]).double().numpy() @ mirror
        root = Slerp([0, 1], Rotation.from_matrix(trajectory.root_rotation[pair_of_frames]))(share)
        wrist = wrists[frame] + share * (wrists[frame + 1] - wrists[frame])
        expected = (root.apply(local) + wrist) * TO_GLTF
        found = glb.posed(f"hand_1_{side}", (frame + share) / 30)
        assert np.abs(found - expected).max() < TENTH_OF_A_MILLIMETRE


def test_hands_stay_in_step_with_the_clip(hand: HandModel) -> None:
    glb = read(pair(), hand)
    for name, times in [
        ("hand_1_left", np.arange(20) / 30),
        ("hand_2_right", np.arange(6, 14) / 30),
    ]:
        for path in ("rotation", "translation"):
            keys = glb.array(glb.channels(glb.named(f"{name}_wrist"))[path]["input"])[:, 0]
            assert np.allclose(keys, times, atol=1e-6)


def test_a_hand_is_hidden_before_its_first_frame_and_after_its_last(hand: HandModel) -> None:
    glb = read(pair(), hand)

    def size(name: str, frame: float) -> float:
        return float(np.ptp(glb.posed(name, frame / 30 + 1e-4), axis=0).max())

    assert [size("hand_2_right", frame) > 0.05 for frame in (0, 5.9, 6, 13, 13.9, 14, 19)] == [
        False, False, True, True, True, False, False,
    ]  # fmt: skip
    assert size("hand_2_right", 5.9) < 1e-6
    # The other one is there throughout.
    assert "scale" not in glb.channels(glb.named("hand_1_left_wrist"))
    assert min(size("hand_1_left", frame) for frame in (0, 10, 19)) > 0.05


def test_a_hand_is_hidden_in_a_gap_that_was_not_bridged(hand: HandModel) -> None:
    gap = without_frames(moving_hand(1, "left"), *range(5, 12))
    glb = GlbReader(animated_glb([gap], hand))
    scale = glb.channels(glb.named("hand_1_left_wrist"))["scale"]
    assert np.allclose(glb.array(scale["input"])[:, 0], [0, 5 / 30, 12 / 30])
    assert glb.array(scale["output"])[:, 0].tolist() == [1, 0, 1]


def test_all_hands_are_hidden_until_the_end_of_a_longer_clip(hand: HandModel) -> None:
    glb = read(pair(), hand, duration=2.0)
    scale = glb.channels(glb.named("hand_1_left_wrist"))["scale"]
    assert np.allclose(glb.array(scale["input"])[:, 0], [0, 20 / 30])
    assert glb.array(scale["output"]).tolist() == [[1, 1, 1], [0, 0, 0]]
    # A clip cannot end before its hands do.
    assert animated_glb(pair(), hand, duration=0.1) == animated_glb(pair(), hand)


def test_a_hand_that_ends_one_frame_early_is_hidden_at_the_last_frame(hand: HandModel) -> None:
    hands = [moving_hand(1), moving_hand(2, "left", Clip(frames=19))]
    keys = [glb_keys(read(hands, hand), f"hand_{number}") for number in ("1_right", "2_left")]
    assert keys[0] == []
    assert np.allclose(keys[1], [0, 19 / 30])


def glb_keys(glb: GlbReader, name: str) -> list[float]:
    """Times at which the visibility of a hand changes."""
    scale = glb.channels(glb.named(f"{name}_wrist")).get("scale")
    return [] if scale is None else glb.array(scale["input"])[:, 0].tolist()


@pytest.mark.parametrize("side", SIDES)
def test_a_single_frame_is_a_file_too(hand: HandModel, side: Side) -> None:
    trajectory = still_hand(side=side)
    found = read([trajectory], hand).posed(f"hand_1_{side}", 0.0)
    expected = in_world(in_camera(trajectory, hand).vertices)[0]
    assert np.abs(found - expected).max() < TENTH_OF_A_MILLIMETRE


def test_skeletons_rest_in_the_pose_of_the_mesh_at_the_first_place(hand: HandModel) -> None:
    trajectory = pair()[1]
    glb = read([trajectory], hand)
    glb.document["animations"][0]["channels"].clear()
    vertices, joints = hand.rest(torch.as_tensor(trajectory.shape).float())
    local = (vertices - joints[0]).double().numpy()
    wrist = in_camera(trajectory, hand).joints[0, 0].double().numpy()
    expected = (local @ trajectory.root_rotation[0].T + wrist) * TO_GLTF
    assert np.abs(glb.posed("hand_2_right", 0.0) - expected).max() < TENTH_OF_A_MILLIMETRE


@pytest.mark.parametrize("side", SIDES)
def test_trimesh_reads_the_rest_mesh_wound_outwards(
    tmp_path: Path, hand: HandModel, side: Side
) -> None:
    trajectory = moving_hand(1, side)
    path = write_animated_glb(tmp_path / "new" / "hand.glb", [trajectory], hand)
    found: Any = trimesh.load(path, force="mesh", process=False)
    rest = hand.rest(torch.as_tensor(trajectory.shape).float())[0].numpy()
    expected = rest * (MIRROR.numpy() if side == "left" else 1)
    assert np.abs(found.vertices - expected).max() < 1e-6
    assert len(found.faces) == len(hand.faces)
    # By the winding alone; the mesh is open at the wrist alone.
    assert found.volume > 1e-4
    outside = np.cross(*(found.triangles[:, corner] - found.triangles[:, 0] for corner in (1, 2)))
    normals = GlbReader(path.read_bytes()).attribute(f"hand_1_{side}", "NORMAL")
    assert np.allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-6)
    along = (normals[found.faces].mean(axis=1) * outside).sum(axis=1)
    assert (along > 0).mean() > 0.99


def test_nothing_is_overwritten(tmp_path: Path, hand: HandModel) -> None:
    path = tmp_path / "hand.glb"
    path.write_bytes(b"mine")
    with pytest.raises(FileExistsError, match=r"hand\.glb exists and is not overwritten"):
        write_animated_glb(path, [still_hand()], hand)
    assert path.read_bytes() == b"mine"


def test_what_cannot_be_written_is_refused(hand: HandModel) -> None:
    still = still_hand()
    with pytest.raises(ValueError, match="Found no hand"):
        animated_glb([], hand)
    none = replace(moving_hand(clip=Clip(frames=0)), hand=3)
    with pytest.raises(ValueError, match="Hand 3 has no frame"):
        animated_glb([none], hand)
    for name in ("times", "joint_angles", "root_rotation", "translation", "shape"):
        lost = replace(still, **{name: np.full_like(getattr(still, name), np.nan)})
        with pytest.raises(ValueError, match="Hand 1 has numbers that are not finite"):
            animated_glb([lost], hand)
    with pytest.raises(ValueError, match=r"Hand 1 begins at -0\.5 s"):
        animated_glb([replace(still, times=np.array([-0.5]))], hand)
    moving = moving_hand()
    with pytest.raises(ValueError, match="equal in single precision"):
        animated_glb([replace(moving, times=moving.times + 1.7e9)], hand)
