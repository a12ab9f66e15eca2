"""The encoder of photographs: crop, landmarks or both, and its start from the packaged lifter."""

from dataclasses import replace

import pytest
import torch

from hand_recon.camera import move_points
from hand_recon.data.augment import move
from hand_recon.hand.model import HandModel
from hand_recon.hand.open_hand import open_hand
from hand_recon.regressor.error_feedback import Regressor
from hand_recon.regressor.landmark_encoder import LandmarkEncoder
from hand_recon.regressor.lifted import start_from_lifter
from hand_recon.regressor.lifter_file import SHIPPED, load_lifter
from hand_recon.regressor.photo_encoder import PhotoEncoder
from hand_recon.schema import CropMotion, HandBatch
from hand_recon.training.module import located_error
from tests.support.tolerance import assert_close
from tests.support.views import known_hands, views
from tests.support.watched import GradientPrecisions


def photo_network(
    hand: HandModel, *, size: int = 32, gives: bool = True, view: float = 1.0
) -> Regressor:
    landmarks = LandmarkEncoder(size, 2, 0.0)
    encoder = PhotoEncoder(
        "efficientnet_lite0", "none", landmarks=landmarks, width=8, view=view, gives_landmarks=gives
    )
    return Regressor(encoder, hand, width=size, dropout=0.0, activation=True, reprojection=True)


def encoder_of(network: Regressor) -> PhotoEncoder:
    assert isinstance(network.encoder, PhotoEncoder)
    return network.encoder


@pytest.fixture
def pictures(hand: HandModel) -> HandBatch:
    """Four hands with images, which show noise, in crops of 64 pixels."""
    batch = views(hand, known_hands(hand, 4))
    return replace(
        batch,
        image=torch.rand(4, 3, 64, 64),
        landmarks_2d=batch.landmarks_2d * 64 / 224,
        intrinsics=None,
    )


@pytest.fixture(scope="module")
def lifter() -> Regressor:
    return load_lifter(SHIPPED, lambda wanted, landmark_set: open_hand(landmark_set))


def test_pixels_alone_do_not_see_the_labels(hand: HandModel, pictures: HandBatch) -> None:
    network = photo_network(hand, gives=False).eval()
    moved = replace(pictures, landmarks_2d=pictures.landmarks_2d + 9.0)
    hidden = replace(pictures, labelled=torch.zeros_like(pictures.labelled))
    with torch.no_grad():
        first = network(pictures).landmarks_3d
        assert torch.equal(first, network(moved).landmarks_3d)
        assert torch.equal(first, network(hidden).landmarks_3d)


def test_turned_looks_are_for_outside_of_training(hand: HandModel, pictures: HandBatch) -> None:
    network = photo_network(hand, gives=False).eval()
    encoder = encoder_of(network)
    with torch.no_grad():
        one = network(pictures)
        encoder.turns = (-20.0, 20.0)
        several = network(pictures)
    assert one.located_2d is not None and several.located_2d is not None  # noqa: PT018
    assert (one.located_2d - several.located_2d).abs().max() > 1e-3
    # In training, looks at turned crops would cost six times the time.
    encoder.train()
    encoder.backbone.eval()
    encoder.maps.eval()
    with torch.no_grad():
        trained = encoder(pictures).located_2d
    assert trained is not None
    assert (trained - one.located_2d).abs().max() < 1e-3


def test_given_landmarks_count_only_where_they_are_labelled(
    hand: HandModel, pictures: HandBatch
) -> None:
    network = photo_network(hand).eval()
    some = replace(pictures, labelled=pictures.labelled & (torch.arange(21) < 9))
    values = some.landmarks_2d.masked_fill(~some.labelled[..., None], torch.nan)
    with torch.no_grad():
        first = network(some).landmarks_3d
        assert torch.equal(first, network(replace(some, landmarks_2d=values)).landmarks_3d)
        assert not torch.equal(first, network(pictures).landmarks_3d)


def test_a_hand_without_given_landmarks_is_seen_by_pixels_alone(
    hand: HandModel, pictures: HandBatch
) -> None:
    both, alone = photo_network(hand).eval(), photo_network(hand, gives=False).eval()
    alone.load_state_dict(both.state_dict())
    none = replace(
        pictures, labelled=pictures.labelled & torch.tensor([[True], [False], [True], [False]])
    )
    with torch.no_grad():
        found, seen = both(none).landmarks_3d, alone(none).landmarks_3d
    assert_close(found[[1, 3]], seen[[1, 3]])
    assert float((found[[0, 2]] - seen[[0, 2]]).abs().max()) > 1e-5


def test_training_gives_the_asked_share_moved_by_the_asked_noise(
    hand: HandModel, pictures: HandBatch
) -> None:
    encoder = encoder_of(photo_network(hand)).train()
    many = pictures.select(torch.zeros(4000, dtype=torch.int64))
    given, visible = encoder._given(many)
    assert float(visible.any(dim=1).float().mean()) == pytest.approx(encoder.given_share, abs=0.03)
    # Noise of 5 pixels of a 224-pixel crop is 1.43 pixels of this one.
    assert float((given - many.landmarks_2d).std()) == pytest.approx(5 * 64 / 224, rel=0.02)


def test_found_landmarks_are_in_pixels_of_the_whole_crop(
    hand: HandModel, pictures: HandBatch
) -> None:
    encoder = encoder_of(photo_network(hand, gives=False, view=0.75)).eval()
    with torch.no_grad():
        located = encoder(pictures).located_2d
        border = replace(pictures, image=pictures.image.clone())
        border.image[..., :8] = 0.0
        outside = encoder(border).located_2d
        inner = encoder.maps(encoder.backbone(pictures.image[..., 8:56, 8:56]))[0]
    assert located is not None
    assert outside is not None
    assert_close(located, 8 + 48 * inner)
    # The border of an eighth on each side is not looked at.
    assert torch.equal(located, outside)


def test_labels_of_the_maps_do_not_come_through_the_rounds_of_feedback(
    hand: HandModel, pictures: HandBatch
) -> None:
    network = photo_network(hand, gives=False).train()
    network(pictures).landmarks_2d.square().sum().backward()
    assert all(parameter.grad is None for parameter in encoder_of(network).maps.parameters())
    network(pictures).located_2d.square().sum().backward()
    assert any(parameter.grad is not None for parameter in encoder_of(network).maps.parameters())


def test_landmarks_alone_are_lifted_as_by_the_lifter_it_started_from(lifter: Regressor) -> None:
    hand = lifter.hand
    network = photo_network(hand, size=512).eval()
    start_from_lifter(network, lifter)
    batch = replace(views(hand, known_hands(hand, 3)), intrinsics=None)
    # Both see the same upright crop; then one places the hand there and the other in the crop.
    evidence = encoder_of(network)(batch)
    assert evidence.motion is not None
    upright = move(batch, evidence.motion)
    with torch.no_grad():
        ours, theirs = network(batch), lifter(upright)
    assert_close(ours.parameters.joint_angles, theirs.parameters.joint_angles)
    assert_close(ours.parameters.shape, theirs.parameters.shape)
    linear, offset = evidence.motion.pixels[:, :2, :2], evidence.motion.pixels[:, None, :2, 2]
    # Both crops have the same focal length, so the projections differ by perspective alone.
    moved = ours.landmarks_2d @ linear.mT + offset
    assert float((moved - theirs.landmarks_2d).norm(dim=-1).mean()) < 1.0


def test_a_turned_crop_gives_a_turned_hand(lifter: Regressor) -> None:
    hand = lifter.hand
    network = photo_network(hand, size=512).eval()
    start_from_lifter(network, lifter)
    batch = replace(views(hand, known_hands(hand, 3)), intrinsics=None)
    roll = torch.tensor([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    pixels = roll.clone()
    # About the middle of the crop.
    pixels[:2, 2] = 112 - pixels[:2, :2] @ torch.tensor([112.0, 112.0])
    turn = CropMotion(pixels.expand(3, 3, 3), roll.expand(3, 3, 3), torch.ones(3))
    with torch.no_grad():
        straight, turned = network(batch), network(move(batch, turn))
    assert_close(straight.landmarks_3d @ roll.T, turned.landmarks_3d)


def test_a_lifter_of_another_size_is_refused(hand: HandModel, lifter: Regressor) -> None:
    with pytest.raises(ValueError, match="start_from=none"):
        start_from_lifter(photo_network(hand, size=64), lifter)
    with pytest.raises(ValueError, match="model=photos"):
        start_from_lifter(lifter, lifter)


def test_no_image_and_no_landmarks_is_an_error(hand: HandModel) -> None:
    batch = views(hand, known_hands(hand, 2))
    with pytest.raises(ValueError, match="gives_landmarks=true"):
        photo_network(hand, gives=False).eval()(batch)


def test_located_error_is_the_sum_over_labelled_coordinates(pictures: HandBatch) -> None:
    labelled = torch.zeros_like(pictures.labelled)
    labelled[:, :2] = True
    batch = replace(pictures, labelled=labelled)
    found = batch.landmarks_2d + torch.tensor([3.0, -4.0])
    # Two landmarks, |3| + |−4| pixels of a 64-pixel crop each.
    assert_close(located_error(batch, found), torch.full((4,), 2 * 7 * 224 / 64))
    values = batch.landmarks_2d.masked_fill(~labelled[..., None], torch.nan)
    assert_close(located_error(replace(batch, landmarks_2d=values), found), torch.full((4,), 49.0))


@pytest.mark.parametrize("turns", [(), (-20.0, 20.0)], ids=["one look", "six looks"])
def test_mixed_precision_rounds_no_pixels(
    hand: HandModel, pictures: HandBatch, turns: tuple[float, ...]
) -> None:
    network = photo_network(hand).eval()
    encoder_of(network).turns = turns
    with torch.no_grad(), torch.autocast("cpu", torch.bfloat16):
        evidence = encoder_of(network)(pictures)
    assert evidence.motion is not None
    assert evidence.landmarks_2d is not None
    moved = move_points(pictures.landmarks_2d, evidence.motion.pixels)
    # bfloat16 has steps of a quarter pixel at 40 pixels.
    assert float((evidence.landmarks_2d - moved).abs().max()) < 1e-3
    assert evidence.motion.pixels.dtype == torch.float32
    # Given landmarks are the evidence; found ones are pixels too.
    assert evidence.located_2d is not None
    assert evidence.located_2d.dtype == torch.float32
    assert (evidence.located_2d != evidence.located_2d.bfloat16()).any()


def test_in_mixed_precision_no_depthwise_convolution_has_a_gradient_in_bfloat16(
    hand: HandModel, pictures: HandBatch
) -> None:
    """Those of oneDNN are slow; the backbone and the maps have both kinds of convolutions."""
    network = photo_network(hand).train()
    with torch.autocast("cpu", torch.bfloat16):
        evidence = encoder_of(network)(pictures)
    assert evidence.located_2d is not None
    with GradientPrecisions() as gradients:
        (evidence.located_2d.sum() + evidence.features.sum()).backward()
    depthwise = {precision for groups, precision in gradients.seen if groups > 1}
    others = {precision for groups, precision in gradients.seen if groups == 1}
    assert (depthwise, others) == ({torch.float32}, {torch.bfloat16})
    assert sum(groups == 96 for groups, _ in gradients.seen) >= 3  # Three maps, of 96 channels.
