"""Appearance of training crops: what changes, what does not, and how often."""

import pytest
import torch

from hand_recon.data.appearance import Appearance
from hand_recon.data.augment import Augmentation
from hand_recon.hand.model import HandModel
from tests.support.views import known_hands, views

OFF = {"outside": 0.0, "contrast": 0.0, "grey": 0.0, "blur": 0.0, "noise": 0.0, "patches": 0.0}


def generator() -> torch.Generator:
    return torch.Generator().manual_seed(3)


def test_nothing_asked_for_changes_nothing() -> None:
    image = torch.rand(4, 3, 16, 16)
    appearance = Appearance(**OFF)
    assert torch.equal(appearance(appearance.fill_outside(image)), image)


def test_the_same_generator_gives_the_same_image_and_another_does_not() -> None:
    image = torch.rand(8, 3, 16, 16)
    first, second = (Appearance()(image, generator()) for _ in range(2))
    assert torch.equal(first, second)
    assert not torch.equal(first, Appearance()(image, torch.Generator().manual_seed(4)))
    assert 0 <= float(first.min()) <= float(first.max()) <= 1


def test_only_black_outside_of_images_is_filled() -> None:
    image = torch.rand(64, 3, 8, 8) * 0.5 + 0.25
    image[:, :, :, :3] = 0.0
    filled = Appearance(**OFF | {"outside": 1.0}).fill_outside(image, generator())
    assert torch.equal(filled[..., 3:], image[..., 3:])
    other, mean = image.roll(1, 0), image.roll(1, 0).mean(dim=(2, 3), keepdim=True)
    shows = (filled[..., :3] == other[..., :3]).flatten(1).all(dim=1)
    plain = (filled[..., :3] == mean).flatten(1).all(dim=1)
    assert bool((shows | plain).all())
    assert 16 < int(shows.sum()) < 48


@pytest.mark.parametrize(("name", "share"), [("grey", 0.3), ("blur", 0.4), ("patches", 0.6)])
def test_changes_are_as_frequent_as_asked(name: str, share: float) -> None:
    image = torch.rand(2000, 3, 8, 8)
    changed = Appearance(**OFF | {name: share})(image, generator())
    found = float((changed != image).flatten(1).any(dim=1).float().mean())
    assert found == pytest.approx(share, abs=0.04)


def test_a_patch_is_a_rectangle_of_the_asked_size() -> None:
    image = torch.rand(200, 3, 50, 50)
    appearance = Appearance(**OFF | {"patches": 1.0}, patch_side=0.3)
    changed = (appearance(image, generator()) != image).any(dim=1)
    rows, columns = changed.any(dim=2), changed.any(dim=1)
    # Full: each changed row has every changed column.
    assert torch.equal(changed, rows[:, :, None] & columns[:, None, :])
    for sides in (rows.sum(dim=1), columns.sum(dim=1)):
        assert int(sides.min()) >= 3
        assert int(sides.max()) <= 16


def test_values_outside_their_limits_are_refused() -> None:
    with pytest.raises(ValueError, match=r"grey=1\.5"):
        Appearance(grey=1.5)


def test_landmarks_without_images_pass_through(hand: HandModel) -> None:
    batch = views(hand, known_hands(hand, 3))
    moved = Augmentation(appearance=Appearance())(batch, generator())
    plain = Augmentation()(batch, generator())
    assert torch.equal(moved.landmarks_2d, plain.landmarks_2d)
