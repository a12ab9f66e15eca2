import math
from dataclasses import replace
from typing import Any

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from hand_recon.camera import move_pixels, project
from hand_recon.data.augment import Augmentation, move, to_float
from hand_recon.schema import CropMotion, HandBatch

SIZE = 48
NONE = Augmentation(rotation=0, scale=0, shift=0, side_jitter=0, colour=0, brightness=0, flip=0)


def make_batch(count: int = 4, seed: int = 0) -> HandBatch:
    """Hands half a metre in front of an off-centre camera, with exact labels."""
    generator = torch.Generator().manual_seed(seed)
    landmarks = 0.05 * torch.randn(count, 21, 3, generator=generator) + torch.tensor([0, 0, 0.5])
    vertices = 0.05 * torch.randn(count, 30, 3, generator=generator) + torch.tensor([0, 0, 0.5])
    intrinsics = torch.tensor([[100.0, 0, 20], [0, 110, 30], [0, 0, 1]]).repeat(count, 1, 1)
    return HandBatch(
        image=torch.randint(0, 256, (count, 3, SIZE, SIZE), dtype=torch.uint8, generator=generator),
        landmarks_2d=project(landmarks, intrinsics),
        labelled=torch.ones(count, 21, dtype=torch.bool),
        index=torch.arange(count),
        source=("test",) * count,
        intrinsics=intrinsics,
        landmarks_3d=landmarks,
        vertices=vertices,
        label_noise=torch.ones(count, 21),
    )


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def present(value: Tensor | None) -> Tensor:
    assert value is not None
    return value


@settings(max_examples=40)
@given(
    st.builds(
        Augmentation,
        rotation=st.floats(0, math.pi),
        scale=st.floats(0, 0.5),
        shift=st.floats(0, 0.5),
        side_jitter=st.floats(0, 0.5),
        flip=st.floats(0, 1),
    ),
    st.integers(0, 1000),
)
def test_projection_stays_exact(augmentation: Augmentation, seed: int) -> None:
    moved = augmentation(make_batch(), seeded(seed))
    projected = project(present(moved.landmarks_3d), present(moved.intrinsics))
    torch.testing.assert_close(projected, moved.landmarks_2d, atol=2e-3, rtol=1e-5)


def test_surfaces_turn_with_landmarks() -> None:
    batch = make_batch()
    batch = replace(batch, vertices=present(batch.landmarks_3d).clone())
    moved = Augmentation(rotation=3.0, flip=0.5)(batch, seeded())
    torch.testing.assert_close(moved.vertices, moved.landmarks_3d)


def test_turning_keeps_distances_and_depth() -> None:
    batch = make_batch()
    moved = Augmentation(rotation=3.0)(batch, seeded())
    before, after = present(batch.landmarks_3d), present(moved.landmarks_3d)
    torch.testing.assert_close(
        torch.cdist(after, after), torch.cdist(before, before), atol=1e-5, rtol=1e-4
    )
    torch.testing.assert_close(after[..., 2], before[..., 2])


@pytest.mark.parametrize("flip", [0.0, 1.0])
def test_a_blob_ends_where_its_label_ends(flip: float) -> None:
    batch = make_batch(8)
    image = torch.zeros(8, 3, SIZE, SIZE, dtype=torch.uint8)
    image[:, :, 20:24, 26:30] = 255
    labels = torch.full((8, 21, 2), math.nan)
    labels[:, 0] = torch.tensor([28.0, 22.0])
    moved = Augmentation(rotation=0.6, scale=0.2, shift=0.1, side_jitter=0.1, flip=flip)(
        replace(batch, image=image, landmarks_2d=labels), seeded()
    )
    weight = moved.image.sum(dim=1)
    axis = torch.arange(SIZE) + 0.5
    centroid = torch.stack(
        [(weight.sum(dim=1) * axis).sum(dim=-1), (weight.sum(dim=2) * axis).sum(dim=-1)], dim=-1
    ) / weight.sum(dim=(1, 2)).unsqueeze(-1)
    torch.testing.assert_close(centroid, moved.landmarks_2d[:, 0], atol=0.1, rtol=0)


def test_no_change_changes_nothing() -> None:
    batch = make_batch()
    moved = NONE(batch, seeded())
    torch.testing.assert_close(moved.image, batch.image / 255, atol=1e-4, rtol=0)
    torch.testing.assert_close(moved.landmarks_2d, batch.landmarks_2d)
    torch.testing.assert_close(moved.intrinsics, batch.intrinsics)
    torch.testing.assert_close(moved.landmarks_3d, batch.landmarks_3d)


def test_half_a_turn_turns_the_image_round() -> None:
    image = make_batch().image.float()
    half_turn = torch.tensor([[-1.0, 0, SIZE], [0, -1, SIZE], [0, 0, 1]]).repeat(4, 1, 1)
    torch.testing.assert_close(move_pixels(image, half_turn), image.flip(-1, -2), atol=0.1, rtol=0)


def test_a_zoom_by_two_doubles_lengths_and_label_noise() -> None:
    batch = to_float(make_batch(1))
    pixels = torch.tensor([[[2.0, 0, -SIZE / 2], [0, 2, -SIZE / 2], [0, 0, 1]]])
    motion = CropMotion(pixels=pixels, camera=torch.eye(3)[None], scale=torch.tensor([2.0]))
    moved = move(batch, motion)
    before = batch.landmarks_2d[0, 5] - batch.landmarks_2d[0, 0]
    torch.testing.assert_close(moved.landmarks_2d[0, 5] - moved.landmarks_2d[0, 0], 2 * before)
    assert present(moved.label_noise).unique().tolist() == [2.0]


def test_moving_each_side_of_the_box_keeps_it_inside_the_new_crop() -> None:
    motion = Augmentation(rotation=0, scale=0, shift=0, side_jitter=0.3).draw_motion(
        200, 100, seeded()
    )
    # The jittered box reaches 0.7 to 1.3 half crops from the centre.
    assert 1 / 1.3 <= motion.scale.min() < motion.scale.max() <= 1 / 0.7
    corner = torch.tensor([50 - 0.7 * 50, 50 - 0.7 * 50, 1.0])
    assert ((motion.pixels @ corner)[:, :2] > -1e-3).all()


def test_a_landmark_pushed_outside_stays_labelled_and_a_missing_one_stays_missing() -> None:
    batch = make_batch()
    labels = batch.landmarks_2d.clone()
    labels[:, 3] = math.nan
    labelled = batch.labelled.clone()
    labelled[:, 3] = False
    moved = Augmentation(shift=0.9)(
        replace(batch, landmarks_2d=labels, labelled=labelled), seeded()
    )
    outside = ((moved.landmarks_2d < 0) | (moved.landmarks_2d > SIZE)).any(dim=-1)
    assert outside.any()
    assert torch.equal(moved.labelled, labelled)
    assert moved.landmarks_2d[:, 3].isnan().all()
    assert not moved.landmarks_2d[:, 4].isnan().any()


def test_what_is_not_there_stays_absent() -> None:
    bare = replace(
        make_batch(), intrinsics=None, landmarks_3d=None, vertices=None, label_noise=None
    )
    moved = Augmentation()(bare, seeded())
    assert moved.intrinsics is moved.landmarks_3d is moved.vertices is moved.label_noise is None


def test_the_same_seed_gives_the_same_batch_and_another_another() -> None:
    first, same, other = (Augmentation()(make_batch(), seeded(seed)) for seed in (1, 1, 2))
    assert torch.equal(first.image, same.image)
    assert not torch.equal(first.image, other.image)


def test_the_original_batch_is_left_alone() -> None:
    batch = to_float(make_batch())
    before = batch.image.clone()
    NONE(batch, seeded())
    Augmentation()(batch, seeded())
    assert torch.equal(batch.image, before)


def test_colours_change_by_channel_and_stay_between_black_and_white() -> None:
    batch = replace(make_batch(64), image=torch.full((64, 3, 8, 8), 200, dtype=torch.uint8))
    moved = replace(NONE, colour=0.2)(batch, seeded())
    gain = moved.image[..., 4, 4] / (200 / 255)
    assert 0.79 < gain.min() < 0.85
    assert 1.15 < gain.max() < 1.21
    assert replace(NONE, brightness=1.0)(batch, seeded()).image.max() <= 1


def test_a_flip_is_off_by_default_and_mirrors_the_hand_when_on() -> None:
    batch = make_batch()
    assert Augmentation().flip == 0
    moved = replace(NONE, flip=1.0)(batch, seeded())
    torch.testing.assert_close(moved.image, batch.image.flip(-1) / 255, atol=1e-4, rtol=0)
    torch.testing.assert_close(moved.landmarks_2d[..., 0], SIZE - batch.landmarks_2d[..., 0])
    torch.testing.assert_close(
        present(moved.landmarks_3d)[..., 0], -present(batch.landmarks_3d)[..., 0]
    )


@pytest.mark.parametrize("wrong", [{"rotation": -0.1}, {"scale": 1.5}, {"flip": 2.0}])
def test_a_range_that_makes_no_sense_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=f"Augmentation {next(iter(wrong))}="):
        Augmentation(**wrong)
