"""Natural and unnatural poses of synthetic hands."""

import numpy as np
import pytest
import torch

from hand_recon.data.synthetic.gestures import BEND, SPLAY, TWIST, gesture_library, sample_pose
from hand_recon.data.synthetic.plausible import deepest_overlap
from hand_recon.data.synthetic.unnatural import KINDS, sample_unnatural_pose
from hand_recon.hand.open_hand import open_hand
from hand_recon.hand.skeleton import ARTICULATED

HINGES = [i for i, name in enumerate(ARTICULATED) if name.endswith(("PIP", "DIP"))]


def test_the_library_has_at_least_sixty_gestures_with_unique_names() -> None:
    names = [gesture.name for gesture in gesture_library()]
    assert len(names) >= 60
    assert len(set(names)) == len(names)


def test_a_quarter_of_the_gestures_or_so_is_held_out() -> None:
    held_out = [gesture.held_out for gesture in gesture_library()]
    assert 0.15 < np.mean(held_out) < 0.4


def test_a_fist_bends_every_finger_and_an_open_hand_none() -> None:
    by_name = {gesture.name: np.degrees(gesture.joint_angles) for gesture in gesture_library()}
    proximal = [ARTICULATED.index(f"{f} PIP") for f in ("index", "middle", "ring", "little")]
    assert by_name["fist"][proximal, BEND].min() > 90
    assert np.abs(by_name["five"][proximal, BEND]).max() < 5
    index, little = ARTICULATED.index("index MCP"), ARTICULATED.index("little MCP")
    assert by_name["five"][index, SPLAY] > 0 > by_name["five"][little, SPLAY]


@pytest.mark.parametrize("held_out", [False, True])
def test_without_noise_a_pose_stays_between_the_gestures_of_its_split(held_out: bool) -> None:
    pool = np.stack([g.joint_angles for g in gesture_library() if g.held_out == held_out])
    for seed in range(50):
        pose = sample_pose(np.random.default_rng(seed), held_out=held_out, noise=0.0)
        assert (pose <= pool.max(axis=0) + 1e-9).all()
        assert (pose >= pool.min(axis=0) - 1e-9).all()


def test_no_hinge_of_a_natural_pose_bends_backwards_or_sideways() -> None:
    poses = np.stack([sample_pose(np.random.default_rng(seed)) for seed in range(300)])
    assert np.degrees(poses[:, HINGES, BEND]).min() >= -5 - 1e-9
    assert np.degrees(poses[:, HINGES, BEND]).max() < 125
    assert np.abs(poses[:, HINGES][..., [SPLAY, TWIST]]).max() == 0


def test_noise_on_a_last_joint_follows_its_middle_joint() -> None:
    still = np.stack([sample_pose(np.random.default_rng(s), noise=0.0) for s in range(200)])
    noisy = np.stack([sample_pose(np.random.default_rng(s), noise=4.0) for s in range(200)])
    change = (noisy - still)[
        :, [ARTICULATED.index("index PIP"), ARTICULATED.index("index DIP")], BEND
    ]
    assert np.corrcoef(change.T)[0, 1] > 0.6


def test_parallel_capsules_of_known_radius_overlap_by_hand() -> None:
    # Straight parallel fingers with joints every 3 cm; index and middle are 10 mm apart, the rest far.
    # Worst is a proximal bone (8.5 mm) beside its neighbour's middle bone (7.5 mm): 16 mm in 10 mm.
    across = [0.0, 1.0, 1.01, 2.0, 3.0]
    fingers = [[-0.03 * (k + 1), y, 0.0] for y in across for k in range(4)]
    landmarks = np.array([[1.0, 0.0, 0.0], *fingers])
    assert deepest_overlap(landmarks) == pytest.approx(0.006, abs=1e-9)


def test_natural_samples_rarely_penetrate_themselves() -> None:
    model = open_hand()
    poses = np.stack([sample_pose(np.random.default_rng(seed)) for seed in range(200)])
    with torch.no_grad():
        hands = model(torch.from_numpy(poses).float(), torch.zeros(200, 10))
    overlaps = np.array([deepest_overlap(points) for points in hands.landmarks.numpy()])
    assert np.mean(overlaps > 0.008) < 0.3
    assert np.median(overlaps) < 0.005


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_an_unnatural_pose_has_the_error_of_its_kind(kind: str) -> None:
    pose = sample_unnatural_pose(np.random.default_rng(3), kind)
    degrees = np.degrees(pose.joint_angles)
    own = degrees[[i for i, name in enumerate(ARTICULATED) if name.startswith(pose.finger)]]
    worst = {
        "hyper_bent": -own[:, BEND].min() >= 40,
        "over_bent": own[:, BEND].max() >= 115,
        "twisted": np.abs(own[:, TWIST]).max() >= 40,
        "sideways": np.abs(own[1:, SPLAY]).max() >= 35,
        "penetrating": own[:, BEND].max() >= 108 or np.abs(own[0, SPLAY]) >= 40,
    }
    assert pose.kind == kind
    assert worst[kind]


def test_an_unknown_kind_is_named() -> None:
    with pytest.raises(ValueError, match="melted"):
        sample_unnatural_pose(np.random.default_rng(0), "melted")
