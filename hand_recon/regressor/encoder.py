"""Interface of the encoders: a batch in, evidence about each hand out (Sec. 4.1)."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

from jaxtyping import Bool, Float
from torch import Tensor, nn

from hand_recon.schema import CropMotion, HandBatch


@dataclass(frozen=True)
class Evidence:
    """Evidence about each hand of a batch: features and, perhaps, landmarks."""

    features: Float[Tensor, "batch feature"]
    """Input of the regressor."""
    landmarks_2d: Float[Tensor, "batch landmark=21 2"] | None = None
    """Landmarks with which the regressor compares its projections, pixels of the crop, or of the upright
    crop where there is a motion; None without any."""
    visible: Bool[Tensor, "batch landmark=21"] | None = None
    """True for the landmarks that are known; None where `landmarks_2d` is."""
    motion: CropMotion | None = None
    """Transform from the crop to an upright crop, in which the regressor works; None if it works in the
    crop."""
    located_2d: Float[Tensor, "batch landmark=21 2"] | None = None
    """Landmarks that the encoder itself found in the image, pixels of the crop; None if it looks for
    none."""


class Encoder(nn.Module, ABC):
    """Base class of encoders."""

    feature_size: int
    """Number of features."""
    has_landmarks: bool = False
    """True if the evidence has landmarks."""

    @abstractmethod
    def forward(self, batch: HandBatch) -> Evidence:
        """Evidence about every hand of a batch; in training, an encoder may leave out some of its input."""
