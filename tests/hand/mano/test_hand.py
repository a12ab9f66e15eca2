"""MANO as a `HandModel`: its anatomical axes, joint angles and landmark sets."""

from pathlib import Path

import numpy as np
import pytest
import torch
from hydra.utils import instantiate
from omegaconf import OmegaConf

from hand_recon.hand.anatomical_axes import axes_at_rest, rotation
from hand_recon.hand.mano.hand import TIP_VERTICES, load_mano, mano_hand, tip_vertices
from hand_recon.hand.model import HandModel
from hand_recon.hand.open_hand import load_open_hand, open_hand
from hand_recon.hand.skeleton import (
    ARTICULATED,
    JOINT_OF_LANDMARK,
    LANDMARKS,
    TIPS,
)
from tests.support.mano_file import AZIMUTHS, mano_arrays, write_mano_folder
from tests.support.tolerance import BATCH_SHAPES, assert_close

ROOT = Path(__file__).resolve().parents[3]

# x, y, z of R_y R_x R_z, degrees, by which the authors' release rotates MANO's axes to each joint's own
# (zhangy76/KNOWN-Hand, constants.py, right hand).
RELEASE = {
    "index": [(0, -6, 10), (0, 1, -5), (0, -10, 0)],
    "middle": [(0, 10, 2), (0, 10, -2), (0, 10, 10)],
    "little": [(30, 35, 10), (20, 42, 8), (15, 45, 8)],
    "ring": [(0, 12, 5), (0, 25, -5), (0, 25, 15)],
    "thumb": [(30, -75, -35), (20, -45, -30), (20, -45, -30)],
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_mano_folder(tmp_path_factory.mktemp("mano"))


@pytest.fixture(scope="module")
def mano(folder: Path) -> HandModel:
    return HandModel(load_mano(folder, dtype=torch.float64), "mano")


def test_the_open_hands_axes_come_from_its_own_skeleton() -> None:
    """The function that both hands share rebuilds the asset; the length of the distal bones is arbitrary."""
    asset = load_open_hand()
    frames = asset.frames.double().numpy()
    joints = asset.joints.double().numpy()
    distal = [2, 5, 8, 11, 14]
    tips = joints[[joint + 1 for joint in distal]] - 0.02 * frames[distal, :, 0]
    rebuilt, rest_angles = axes_at_rest(joints, tips)
    np.testing.assert_allclose(rebuilt, frames, atol=2e-6)
    np.testing.assert_allclose(rest_angles, asset.rest_angles.numpy(), atol=2e-6)


def test_manos_spread_rest_pose_is_in_its_rest_angles(mano: HandModel) -> None:
    """Splay is measured from the third metacarpal, which deviates from −x by 4.8° in the test hand."""
    third = (mano.joints_template[4] - mano.joints_template[0]).numpy()
    metacarpal = np.degrees(np.arctan2(third[2], -third[0]))
    assert metacarpal == pytest.approx(-4.8, abs=0.1)
    rest = torch.rad2deg(mano.rest_angles)
    for finger, azimuth in AZIMUTHS.items():
        bend, splay, _ = rest[ARTICULATED.index(f"{finger} MCP")].tolist()
        assert splay == pytest.approx(azimuth - metacarpal, abs=0.1)
        assert bend == pytest.approx(0, abs=0.1)


def test_at_neutral_manos_fingers_are_straight_and_parallel(mano: HandModel) -> None:
    joints = mano(mano.neutral_angles(), torch.zeros(10, dtype=torch.float64)).joints
    third = torch.nn.functional.normalize(joints[4] - joints[0], dim=0)
    for base in (1, 4, 7, 10):
        bones = torch.nn.functional.normalize(
            joints[base + 1 : base + 3] - joints[base : base + 2], dim=1
        )
        assert_close(bones @ third, torch.ones(2, dtype=torch.float64))


@pytest.mark.parametrize("joint", [name for name in ARTICULATED if "thumb" not in name])
def test_a_positive_bend_brings_manos_fingertip_towards_the_palm(
    mano: HandModel, joint: str
) -> None:
    assert displacement(mano, joint, axis=0)[1] < -0.002


@pytest.mark.parametrize("finger", ["index", "middle", "ring", "little"])
def test_a_positive_splay_brings_manos_fingertip_towards_the_thumb(
    mano: HandModel, finger: str
) -> None:
    assert displacement(mano, f"{finger} MCP", axis=1)[2] > 0.005


def test_bending_manos_thumb_carries_it_across_the_palm_and_splay_lifts_it(mano: HandModel) -> None:
    assert displacement(mano, "thumb CMC", axis=0)[2] < -0.008
    assert displacement(mano, "thumb CMC", axis=1)[1] < -0.005


def displacement(hand: HandModel, joint: str, axis: int) -> torch.Tensor:
    """Displacement of the fingertip by a rotation of 0.2 rad, metres."""
    angles, zero = hand.neutral_angles(), torch.zeros(10, dtype=torch.float64)
    bent = angles.clone()
    bent[ARTICULATED.index(joint), axis] = 0.2
    tip = LANDMARKS.index(f"{joint.split()[0]} tip")
    return hand(bent, zero).landmarks[tip] - hand(angles, zero).landmarks[tip]


@pytest.mark.parametrize("finger", ["index", "middle", "little", "ring"])
def test_fingers_axes_agree_with_the_releases(mano: HandModel, finger: str) -> None:
    """The release's axes are tuned by hand: they agree within 20° along the bone and 27° about it."""
    for part, angles in enumerate(RELEASE[finger]):
        x, y, z = np.radians(angles)
        theirs = (rotation(1, y) @ rotation(0, x) @ rotation(2, z)).T
        ours = mano.frames[ARTICULATED.index(f"{finger} MCP") + part].numpy()
        between = np.degrees(np.arccos((theirs * ours).sum(axis=0).clip(-1, 1)))
        assert between[0] < 20
        assert between.max() < 27


def test_the_thumb_bends_about_the_releases_negative_second_axis(mano: HandModel) -> None:
    """In the release the thumb flexes about −y; here every joint bends about its third axis."""
    for part, angles in enumerate(RELEASE["thumb"]):
        x, y, z = np.radians(angles)
        theirs = (rotation(1, y) @ rotation(0, x) @ rotation(2, z)).T
        ours = mano.frames[ARTICULATED.index("thumb CMC") + part].numpy()
        assert np.degrees(np.arccos(-theirs[:, 1] @ ours[:, 2])) < 42


def test_the_left_hand_is_the_mirror_image_in_every_joint_angle(folder: Path) -> None:
    """Bend has the same sign on both hands; splay and twist have opposite signs."""
    right, left = (
        HandModel(load_mano(folder, side, dtype=torch.float64), "dexycb")
        for side in ("right", "left")
    )
    angles = 0.5 * torch.randn(15, 3, dtype=torch.float64)
    shape = torch.randn(10, dtype=torch.float64)
    signs = torch.tensor([1.0, -1.0, -1.0], dtype=torch.float64)
    mirror = torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64)
    mirrored = left(signs * angles, shape)
    assert_close(mirrored.vertices, right(angles, shape).vertices * mirror)
    assert_close(mirrored.joints, right(angles, shape).joints * mirror)
    assert torch.linalg.det(left.frames).min() > 0.999


@pytest.mark.parametrize("landmark_set", [*TIP_VERTICES, "mano"])
@pytest.mark.parametrize("shape", BATCH_SHAPES)
def test_landmarks_are_at_each_datasets_positions(
    folder: Path, landmark_set: str, shape: tuple[int, ...]
) -> None:
    """Joints are regressed from the surface for FreiHAND, rotation centres otherwise; tips are vertices."""
    hand = HandModel(load_mano(folder, dtype=torch.float64), landmark_set)
    angles = 0.6 * torch.randn(*shape, 15, 3, dtype=torch.float64)
    posed = hand(angles, torch.randn(*shape, 10, dtype=torch.float64))
    regressor = torch.from_numpy(mano_arrays()["J_regressor"])
    of_surface = regressor @ posed.vertices
    for landmark, joint in JOINT_OF_LANDMARK.items():
        source = of_surface if landmark_set in ("mano", "freihand") else posed.joints
        assert_close(posed.landmarks[..., landmark, :], source[..., joint, :])
    vertices = list(tip_vertices(landmark_set, "right"))
    assert_close(posed.landmarks[..., list(TIPS), :], posed.vertices[..., vertices, :])
    assert (of_surface - posed.joints).abs().max() > 1e-4, "the two kinds of joint must differ"


def test_the_datasets_tips_are_those_of_their_toolkits() -> None:
    assert tip_vertices("mano", "right") == (744, 320, 443, 555, 672)
    assert tip_vertices("freihand", "right") == (744, 320, 443, 555, 672)
    assert tip_vertices("ho3d", "right") == (744, 333, 444, 555, 672)
    assert tip_vertices("dexycb", "right") == (745, 317, 444, 556, 673)
    assert tip_vertices("dexycb", "left") == (745, 317, 445, 556, 673)
    assert tip_vertices("smplx", "right") == (744, 320, 443, 554, 671)


def test_a_landmark_set_that_mano_lacks_is_refused_with_those_it_has(folder: Path) -> None:
    with pytest.raises(ValueError, match=r"'mano' has no landmark set 'knuckle'.*dexycb.*freihand"):
        mano_hand(folder, "knuckle")


def test_the_open_hand_serves_every_dataset_that_mano_labels() -> None:
    expected = open_hand("mano").landmark_regressor
    for name in ("freihand", "dexycb", "ho3d"):
        assert torch.equal(open_hand(name).landmark_regressor, expected)


def test_without_mano_the_message_says_where_it_looked_and_what_to_do(tmp_path: Path) -> None:
    says = (
        r"No MANO hand at .*nowhere/MANO_RIGHT\.safetensors.*python -m hand_recon\.prepare mano"
        r".*hand=open needs no licence"
    )
    with pytest.raises(FileNotFoundError, match=says):
        mano_hand(tmp_path / "nowhere")


def test_a_pickle_in_place_of_the_prepared_file_is_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "MANO_RIGHT.pkl"
    path.write_bytes(b"cos\nsystem\n(S'false'\ntR.")
    with pytest.raises(ValueError, match=r"expected 'hand_recon MANO 1'.*hand_recon\.prepare mano"):
        mano_hand(path)


def test_the_other_hands_file_is_refused(folder: Path) -> None:
    with pytest.raises(ValueError, match="is MANO's left hand; expected the right one"):
        mano_hand(folder / "MANO_LEFT.safetensors")


def test_the_configuration_builds_the_hand(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HAND_RECON_MANO", str(folder))
    whole = OmegaConf.create({"data": {"landmark_set": "ho3d"}})
    whole["hand"] = OmegaConf.load(ROOT / "conf" / "hand" / "mano.yaml")
    hand = instantiate(whole.hand)
    assert isinstance(hand, HandModel)
    assert (hand.name, hand.landmark_set) == ("mano", "ho3d")
    assert hand.template.dtype == torch.float32
