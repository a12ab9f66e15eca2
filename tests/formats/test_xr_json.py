"""Hand joints of OpenXR, WebXR and Unity: order, axes, radii, and estimated joints, by the specifications."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import trimesh
from scipy.spatial.transform import Rotation

from hand_recon.detection.detector import Side
from hand_recon.formats.exported_hands import ExportedHands
from hand_recon.formats.xr_joints import XR_JOINTS, XrMotion, xr_motion
from hand_recon.formats.xr_json import OPENXR, UNITY, WEBXR, XrFlavour, write_xr_json
from hand_recon.hand.model import HandModel
from tests.support.exported import clip, photographs
from tests.support.trajectories import moving_hand, still_hand

SIDES: list[Side] = ["right", "left"]

WEBXR_NAMES = [
    "wrist", "thumb-metacarpal", "thumb-phalanx-proximal", "thumb-phalanx-distal", "thumb-tip",
    "index-finger-metacarpal", "index-finger-phalanx-proximal", "index-finger-phalanx-intermediate",
    "index-finger-phalanx-distal", "index-finger-tip",
]  # fmt: skip
"""First names of the WebXR Hand Input Module's table."""


def content(
    hand: HandModel, folder: Path, flavour: XrFlavour, hands: ExportedHands
) -> dict[str, Any]:
    name = f"{flavour.title[0]}.json"
    path = write_xr_json(folder / name, hands.scenes[0], hands.hand, flavour)
    read: dict[str, Any] = json.loads(path.read_text())
    return read


def axes_of(motion: XrMotion) -> np.ndarray:
    """Axes of the joints in columns, by frame and joint."""
    flat = Rotation.from_quat(motion.orientations.reshape(-1, 4)).as_matrix()
    return flat.reshape(*motion.orientations.shape[:2], 3, 3)


def test_names_are_in_the_order_of_the_specifications(hand: HandModel, tmp_path: Path) -> None:
    hands = clip(hand)
    openxr = content(hand, tmp_path, OPENXR, hands)["joints"]
    assert openxr[:6] == [
        f"XR_HAND_JOINT_{name}_EXT"
        for name in ("PALM", "WRIST", "THUMB_METACARPAL", "THUMB_PROXIMAL", "THUMB_DISTAL", "THUMB_TIP")
    ]  # fmt: skip
    places = {
        "INDEX_METACARPAL": 6,
        "MIDDLE_PROXIMAL": 12,
        "RING_INTERMEDIATE": 18,
        "LITTLE_TIP": 25,
    }
    assert {name: openxr.index(f"XR_HAND_JOINT_{name}_EXT") for name in places} == places
    webxr = content(hand, tmp_path, WEBXR, hands)
    assert (len(openxr), len(webxr["joints"])) == (26, 25)
    assert webxr["joints"][:10] == WEBXR_NAMES
    assert webxr["joints"][-1] == "pinky-finger-tip"
    assert webxr["estimated"] == [
        f"{finger}-finger-metacarpal" for finger in ("index", "middle", "ring", "pinky")
    ]
    unity = content(hand, tmp_path, UNITY, hands)["joints"]
    # XRHandJointID: Wrist 1, Palm 2, ThumbMetacarpal 3, IndexMetacarpal 7, LittleTip 26.
    assert (unity[0], unity[1], unity[2], unity[6], unity[25]) == (
        "Wrist", "Palm", "ThumbMetacarpal", "IndexMetacarpal", "LittleTip",
    )  # fmt: skip


@pytest.mark.parametrize("side", SIDES)
def test_minus_z_runs_along_the_bone_that_begins_at_the_joint(hand: HandModel, side: Side) -> None:
    motion = xr_motion(moving_hand(1, side), hand)
    axes = axes_of(motion)
    for joint, name in enumerate(XR_JOINTS):
        if name in {"PALM", "WRIST"} or name.endswith("TIP"):
            continue
        bone = motion.positions[:, joint + 1] - motion.positions[:, joint]
        bone /= np.linalg.norm(bone, axis=-1, keepdims=True)
        tolerance = 1e-5
        if name.endswith("DISTAL"):
            # A fingertip is a point of the skin, which may move a little against its bone.
            tolerance = 2e-3
        assert np.abs(-axes[:, joint, :, 2] - bone).max() < tolerance, name
    # Tips have the axes of their distal bones.
    tips = [joint for joint, name in enumerate(XR_JOINTS) if name.endswith("TIP")]
    before = [joint - 1 for joint in tips]
    np.testing.assert_allclose(axes[:, tips], axes[:, before], atol=1e-9)


@pytest.mark.parametrize("side", SIDES)
def test_y_leaves_the_back_and_x_points_to_the_little_finger_of_a_right_hand(
    hand: HandModel, side: Side
) -> None:
    """A hand with straight fingers and its palm towards the camera, so that its back looks along −z."""
    motion = xr_motion(still_hand(side=side), hand)
    axes = axes_of(motion)[0]
    assert np.allclose(np.linalg.det(axes), 1.0)
    at = dict(zip(XR_JOINTS, motion.positions[0], strict=True))
    fingers = at["MIDDLE_TIP"] - at["WRIST"]
    little = at["LITTLE_PROXIMAL"] - at["INDEX_PROXIMAL"]
    towards_little = {"right": 1.0, "left": -1.0}[side] * little / np.linalg.norm(little)
    for joint, name in enumerate(XR_JOINTS):
        if not name.startswith("THUMB"):
            assert axes[joint, :, 1] @ [0, 0, -1] > 0.94, name
            assert -axes[joint, :, 2] @ fingers > 0.85 * np.linalg.norm(fingers), name
            assert axes[joint, :, 0] @ towards_little > 0.8, name


@pytest.mark.parametrize("side", SIDES)
def test_a_nail_of_a_bent_finger_turns_with_its_bone(hand: HandModel, side: Side) -> None:
    angles = np.zeros((15, 3))
    angles[1, 0] = np.radians(90)
    straight, bent = (xr_motion(still_hand(those, side), hand) for those in (None, angles))
    joint = XR_JOINTS.index("INDEX_INTERMEDIATE")
    before, after = axes_of(straight)[0, joint], axes_of(bent)[0, joint]
    # Flexion by 90° leads the dorsal axis to where the fingertip was, and the fingertip to the palm.
    np.testing.assert_allclose(after[:, 1], -before[:, 2], atol=0.02)
    np.testing.assert_allclose(-after[:, 2], -before[:, 1], atol=0.02)
    np.testing.assert_allclose(after[:, 0], before[:, 0], atol=0.02)
    unmoved = XR_JOINTS.index("INDEX_PROXIMAL")
    np.testing.assert_allclose(axes_of(bent)[0, unmoved], axes_of(straight)[0, unmoved], atol=1e-9)


def test_estimated_joints_lie_on_the_way_from_the_wrist_to_the_mcps(hand: HandModel) -> None:
    motion = xr_motion(moving_hand(), hand)
    at = {name: motion.positions[:, joint] for joint, name in enumerate(XR_JOINTS)}
    for finger in ("INDEX", "MIDDLE", "RING", "LITTLE"):
        whole = np.linalg.norm(at[f"{finger}_PROXIMAL"] - at["WRIST"], axis=-1)
        carpus = np.linalg.norm(at[f"{finger}_METACARPAL"] - at["WRIST"], axis=-1)
        metacarpal = np.linalg.norm(at[f"{finger}_PROXIMAL"] - at[f"{finger}_METACARPAL"], axis=-1)
        np.testing.assert_allclose(carpus + metacarpal, whole, atol=1e-6)
        # Youm's ratio of the carpus' height to the third metacarpal's length.
        np.testing.assert_allclose(carpus / metacarpal, 0.54, atol=1e-5)
    middle = (at["MIDDLE_METACARPAL"] + at["MIDDLE_PROXIMAL"]) / 2
    np.testing.assert_allclose(at["PALM"], middle, atol=1e-7)


def test_radii_are_distances_from_the_skin(hand: HandModel) -> None:
    trajectory = still_hand(hand.rest_angles.double().numpy())
    motion = xr_motion(trajectory, hand)
    vertices, joints = hand.rest(torch.zeros(10))
    skin = vertices.numpy()
    # No point of the skin is nearer than the radius, and some vertex is little farther.
    for name, joint in (("INDEX_INTERMEDIATE", 2), ("THUMB_DISTAL", 15), ("RING_PROXIMAL", 10)):
        radius = motion.radii[XR_JOINTS.index(name)]
        to_vertices = np.linalg.norm(skin - joints[joint].numpy(), axis=1).min()
        assert radius <= to_vertices < radius + 0.003, name
        mesh = trimesh.Trimesh(skin, hand.faces.numpy(), process=False)
        points = trimesh.sample.sample_surface(mesh, 20_000, seed=0)[0]
        nearest = np.linalg.norm(points - joints[joint].numpy(), axis=1).min()
        assert radius <= nearest < radius + 0.0005, name
    assert (motion.radii > 0).all()
    assert 0.004 < np.median(motion.radii) < 0.012


def test_unitys_space_is_the_mirror_image_in_z_of_openxrs(hand: HandModel, tmp_path: Path) -> None:
    hands = photographs(hand)
    openxr, unity = (content(hand, tmp_path, one, hands) for one in (OPENXR, UNITY))
    # Unity's joint k is OpenXR's, but for wrist and palm, which change places.
    order = [1, 0, *range(2, 26)]
    flip = np.diag([1.0, 1.0, -1.0])
    for one, other in zip(openxr["hands"], unity["hands"], strict=True):
        assert [one["radii"][joint] for joint in order] == other["radii"]
        (before,), (after,) = one["frames"], other["frames"]
        positions = np.array(before["positions"])[order] @ flip
        np.testing.assert_allclose(after["positions"], positions, atol=1e-9)
        rotations = [
            Rotation.from_quat(entry["orientations"]).as_matrix() for entry in (before, after)
        ]
        # A point ahead along the bone is at −z in OpenXR and at +z in Unity, and mirrored as a whole.
        ahead = rotations[0][order] @ [0.2, 0.3, -1.0] @ flip
        np.testing.assert_allclose(rotations[1] @ [0.2, 0.3, 1.0], ahead, atol=1e-6)


def test_a_hand_is_inactive_where_it_is_missing(hand: HandModel, tmp_path: Path) -> None:
    left, right = content(hand, tmp_path, OPENXR, clip(hand))["hands"]
    frames = [0, 1, 2, 4, 5, 6, 7, 8, 9]
    assert [one["frame"] for one in left["frames"]] == frames
    assert [one["frame"] for one in left["frames"] if one["is_active"]] == [0, 1, 2, 6, 7, 8, 9]
    assert [one["frame"] for one in right["frames"] if one["is_active"]] == [4, 5, 6, 7, 8, 9]
    assert left["frames"][3] == {"frame": 4, "time": 0.133333, "is_active": False}
    assert (left["side"], right["side"], len(left["radii"])) == ("left", "right", 26)
