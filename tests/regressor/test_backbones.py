"""Backbones: features at three strides, frozen layers, weights from files, errors that say what to do."""

from pathlib import Path

import pytest
import torch

from hand_recon.regressor.backbones import LayeredBackbone, build_backbone
from tests.support.tolerance import assert_close


@pytest.mark.parametrize("name", ["efficientnet_lite0", "resnet18", "mobilenet_v3_small"])
@pytest.mark.parametrize("size", [64, 112])
def test_features_have_the_sizes_of_their_strides(name: str, size: int) -> None:
    backbone = build_backbone(name, "none").eval()
    with torch.no_grad():
        found = backbone(torch.rand(1, 3, size, size))
    for stride, features in found.items():
        assert features.shape == (1, backbone.channels[stride], *(2 * [-(-size // stride)]))
    assert sorted(found) == [8, 16, 32]


def test_frozen_layers_keep_weights_and_statistics() -> None:
    backbone = build_backbone("efficientnet_lite0", "none", frozen=4)
    assert isinstance(backbone, LayeredBackbone)
    before = {name: value.clone() for name, value in backbone.state_dict().items()}
    # Not even asked to train: Lightning trains modules in the mode that they were built in.
    optimizer = torch.optim.SGD(
        [parameter for parameter in backbone.parameters() if parameter.requires_grad], lr=1.0
    )
    sum(value.square().mean() for value in backbone(torch.rand(2, 3, 64, 64)).values()).backward()
    optimizer.step()
    changed = {
        int(name.split(".")[1])
        for name, value in backbone.state_dict().items()
        if not torch.equal(value, before[name])
    }
    assert changed == set(range(4, 9))


def test_weights_of_a_file_are_those_that_are_used(tmp_path: Path) -> None:
    first = build_backbone("efficientnet_lite0", "none").eval()
    assert isinstance(first, LayeredBackbone)
    torch.save(first.layers.state_dict(), tmp_path / "weights.pt")
    second = build_backbone("efficientnet_lite0", str(tmp_path / "weights.pt")).eval()
    image = torch.rand(1, 3, 64, 64)
    with torch.no_grad():
        assert_close(first(image)[32], second(image)[32])


@pytest.mark.parametrize(
    ("name", "weights", "frozen", "error", "said"),
    [
        ("resnet19", "none", 0, ValueError, "efficientnet_lite0"),
        ("resnet18", "nowhere.pt", 0, FileNotFoundError, "model.encoder.weights"),
        ("resnet18", "none", 99, ValueError, "has 8 layers"),
        ("timm/resnet18", "none", 2, ValueError, "cannot be frozen"),
    ],
)
def test_errors_say_what_to_do(
    name: str, weights: str, frozen: int, error: type[Exception], said: str
) -> None:
    with pytest.raises(error, match=said):
        build_backbone(name, weights, frozen)


def test_timms_networks_have_the_same_strides() -> None:
    pytest.importorskip("timm", reason="needs the package timm")
    backbone = build_backbone("timm/mobilenetv3_small_050", "none").eval()
    with torch.no_grad():
        found = backbone(torch.rand(1, 3, 64, 64))
    assert {stride: value.shape[-1] for stride, value in found.items()} == {8: 8, 16: 4, 32: 2}
