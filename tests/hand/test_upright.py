"""Upright crops: one size, centred, exact in 3D, with any landmarks missing."""

import math
from dataclasses import replace

import pytest
import torch

from hand_recon.camera import project
from hand_recon.data.augment import move
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import LANDMARKS
from hand_recon.hand.upright import upright_motion
from hand_recon.schema import HandBatch
from tests.support.tolerance import assert_close
from tests.support.views import known_hands, views

WRIST = LANDMARKS.index("wrist")
KNUCKLES = [i for i, name in enumerate(LANDMARKS) if name.endswith("MCP") and "thumb" not in name]
BEYOND = [i for i in range(5, 21) if i not in KNUCKLES]


@pytest.fixture
def seen(hand: HandModel) -> HandBatch:
    """Hands in any view, with long and short focal lengths and off-centre principal points."""
    batch = views(hand, known_hands(hand, 12))
    cameras = torch.eye(3).repeat(12, 1, 1)
    cameras[:, 0, 0] = cameras[:, 1, 1] = torch.linspace(300, 900, 12)
    cameras[:, :2, 2] = 112 + 40 * torch.randn(12, 2)
    assert batch.landmarks_3d is not None
    return replace(batch, intrinsics=cameras, landmarks_2d=project(batch.landmarks_3d, cameras))


def without(batch: HandBatch, missing: list[int]) -> HandBatch:
    labelled = batch.labelled.clone()
    labelled[:, missing] = False
    return replace(
        batch,
        labelled=labelled,
        landmarks_2d=batch.landmarks_2d.masked_fill(~labelled[..., None], torch.nan),
    )


def upright(batch: HandBatch, crop_size: int = 224) -> HandBatch:
    return move(batch, upright_motion(batch.landmarks_2d, batch.labelled, crop_size))


def box(batch: HandBatch) -> tuple[torch.Tensor, torch.Tensor]:
    """Middle and longer side of the labelled landmarks' box."""
    missing = ~batch.labelled[..., None]
    high = batch.landmarks_2d.masked_fill(missing, -torch.inf).amax(dim=1)
    low = batch.landmarks_2d.masked_fill(missing, torch.inf).amin(dim=1)
    return (high + low) / 2, (high - low).amax(dim=1)


@pytest.mark.parametrize("missing", [[], [WRIST], KNUCKLES, [4, 8, 12, 16, 20]])
def test_the_landmarks_fill_seven_tenths_in_the_middle(seen: HandBatch, missing: list[int]) -> None:
    middle, side = box(upright(without(seen, missing)))
    torch.testing.assert_close(middle, torch.full((12, 2), 112.0), atol=1e-3, rtol=0)
    torch.testing.assert_close(side, torch.full((12,), 0.7 * 224), atol=1e-3, rtol=0)


@pytest.mark.parametrize(
    ("missing", "start", "end"),
    [([], [WRIST], KNUCKLES), ([WRIST], KNUCKLES, BEYOND), (KNUCKLES[1:], [WRIST], KNUCKLES[:1])],
)
def test_the_fingers_point_up(
    seen: HandBatch, missing: list[int], start: list[int], end: list[int]
) -> None:
    """From the wrist to the labelled MCPs; without a wrist, from these to the landmarks beyond."""
    landmarks = upright(without(seen, missing)).landmarks_2d
    ahead = landmarks[:, end].mean(dim=1) - landmarks[:, start].mean(dim=1)
    torch.testing.assert_close(ahead[:, 0], torch.zeros(12), atol=1e-3, rtol=0)
    assert (ahead[:, 1] < -1).all()  # v grows downwards.


def test_what_cannot_be_told_stays_as_it_was(seen: HandBatch) -> None:
    """Without wrist and MCPs there is no rotation; without any landmark, no motion."""
    nameless = without(seen, [WRIST, *KNUCKLES])
    motion = upright_motion(nameless.landmarks_2d, nameless.labelled, 224)
    assert torch.equal(motion.camera, torch.eye(3).expand(12, 3, 3))
    nothing = without(seen, list(range(21)))
    motion = upright_motion(nothing.landmarks_2d, nothing.labelled, 224)
    assert_close(motion.pixels, torch.eye(3).expand(12, 3, 3))
    assert_close(motion.scale, torch.ones(12))


def test_one_landmark_alone_goes_to_the_middle_at_a_finite_scale(seen: HandBatch) -> None:
    alone = without(seen, [i for i in range(21) if i != 7])
    moved = upright(alone)
    assert_close(moved.landmarks_2d[:, 7], torch.full((12, 2), 112.0))
    motion = upright_motion(alone.landmarks_2d, alone.labelled, 224)
    assert_close(motion.scale, torch.full((12,), 0.7 * 224))  # As if it were a pixel large.


def test_the_moved_camera_sees_the_moved_hand_where_its_landmarks_are(seen: HandBatch) -> None:
    moved = upright(seen)
    assert moved.landmarks_3d is not None
    assert moved.intrinsics is not None
    projected = project(moved.landmarks_3d, moved.intrinsics)
    torch.testing.assert_close(projected, moved.landmarks_2d, atol=5e-3, rtol=0)
    # A rotation without a flip: bones keep their lengths, and depths their values.
    motion = upright_motion(seen.landmarks_2d, seen.labelled, 224)
    assert_close(torch.linalg.det(motion.camera), torch.ones(12))
    assert seen.landmarks_3d is not None
    assert_close(moved.landmarks_3d[..., 2], seen.landmarks_3d[..., 2])


def test_what_is_upright_stays(seen: HandBatch) -> None:
    moved = upright(seen)
    motion = upright_motion(moved.landmarks_2d, moved.labelled, 224)
    identity = torch.eye(3).expand(12, 3, 3)
    torch.testing.assert_close(motion.pixels, identity, atol=2e-3, rtol=0)
    torch.testing.assert_close(motion.camera, identity, atol=1e-5, rtol=0)


@pytest.mark.parametrize("degrees", [30, 90, 180, 271])
def test_a_turned_shifted_and_scaled_image_gives_the_same_crop(
    seen: HandBatch, degrees: float
) -> None:
    angle = math.radians(degrees)
    turn = torch.tensor([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    other = replace(seen, landmarks_2d=1.7 * seen.landmarks_2d @ turn.mT + 31.0)
    torch.testing.assert_close(
        upright(other).landmarks_2d, upright(seen).landmarks_2d, atol=5e-3, rtol=0
    )


def test_where_nothing_is_labelled_nothing_is_looked_at(seen: HandBatch) -> None:
    labelled = seen.labelled.clone()
    labelled[:, 3] = False
    nonsense = seen.landmarks_2d.clone()
    for value in (torch.nan, torch.inf, 1e6):
        nonsense[:, 3] = value
        motion = upright_motion(nonsense, labelled, 224)
        expected = upright_motion(seen.landmarks_2d, labelled, 224)
        assert torch.equal(motion.pixels, expected.pixels)
