"""Landmark sets moved by offsets that are fixed to the bones."""

import dataclasses
from pathlib import Path

import pytest
import torch

from hand_recon.command_line.configuration_files import CONF
from hand_recon.hand.anatomical_frame import joint_rotations
from hand_recon.hand.landmark_offsets import carrying_joints, with_offsets
from hand_recon.hand.model import HandAsset, HandModel
from hand_recon.hand.open_hand import load_open_hand, open_hand
from hand_recon.hand.skeleton import JOINTS, LANDMARKS
from hand_recon.knowledge.ranges import load_ranges


@pytest.fixture(scope="module")
def asset() -> HandAsset:
    return load_open_hand()


def moved_hand(asset: HandAsset, offsets: torch.Tensor) -> HandModel:
    """The open hand with its rotation centres as landmarks, moved by offsets."""
    regressor = with_offsets(asset, asset.landmark_regressors["knuckle"], offsets)
    return HandModel(dataclasses.replace(asset, landmark_regressors={"moved": regressor}), "moved")


def test_a_landmark_is_carried_by_the_bone_before_it() -> None:
    carriers = dict(zip(LANDMARKS, carrying_joints(), strict=True))
    assert {carriers[name] for name in ("wrist", "thumb CMC", "index MCP", "little MCP")} == {0}
    assert JOINTS[carriers["thumb MCP"]] == "thumb CMC"
    assert JOINTS[carriers["thumb tip"]] == "thumb IP"
    assert JOINTS[carriers["ring PIP"]] == "ring MCP"
    assert JOINTS[carriers["little tip"]] == "little DIP"


def test_no_offset_is_no_change(asset: HandAsset) -> None:
    regressor = asset.landmark_regressors["knuckle"]
    torch.testing.assert_close(with_offsets(asset, regressor, torch.zeros(21, 3)), regressor)


def test_weights_of_an_offset_add_up_to_zero(asset: HandAsset) -> None:
    regressor = asset.landmark_regressors["knuckle"]
    added = with_offsets(asset, regressor, 0.01 * torch.randn(21, 3)) - regressor
    torch.testing.assert_close(added.sum(dim=1), torch.zeros(21), rtol=0, atol=1e-5)


def test_a_landmark_moves_by_its_offset_at_rest(asset: HandAsset) -> None:
    """In the template, each landmark moves by its offset in the axes of its bone."""
    offsets = 0.01 * torch.randn(21, 3)
    moved = moved_hand(asset, offsets)
    template, centres = asset.template, asset.joints
    change = (moved.landmark_regressor - asset.landmark_regressors["knuckle"]) @ torch.cat(
        [template, centres]
    )
    for landmark, joint in enumerate(carrying_joints()):
        axes = torch.eye(3) if joint == 0 else asset.frames[joint - 1]
        torch.testing.assert_close(change[landmark], axes @ offsets[landmark], rtol=0, atol=1e-6)


def test_an_offset_rotates_with_its_bone(asset: HandAsset) -> None:
    """In any pose 5 mm stay within a millimetre of rigid: skin near a joint moves with both bones."""
    offsets = 0.005 * torch.nn.functional.normalize(torch.randn(21, 3), dim=1)
    plain, moved = open_hand(), moved_hand(asset, offsets)
    ranges = load_ranges("literature", asset.rest_angles)
    angles = ranges.lower + (ranges.upper - ranges.lower) * torch.rand(64, 15, 3)
    shape = torch.zeros(64, 10)
    change = moved(angles, shape).landmarks - plain(angles, shape).landmarks
    local = joint_rotations(angles, asset.frames, asset.rest_angles)
    orientations = {0: torch.eye(3).expand(64, 3, 3)}
    for joint in range(1, 16):
        parent = 0 if joint % 3 == 1 else joint - 1
        orientations[joint] = orientations[parent] @ local[:, joint - 1]
    for landmark, joint in enumerate(carrying_joints()):
        axes = torch.eye(3) if joint == 0 else asset.frames[joint - 1]
        expected = (orientations[joint] @ (axes @ offsets[landmark])[..., None])[..., 0]
        away = (change[:, landmark] - expected).norm(dim=-1)
        assert float(away.mean()) < 0.001, LANDMARKS[landmark]


def test_the_detectors_landmarks_differ_as_people_say(asset: HandAsset) -> None:
    """MediaPipe's wrist is nearer to the forearm than the model's, and its fingertips are as far out."""
    offsets = (
        asset.landmark_regressors["mediapipe"] - asset.landmark_regressors["knuckle"]
    ) @ torch.cat([asset.template, asset.joints])
    size = offsets.norm(dim=1)
    assert 0.001 < float(size.mean()) < 0.006
    assert float(size.amax()) < 0.015
    assert float(size[[4, 8, 12, 16, 20]].mean()) < 0.005


def test_the_document_has_the_range_of_the_detectors_offsets() -> None:
    """At the mean shape, from the landmarks of the hand model itself."""
    angles, shape = torch.zeros(15, 3), torch.zeros(10)
    knuckle, mediapipe = (open_hand(name)(angles, shape) for name in ("knuckle", "mediapipe"))
    found = 1000 * (mediapipe.landmarks - knuckle.landmarks).norm(dim=-1)
    document = (Path(CONF).parent / "docs" / "open_hand.md").read_text(encoding="utf-8")
    assert f"of {found.min():.1f} to {found.max():.1f} mm" in document
