"""Networks as functions of named tensors, with the hand model inside: the contents of an ONNX file.

Inputs and outputs are those of docs/onnx.md: a lifter takes landmarks in pixels of any image, other
networks take a crop of one size. All hands are right hands, or mirrored left ones.
"""

from abc import ABC, abstractmethod
from typing import Final

import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor, nn

from hand_recon.camera import REFERENCE_SIZE, default_intrinsics
from hand_recon.fitting.lift import lift_batch
from hand_recon.regressor.error_feedback import Regressor
from hand_recon.regressor.landmark_encoder import LandmarkEncoder
from hand_recon.regressor.photo_encoder import PhotoEncoder
from hand_recon.schema import HandBatch, HandPrediction

INPUTS: Final = {
    "image": "RGB crop of a right hand, bytes, one row after the other.",
    "observed_2d": "Detected landmarks, pixels; pixel i covers [i, i + 1). Ignored where not given.",
    "given": "True for landmarks that were detected.",
    "confidence": "Detector confidence of each landmark, 0 to 1; negative where unknown.",
    "intrinsics": "Camera matrix, the same pixels.",
}
"""Every input by name."""

OUTPUTS: Final = {
    "landmarks_3d": "Landmarks, camera frame (x right, y down, z forward), metres.",
    "vertices": "Surface, camera frame, metres.",
    "joint_angles": "Bend, splay and twist of 15 joints from the straight finger, radians.",
    "shape": "Hand shape, standard deviations.",
    "root_rotation": "Rotation from the hand's frame to the camera's.",
    "translation": "Origin of the hand's frame (the middle finger's MCP) in the camera's, metres.",
    "landmarks_2d": "Projections of landmarks_3d, pixels as of the input.",
    "sigma_2d": "Standard deviation of u and v of each landmark, pixels as of the input.",
    "faces": "Triangles of the surface, numbers of vertices, counter-clockwise from outside.",
    "found_2d": "Landmarks that the network found in the crop before it placed the hand, pixels.",
}
"""Every output by name."""

Landmarks = Float[Tensor, "hand landmark=21 2"]
Given = Bool[Tensor, "hand landmark=21"]
Confidence = Float[Tensor, "hand landmark=21"]
Cameras = Float[Tensor, "hand 3 3"]
Tensors = tuple[Tensor, ...]


class NetworkGraph(nn.Module, ABC):
    """A regressor from named tensors to named tensors, without gradients.

    Args:
        regressor: Network in evaluation mode.
    """

    kind: str
    """Name of the kind of network in the file."""
    inputs: tuple[str, ...]
    """Names of the inputs, in order."""
    outputs: tuple[str, ...] = tuple(name for name in OUTPUTS if name != "found_2d")
    """Names of the outputs, in order."""

    def __init__(self, regressor: Regressor) -> None:
        super().__init__()
        self.regressor = regressor.requires_grad_(requires_grad=False)
        self.eval()

    @abstractmethod
    def example(self, hands: int) -> Tensors:
        """Inputs for a number of hands, to trace and to compare the network with."""

    def _results(self, seen: HandPrediction, sigma_unit: float = 1.0) -> Tensors:
        """All outputs that every network has, in order."""
        hand, faces = seen.parameters, self.regressor.hand.faces
        return (
            seen.landmarks_3d, seen.vertices, hand.joint_angles, hand.shape, hand.root_rotation,
            hand.translation, seen.landmarks_2d, seen.log_sigma.exp() * sigma_unit, faces,
        )  # fmt: skip


class LifterGraph(NetworkGraph):
    """A lifter with the rotation to upright hands: landmarks in pixels of any image with its camera.

    Args:
        regressor: Network with a `LandmarkEncoder`, in evaluation mode.
    """

    kind = "lifter"

    def __init__(self, regressor: Regressor) -> None:
        super().__init__(regressor)
        self.inputs = ("observed_2d", "given", "intrinsics", *_confidence(regressor.encoder))

    def example(self, hands: int) -> Tensors:
        """Landmarks of hands of random poses, some of them missing."""
        return _landmarks(self, hands, int(REFERENCE_SIZE))

    def forward(
        self,
        observed_2d: Landmarks,
        given: Given,
        intrinsics: Cameras,
        confidence: Confidence | None = None,
    ) -> Tensors:
        """The outputs, in order."""
        image = observed_2d.new_empty(observed_2d.shape[0], 3, 0, 0)
        batch = _batch(image, observed_2d, given, _known(confidence))
        return self._results(lift_batch(self.regressor, batch, intrinsics))


class CropGraph(NetworkGraph):
    """A network that sees a crop, and landmarks if its encoder takes them.

    Args:
        regressor: Network with an encoder of images, in evaluation mode.
        size: Side of its crops, pixels.
        sigma_factor: Factor of its σ, fitted on the validation hands of its training.
    """

    def __init__(self, regressor: Regressor, size: int, sigma_factor: float = 1.0) -> None:
        super().__init__(regressor)
        regressor.use_intrinsics = True
        # Its σ are in pixels of a crop of the reference size.
        self.sigma_unit = sigma_factor * size / REFERENCE_SIZE
        self.size, self.kind, self.inputs = size, "image", ("image", "intrinsics")
        if isinstance(regressor.encoder, PhotoEncoder):
            regressor.encoder.gives_landmarks = True
            landmarks = ("observed_2d", "given", *_confidence(regressor.encoder.landmarks))
            self.kind, self.inputs = "photos", ("image", "intrinsics", *landmarks)
            self.outputs = (*self.outputs, "found_2d")

    def example(self, hands: int) -> Tensors:
        """Crops of noise, with landmarks for some hands."""
        draws = torch.Generator().manual_seed(hands)
        size = (hands, self.size, self.size, 3)
        image = torch.randint(0, 256, size, dtype=torch.uint8, generator=draws)
        observed_2d, given, intrinsics, *rest = _landmarks(self, hands, self.size)
        # Hands without landmarks, too.
        given[::2] = False
        values = (image, intrinsics, observed_2d, given, *rest)
        return values[: len(self.inputs)]

    def forward(
        self,
        image: UInt8[Tensor, "hand size size 3"],
        intrinsics: Cameras,
        observed_2d: Landmarks | None = None,
        given: Given | None = None,
        confidence: Confidence | None = None,
    ) -> Tensors:
        """The outputs, in order."""
        pixels = image.permute(0, 3, 1, 2).float() / 255
        if observed_2d is None or given is None:
            observed_2d = pixels.new_zeros(image.shape[0], 21, 2)
            given = torch.zeros_like(observed_2d[..., 0], dtype=torch.bool)
        batch = _batch(pixels, observed_2d, given, _known(confidence), intrinsics)
        seen: HandPrediction = self.regressor(batch)
        results = self._results(seen, self.sigma_unit)
        return results if seen.located_2d is None else (*results, seen.located_2d)


def _confidence(encoder: nn.Module) -> tuple[str, ...]:
    """Name of the input of confidences, if an encoder takes them."""
    takes = isinstance(encoder, LandmarkEncoder) and encoder.confidence
    return ("confidence",) if takes else ()


def _known(confidence: Confidence | None) -> Confidence | None:
    """Confidences as the encoder takes them: NaN where unknown."""
    return None if confidence is None else confidence.masked_fill(confidence < 0, torch.nan)


def _batch(
    image: Tensor,
    landmarks_2d: Landmarks,
    given: Given,
    confidence: Confidence | None,
    intrinsics: Cameras | None = None,
) -> HandBatch:
    index = torch.arange(landmarks_2d.shape[0])
    return HandBatch(
        image, landmarks_2d, given, index, (), intrinsics=intrinsics, confidence=confidence
    )


def _landmarks(graph: NetworkGraph, hands: int, size: int) -> Tensors:
    """Landmarks of random hands in crops, mask, cameras and confidences, the last if they are an input."""
    draws = torch.Generator().manual_seed(hands)

    def normal(*shape: int) -> Tensor:
        return torch.randn(hands, *shape, generator=draws)

    hand = graph.regressor.hand
    flat = hand(0.2 * normal(15, 3), normal(10)).landmarks[..., [1, 0]]
    points = size / 2 + 2.5 * size * flat + 0.01 * size * normal(21, 2)
    given = torch.rand(hands, 21, generator=draws) > 0.1
    zoom = 1 + 0.1 * torch.rand(hands, 1, 1, generator=draws)
    intrinsics = default_intrinsics(size, points).expand(hands, 3, 3) * torch.cat(
        [zoom, zoom, torch.ones_like(zoom)], dim=1
    )
    confidence = torch.rand(hands, 21, generator=draws) - 0.1
    values = (points, given, intrinsics)
    return (*values, confidence) if "confidence" in graph.inputs else values
