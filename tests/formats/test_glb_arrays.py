"""Arrays of animated GLB files keep to the glTF 2.0 specification."""

import json
import logging
import os
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hand_recon.formats.animated_glb import animated_glb
from hand_recon.formats.joint_motion import to_quaternions
from hand_recon.formats.skin import strongest
from hand_recon.hand.model import HandModel
from hand_recon.hand.open_hand import load_open_hand
from tests.support.glb_reader import GlbReader
from tests.support.trajectories import Clip, in_camera, in_world, moving_hand

TWO = [moving_hand(1, "left"), moving_hand(2, "right", Clip(frames=8, start=6, seed=1))]

VALIDATE = """
const validator = require('gltf-validator');
const bytes = new Uint8Array(require('fs').readFileSync(process.argv[1]));
validator.validateBytes(bytes).then(report => console.log(JSON.stringify(report.issues)));
"""


@pytest.fixture(scope="module")
def glb(hand: HandModel) -> GlbReader:
    return GlbReader(animated_glb(TWO, hand))


def test_bounds_are_those_of_the_arrays(glb: GlbReader) -> None:
    bounded = [index for index, one in enumerate(glb.document["accessors"]) if "min" in one]
    for index in bounded:
        values, entry = glb.array(index), glb.document["accessors"][index]
        assert entry["min"] == values.min(axis=0).tolist()
        assert entry["max"] == values.max(axis=0).tolist()
    (animation,) = glb.document["animations"]
    needed = {sampler["input"] for sampler in animation["samplers"]}
    needed |= {mesh["primitives"][0]["attributes"]["POSITION"] for mesh in glb.document["meshes"]}
    assert needed == set(bounded)


def test_arrays_are_aligned_and_inside_the_buffer(glb: GlbReader) -> None:
    end = 0
    for view in glb.document["bufferViews"]:
        assert view["byteOffset"] % 4 == 0
        assert view["byteOffset"] >= end
        end = view["byteOffset"] + view["byteLength"]
    assert end <= len(glb.binary)


@pytest.mark.parametrize("name", ["hand_1_left", "hand_2_right"])
def test_weights_of_at_most_four_joints_sum_to_one(glb: GlbReader, name: str) -> None:
    weights, joints = glb.attribute(name, "WEIGHTS_0"), glb.attribute(name, "JOINTS_0")
    assert weights.shape[1] == 4
    assert (weights >= 0).all()
    assert np.abs(weights.sum(axis=1) - 1).max() < 2e-7
    assert (joints[weights == 0] == 0).all()
    for row, used in zip(joints, weights > 0, strict=True):
        assert len(set(row[used])) == used.sum()


def test_meshes_are_at_the_root_of_the_scene_without_a_transform(glb: GlbReader) -> None:
    roots = glb.document["scenes"][0]["nodes"]
    meshes = [index for index, node in enumerate(glb.nodes) if "mesh" in node]
    assert len(meshes) == 2
    for index in meshes:
        assert index in roots
        assert not {"translation", "rotation", "scale", "matrix"} & set(glb.nodes[index])
    assert sorted(set(roots) - set(meshes)) == sorted(
        skin["joints"][0] for skin in glb.document["skins"]
    )
    assert all("scale" not in node for node in glb.nodes)


def test_names_are_distinct_and_without_spaces(glb: GlbReader) -> None:
    names = [node["name"] for node in glb.nodes]
    assert len(set(names)) == len(names) == 2 * 17
    assert not any(" " in name for name in names)
    assert "hand_1_left_index_MCP" in names


def test_inverse_bind_matrices_move_each_joint_to_the_origin(
    glb: GlbReader, hand: HandModel
) -> None:
    (skin, _) = glb.document["skins"]
    matrices = glb.array(skin["inverseBindMatrices"]).reshape(-1, 4, 4).swapaxes(1, 2)
    joints = hand.rest(torch.as_tensor(TWO[0].shape).float())[1].numpy() * [-1, 1, 1]
    moved = matrices @ np.concatenate([joints, np.ones((16, 1))], axis=1)[..., None]
    assert np.abs(moved[:, :3, 0]).max() < 1e-7
    assert (matrices[:, 3] == [0, 0, 0, 1]).all()


def test_every_rotation_and_one_translation_of_a_hand_are_animated_once(glb: GlbReader) -> None:
    (animation,) = glb.document["animations"]
    targets = [(one["target"]["node"], one["target"]["path"]) for one in animation["channels"]]
    assert len(set(targets)) == len(targets)
    for skin in glb.document["skins"]:
        paths = [path for node, path in targets if node in skin["joints"]]
        assert paths.count("rotation") == 16
        assert [node for node, path in targets if node in skin["joints"] and path == "translation"] == [
            skin["joints"][0]
        ]  # fmt: skip


def test_hands_have_colours_of_their_own(hand: HandModel) -> None:
    hands = [moving_hand(number, "right", Clip(frames=2)) for number in (1, 2, 3)]
    materials = GlbReader(animated_glb(hands, hand)).document["materials"]
    colours = {tuple(one["pbrMetallicRoughness"]["baseColorFactor"]) for one in materials}
    assert len(colours) == 3
    # 225 of 255 in sRGB is 0.7529 of the light.
    assert materials[0]["pbrMetallicRoughness"]["baseColorFactor"][2] == pytest.approx(
        0.7529, abs=1e-4
    )


@given(st.lists(st.tuples(*[st.floats(-4, 4)] * 3), min_size=1, max_size=8))
def test_neighbouring_quaternions_are_in_one_hemisphere(
    axis_angles: list[tuple[float, ...]],
) -> None:
    rotations = Rotation.from_rotvec(np.array(axis_angles)).as_matrix()[:, None]
    quaternions = to_quaternions(rotations)
    assert (np.sum(quaternions[1:] * quaternions[:-1], axis=-1) >= 0).all()
    back = Rotation.from_quat(quaternions[:, 0]).as_matrix()
    assert np.abs(back - rotations[:, 0]).max() < 1e-9


def test_a_whole_turn_ends_at_the_opposite_quaternion() -> None:
    turn = Rotation.from_rotvec(np.linspace(0, 2 * np.pi, 9)[:, None] * [0, 0, 1]).as_matrix()
    quaternions = to_quaternions(turn[:, None])[:, 0]
    assert np.allclose(quaternions[-1], -quaternions[0])
    assert np.allclose(np.abs(quaternions[4]), [0, 0, 1, 0])


def test_the_four_strongest_joints_are_kept_and_scaled() -> None:
    row = np.zeros((2, 16))
    row[0, [3, 5, 7, 9, 11]] = [0.1, 0.4, 0.2, 0.25, 0.05]
    row[1, 15] = 1.0
    joints, weights = strongest(row)
    assert joints.tolist() == [[5, 9, 7, 3], [15, 0, 0, 0]]
    assert np.allclose(weights[0], np.array([0.4, 0.25, 0.2, 0.1]) / 0.95)
    assert weights[1].tolist() == [1, 0, 0, 0]


@pytest.mark.parametrize("crowded", [False, True])
def test_what_gltf_cannot_hold_is_left_out_with_a_note(
    hand: HandModel, caplog: pytest.LogCaptureFixture, crowded: bool
) -> None:
    asset = load_open_hand()
    if crowded:
        asset = replace(asset, skinning_weights=0.95 * asset.skinning_weights + 0.05 / 16)
    else:
        asset = replace(asset, pose_directions=3e-4 * torch.randn(len(asset.template), 3, 135))
    richer, trajectory = HandModel(asset), moving_hand(1, "left", Clip(frames=4))
    with caplog.at_level(logging.INFO, "hand_recon"):
        glb = GlbReader(animated_glb([trajectory], richer))
    frames = in_world(in_camera(trajectory, richer).vertices)
    found = np.stack([glb.posed("hand_1_left", time + 1e-6) for time in trajectory.times])
    largest = 1000 * np.linalg.norm(found - frames, axis=-1).max()
    part = "skinning weights beyond four per vertex" if crowded else "pose blend shapes"
    assert part in caplog.text
    assert largest > 0.5
    (named,) = re.findall(r"vertices differ by up to (\S+) mm", caplog.text)
    assert float(named) == pytest.approx(largest, abs=0.03)
    if not crowded:
        plain = in_world(in_camera(trajectory, hand).vertices)
        assert np.abs(found - plain).max() < 1e-4


def test_the_open_hand_is_written_without_a_note(
    hand: HandModel, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.INFO, "hand_recon"):
        animated_glb([moving_hand(clip=Clip(frames=2))], hand)
    assert not caplog.records


@pytest.mark.slow
@pytest.mark.parametrize("frames", [1, 20])
def test_the_validator_of_khronos_finds_nothing(
    tmp_path: Path, hand: HandModel, frames: int
) -> None:
    node = shutil.which("node")
    if node is None:
        pytest.skip("needs Node.js")
    if subprocess.run([node, "-e", "require('gltf-validator')"], capture_output=True).returncode:  # noqa: S603  # the command is ours
        pytest.skip(
            "needs the npm package gltf-validator: npm install --prefix <folder> gltf-validator, then "
            f"NODE_PATH=<folder>/node_modules; NODE_PATH is {os.environ.get('NODE_PATH')!r}"
        )
    path = tmp_path / "hands.glb"
    later = moving_hand(2, "right", Clip(frames=8, start=6, seed=1))
    path.write_bytes(animated_glb([moving_hand(1, "left", Clip(frames=frames)), later], hand))
    run = subprocess.run(  # noqa: S603  # the command is ours
        [node, "-e", VALIDATE, str(path)], capture_output=True, text=True, check=True
    )
    issues = json.loads(run.stdout)
    assert issues["messages"] == []
    assert (issues["numErrors"], issues["numWarnings"]) == (0, 0)
