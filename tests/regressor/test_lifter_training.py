"""Training of the packaged lifter: its poses, views and noise, and that it uses no 3D of a view."""

import math
from dataclasses import replace

import pytest
import torch

from build_lifter import build
from hand_recon.camera import project
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import ARTICULATED, AXES
from hand_recon.hand.upright import FILL
from hand_recon.knowledge.natural_pose import natural_poses
from hand_recon.knowledge.prior import Prior
from hand_recon.knowledge.ranges import RangeOfMotion, load_ranges
from hand_recon.regressor.lifter_file import LifterSettings
from lifter_training import training as of_training
from lifter_training.poses import Poses, sample_hands, sample_in_ranges, sample_natural
from lifter_training.training import Trainer, Training
from lifter_training.views import (
    Noise,
    Views,
    random_rotations,
    sample_views,
)

NO_NOISE = Noise(sigma=(1e-6, 1e-6), missing=0.0)
SMALL = Training(
    steps=8, views=6, own=3, own_from=0.25, poses=Poses(hands=24),
    network=LifterSettings(width=16, depth=1, confidence=False),
)  # fmt: skip


@pytest.fixture
def ranges(hand: HandModel) -> RangeOfMotion:
    return load_ranges("literature", hand.rest_angles)


@pytest.fixture
def generator() -> torch.Generator:
    return torch.Generator().manual_seed(1)


@pytest.fixture
def hands(hand: HandModel, ranges: RangeOfMotion) -> torch.Tensor:
    return sample_hands(Poses(hands=40), hand.landmarks_only(), ranges, seed=3)


def test_poses_from_the_ranges_are_inside_them_and_fill_them(
    ranges: RangeOfMotion, generator: torch.Generator
) -> None:
    angles = sample_in_ranges(ranges, 2000, generator)
    assert bool(ranges.contains(angles).all())
    assert not angles[..., AXES.index("twist")].any()
    bend = angles[..., AXES.index("bend")]
    for joint in ("index PIP", "little PIP", "thumb IP", "thumb CMC"):
        place = ARTICULATED.index(joint)
        low, high = ranges.lower[place, 0].clamp(min=-0.35), ranges.upper[place, 0]
        low = low if joint.startswith("thumb") else torch.zeros(())
        assert float(bend[:, place].mean()) == pytest.approx(float(low + high) / 2, abs=0.05)
        assert float(bend[:, place].amax()) > 0.95 * float(high)


def test_neighbouring_fingers_go_together_in_half_of_the_poses(
    ranges: RangeOfMotion, generator: torch.Generator
) -> None:
    """Correlation 0.8² in one half and 0 in the other: 0.32 of the normal scores, a little less of bends."""
    bend = sample_in_ranges(ranges, 20_000, generator)[..., AXES.index("bend")]
    pips = [ARTICULATED.index(f"{finger} PIP") for finger in ("index", "ring")]
    found = torch.corrcoef(bend[:, pips].mT)[0, 1]
    assert float(found) == pytest.approx(0.31, abs=0.03)


def test_hands_that_penetrate_themselves_are_left_out(
    hand: HandModel, ranges: RangeOfMotion
) -> None:
    light = hand.landmarks_only()
    kept = sample_hands(Poses(hands=60), light, ranges, seed=0)
    assert 20 < len(kept) < 60
    again = sample_hands(Poses(hands=60), light, ranges, seed=0)
    assert torch.equal(kept, again)
    assert not torch.equal(kept[:20], sample_hands(Poses(hands=60), light, ranges, seed=1)[:20])
    for only in (Poses(30, 1.0, 0.0), Poses(30, 0.0, 1.0), Poses(30, 0.0, 0.0)):
        assert 10 < len(sample_hands(only, light, ranges, seed=0)) <= 30


def test_natural_poses_have_the_mean_and_the_covariance_of_the_table(
    generator: torch.Generator,
) -> None:
    drawn = sample_natural(20_000, generator).flatten(1)
    mean, covariance = (table.float() for table in natural_poses())
    deviation = covariance.diagonal().sqrt()
    assert float(((drawn.mean(dim=0) - mean) / deviation).abs().max()) < 5 / 20_000**0.5
    found = torch.cov(drawn.mT) / (deviation[:, None] * deviation)
    expected = covariance / (deviation[:, None] * deviation)
    assert float((found - expected).abs().max()) < 0.05


def test_rotations_are_rotations_in_all_directions(generator: torch.Generator) -> None:
    rotation = random_rotations(4000, generator)
    identity = torch.eye(3).expand(4000, 3, 3)
    torch.testing.assert_close(rotation @ rotation.mT, identity, atol=1e-5, rtol=0)
    assert bool((torch.linalg.det(rotation) > 0).all())
    # The mean of uniform rotations is zero; each entry has a standard deviation of 1/√3.
    assert float(rotation.mean(dim=0).abs().max()) < 5 / math.sqrt(3 * 4000)


def test_a_view_is_the_projection_of_its_points(
    hands: torch.Tensor, generator: torch.Generator
) -> None:
    view = sample_views(hands, NO_NOISE, generator)
    assert view.seen.intrinsics is not None
    projected = project(view.points, view.seen.intrinsics)
    torch.testing.assert_close(projected, view.exact, atol=1e-2, rtol=0)
    torch.testing.assert_close(view.seen.landmarks_2d, view.exact, atol=1e-2, rtol=0)
    # The hand itself is unchanged, and as large in the crop as every upright hand.
    torch.testing.assert_close(
        torch.cdist(view.points, view.points), torch.cdist(hands, hands), atol=1e-4, rtol=0
    )
    extent = (view.exact.amax(dim=1) - view.exact.amin(dim=1)).amax(dim=-1)
    torch.testing.assert_close(extent, torch.full_like(extent, FILL * 224), atol=0.1, rtol=0)


def test_the_noise_has_the_size_that_was_asked_for(
    hands: torch.Tensor, generator: torch.Generator
) -> None:
    """σ of 2 px: tips of landmarks in front 0.8 × 1.3 of it, wrists 0.8 × 0.6, more far from the camera."""
    many = hands.repeat(200, 1, 1)
    view = sample_views(many, Noise(sigma=(2.0, 2.0), missing=0.0), generator)
    off = view.seen.landmarks_2d - view.exact
    deep = view.points[..., 2] - view.points[..., 2].mean(dim=1, keepdim=True)
    for place, factor in ((0, 0.6), (8, 1.3), (5, 0.7)):
        front = off[:, place][deep[:, place] < 0]
        # The crop is scaled about noisy landmarks, so that σ is not exactly that of a hand of 0.7 crops.
        assert float(front.std()) == pytest.approx(2 * 0.8 * factor, rel=0.15)
        assert float(off[:, place][deep[:, place] > 0.04].std()) > 1.3 * float(front.std())
    # Landmarks of a finger share 0.65² of the variance, those of two fingers nothing.
    unit = off / off.std(dim=0)
    same, other = (unit[:, 6] * unit[:, 7]).mean(), (unit[:, 6] * unit[:, 14]).mean()
    assert float(same) == pytest.approx(0.65**2, abs=0.08)
    assert abs(float(other)) < 0.08


def test_landmarks_are_missing_as_often_as_was_asked_for(
    hands: torch.Tensor, generator: torch.Generator
) -> None:
    view = sample_views(hands.repeat(100, 1, 1), Noise(missing=0.2), generator)
    share = 1 - view.seen.labelled.float()
    assert float(share.mean()) == pytest.approx(0.2, abs=0.02)
    # From 0 to 0.4 of a hand: the share differs from hand to hand.
    assert float(share.mean(dim=1).std()) > 0.1


def trained(hand: HandModel, hands: torch.Tensor, training: Training) -> Trainer:
    trainer = Trainer(hands, hand, Prior.default(hand), training)
    trainer.run(lambda _: None)
    return trainer


def test_training_is_the_same_twice_and_ends_in_the_likelihood(
    hand: HandModel, hands: torch.Tensor
) -> None:
    first, second = (trained(hand, hands, SMALL) for _ in range(2))
    assert first.data_term.stage == 1
    assert first.own is not None
    for name, value in first.lifter.state_dict().items():
        assert torch.equal(value, second.lifter.state_dict()[name]), name
    other = trained(hand, hands, replace(SMALL, seed=1)).lifter.state_dict()
    assert not torch.equal(other["initial_state"], first.lifter.state_dict()["initial_state"])


def test_no_3d_of_a_made_up_view_is_a_label(
    hand: HandModel, hands: torch.Tensor, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Training without the 3D points of these views is the same training."""
    whole = trained(hand, hands, SMALL).lifter.state_dict()
    made_up = set(map(float, hands[:, 4, 0]))

    def blind(given: torch.Tensor, noise: Noise, generator: torch.Generator) -> Views:
        view = sample_views(given, noise, generator)
        if set(map(float, given[:, 4, 0])) <= made_up:
            return replace(view, points=torch.full_like(view.points, torch.nan))
        return view

    monkeypatch.setattr(of_training, "sample_views", blind)
    for name, value in trained(hand, hands, SMALL).lifter.state_dict().items():
        assert torch.equal(value, whole[name]), name


def test_training_finds_hands(hand: HandModel, hands: torch.Tensor) -> None:
    """Two hundred steps of a small network halve the distance of projections from their labels."""
    network = LifterSettings(width=64, depth=1, iterations=2, confidence=False)
    training = replace(SMALL, steps=200, views=32, own=8, network=network)
    trainer = Trainer(hands, hand, Prior.default(hand), training)
    view = sample_views(hands, NO_NOISE, torch.Generator().manual_seed(9))

    def off() -> float:
        trainer.lifter.eval()
        with torch.no_grad():
            found = trainer.lifter(view.seen).landmarks_2d
        return float((found - view.exact).norm(dim=-1).mean())

    before = off()
    trainer.run(lambda _: None)
    assert off() < 0.5 * before


def test_the_command_builds_a_lifter_of_the_open_hand(hand: HandModel) -> None:
    lines: list[str] = []
    lifter = build(SMALL, lines.append)
    assert lifter.hand.landmark_set == "mediapipe"
    assert torch.equal(lifter.hand.template, hand.template)
    assert not lifter.training
    assert lines[0].endswith("of 24")
    assert len(lines) == 1 + SMALL.steps
