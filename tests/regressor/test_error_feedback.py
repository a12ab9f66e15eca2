"""The regressor: shapes, initial state, training, and error messages."""

from pathlib import Path
from urllib.error import URLError

import pytest
import torch
from torchvision import models

from hand_recon.camera import default_intrinsics, project, six_d_to_rotation
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import LANDMARKS
from hand_recon.regressor.error_feedback import Regressor
from hand_recon.regressor.image_encoder import ImageEncoder
from hand_recon.schema import HandBatch
from tests.support.tolerance import assert_close


def crops(images: torch.Tensor, intrinsics: torch.Tensor | None = None) -> HandBatch:
    """Images without labels, with or without camera matrices."""
    count = len(images)
    return HandBatch(
        image=images,
        landmarks_2d=torch.full((count, 21, 2), torch.nan),
        labelled=torch.zeros(count, 21, dtype=torch.bool),
        index=torch.arange(count),
        source=("",) * count,
        intrinsics=intrinsics,
    )


@pytest.fixture
def regressor(hand: HandModel) -> Regressor:
    encoder = ImageEncoder("mobilenet_v3_small", weights="none", grid=2)
    return Regressor(encoder, hand, width=64).eval()


@pytest.mark.parametrize(("correlated", "more"), [(False, 0), (True, 21)])
def test_every_round_answers_with_the_numbers_of_the_design(
    hand: HandModel, *, correlated: bool, more: int
) -> None:
    """15×3 angles, 6 of the root, 3 of the camera, 10 of shape, 42 log σ, and 21 correlations if asked."""
    encoder = ImageEncoder("mobilenet_v3_small", weights="none", grid=2)
    regressor = Regressor(encoder, hand, width=64, correlated=correlated)
    expected = 45 + 6 + 3 + 10 + 42 + more
    assert regressor.initial_state.shape == (expected,)
    answers = [decoder(torch.zeros(64)) for decoder in regressor.decoders.values()]
    assert sum(len(answer) for answer in answers) == expected


def test_it_starts_upright_with_the_palm_to_the_camera_and_fills_the_crop(
    regressor: Regressor,
) -> None:
    for parameter in regressor.decoders.parameters():
        torch.nn.init.zeros_(parameter)
    prediction = regressor(crops(torch.rand(1, 3, 96, 96)))
    landmarks = dict(zip(LANDMARKS, prediction.landmarks_2d[0], strict=True))
    assert landmarks["middle tip"][1] < landmarks["middle MCP"][1] < landmarks["wrist"][1]
    assert landmarks["thumb tip"][0] > landmarks["little MCP"][0]
    extent = prediction.landmarks_2d[0].amax(dim=0) - prediction.landmarks_2d[0].amin(dim=0)
    assert 0.45 * 96 < extent.max() < 0.9 * 96
    # The palm faces the camera: bent fingertips are nearer to it than the knuckles.
    depth = dict(zip(LANDMARKS, prediction.landmarks_3d[0, :, 2], strict=True))
    assert depth["middle tip"] < depth["middle MCP"]


def test_projections_are_those_of_the_predicted_hand(regressor: Regressor) -> None:
    prediction = regressor(crops(torch.rand(3, 3, 64, 64)))
    camera = default_intrinsics(64, prediction.landmarks_3d).expand(3, 3, 3)
    assert_close(prediction.landmarks_2d, project(prediction.landmarks_3d, camera))
    posed = regressor.hand.to_camera(prediction.parameters)
    assert_close(prediction.vertices, posed.vertices)


def test_the_answer_for_one_crop_does_not_depend_on_the_others(
    regressor: Regressor,
) -> None:
    images = torch.rand(4, 3, 64, 64)
    together, alone = regressor(crops(images)), regressor(crops(images[2:3]))
    assert_close(together.landmarks_3d[2:3], alone.landmarks_3d)


def test_a_known_camera_moves_the_hand_but_not_its_place_in_the_crop(hand: HandModel) -> None:
    encoder = ImageEncoder("mobilenet_v3_small", weights="none")
    network = Regressor(encoder, hand, width=32, use_intrinsics=True).eval()
    images = torch.rand(2, 3, 64, 64)
    long = torch.tensor([[400.0, 0.0, 32.0], [0.0, 400.0, 32.0], [0.0, 0.0, 1.0]]).expand(2, 3, 3)
    assumed, known = network(crops(images)), network(crops(images, long))
    assert (known.landmarks_3d[..., 2] > 2 * assumed.landmarks_3d[..., 2]).all()
    shift = (known.landmarks_2d.mean(dim=1) - assumed.landmarks_2d.mean(dim=1)).norm(dim=-1)
    assert shift.max() < 3.0


def test_it_learns_four_hands_from_their_2d_landmarks(hand: HandModel) -> None:
    encoder = ImageEncoder("mobilenet_v3_small", weights="none", grid=2)
    network = Regressor(encoder, hand, width=64, dropout=0.0, activation=True).train()
    images = torch.rand(4, 3, 64, 64)
    with torch.no_grad():
        start = network(crops(images)).landmarks_2d
    target = start + 4.0 * torch.randn(4, 1, 2)
    optimizer = torch.optim.Adam(network.parameters(), lr=3e-3)
    for _ in range(120):
        optimizer.zero_grad()
        loss = (network(crops(images)).landmarks_2d - target).square().mean()
        loss.backward()
        optimizer.step()
    assert loss.item() < 0.5


def test_every_round_sees_a_rotation_of_orthonormal_columns(regressor: Regressor) -> None:
    with torch.no_grad():
        regressor.decoders["root"].get_parameter("bias").normal_()
    seen: list[torch.Tensor] = []
    regressor.regressor.register_forward_pre_hook(lambda _, inputs: seen.append(inputs[0]))
    answer = regressor(crops(torch.rand(3, 3, 64, 64)))
    start = regressor.encoder.feature_size + 45
    rounds = [state[:, start : start + 6].unflatten(-1, (2, 3)) for state in seen]
    assert len(rounds) == 3
    for columns in rounds:
        assert_close(columns @ columns.mT, torch.eye(2).expand(3, 2, 2))
    # A round starts from the last estimate; only the lengths of its columns change.
    correction = regressor.decoders["root"](regressor.regressor(seen[-1]))
    last = six_d_to_rotation(rounds[-1].flatten(-2) + correction)
    assert_close(answer.parameters.root_rotation, last)


def test_every_parameter_gets_a_finite_gradient(regressor: Regressor) -> None:
    prediction = regressor.train()(crops(torch.rand(4, 3, 64, 64)))
    (prediction.landmarks_2d.square().mean() + prediction.log_sigma.mean()).backward()
    for name, parameter in regressor.named_parameters():
        assert parameter.grad is not None, name
        assert torch.isfinite(parameter.grad).all(), name


def test_half_precision_stays_in_the_backbone(regressor: Regressor) -> None:
    with torch.autocast("cpu", torch.bfloat16):
        prediction = regressor(crops(torch.rand(2, 3, 64, 64)))
    assert prediction.landmarks_3d.dtype == torch.float32


def test_weights_from_a_file_are_those_of_the_file(tmp_path: Path) -> None:
    source = models.mobilenet_v3_small(weights=None)
    torch.save(source.state_dict(), tmp_path / "weights.pth")
    encoder = ImageEncoder("mobilenet_v3_small", weights=str(tmp_path / "weights.pth"))
    first = next(encoder.parameters())
    assert torch.equal(first, next(source.parameters()))


def test_without_network_imagenet_weights_are_refused_with_three_cures(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def offline(*_: object, **__: object) -> None:
        raise URLError("no network")

    monkeypatch.setattr("torch.hub.download_url_to_file", offline)
    monkeypatch.setattr("torch.hub._hub_dir", str(tmp_path))
    with pytest.raises(RuntimeError, match=r"checkpoints/.*weights=<file>.*weights=none"):
        ImageEncoder("resnet18", weights="imagenet")


def test_a_missing_file_of_weights_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="No file of weights"):
        ImageEncoder("resnet18", weights=str(tmp_path / "absent.pth"))


def test_an_unknown_backbone_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ValueError, match=r"'vgg11'.*resnet50"):
        ImageEncoder("vgg11", weights="none")
