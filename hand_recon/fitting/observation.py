"""What a fit is given: landmarks in crops, and how far to trust each (Sec. 3.3)."""

from dataclasses import dataclass
from typing import Final

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hand_recon.camera import default_intrinsics
from hand_recon.schema import REFERENCE_SIZE, HandBatch

UNKNOWN_SIGMA: Final = 3.0
"""Pixels of a 224-pixel crop that a landmark is trusted to, where nobody says."""

HALF_SURE: Final = 5.0
"""Pixels of a 224-pixel crop that a landmark of confidence ½ is trusted to."""

SIGMA_BOUNDS: Final = (1.0, 25.0)
"""Nothing makes a landmark exact, and nothing makes it worth nothing: pixels of a 224-pixel crop."""


@dataclass(frozen=True)
class Observation:
    """What is known of hands before the fit: landmarks in crops of 224 pixels."""

    landmarks_2d: Float[Tensor, "hand landmark=21 2"]
    """Pixels of the crop; anything where not labelled."""
    labelled: Bool[Tensor, "hand landmark=21"]
    """Which landmarks there are; at least three of each hand."""
    intrinsics: Float[Tensor, "hand 3 3"]
    """Camera matrix of the crop, pixels."""
    sigma: Float[Tensor, "hand landmark=21"] | None = None
    """Standard deviation of each landmark, pixels of the crop; NaN where unknown."""

    def __len__(self) -> int:
        return len(self.landmarks_2d)

    def __getitem__(self, hands: slice | Tensor) -> "Observation":
        """Some of the hands."""
        sigma = None if self.sigma is None else self.sigma[hands]
        return Observation(
            self.landmarks_2d[hands], self.labelled[hands], self.intrinsics[hands], sigma
        )

    def log_sigma(self) -> Float[Tensor, "hand landmark=21 2"]:
        """Logarithm of σ of each coordinate, `UNKNOWN_SIGMA` where nothing is known."""
        unknown = torch.full_like(self.landmarks_2d[..., 0], UNKNOWN_SIGMA)
        sigma = (
            unknown
            if self.sigma is None
            else torch.where(self.sigma.isfinite(), self.sigma, unknown)
        )
        return sigma.log()[..., None].expand(*sigma.shape, 2)


def sigma_of_confidence(
    confidence: Float[Tensor, "hand landmark=21"], half_sure: float = HALF_SURE
) -> Float[Tensor, "hand landmark=21"]:
    """A detector's score as a standard deviation: confidence = 1 / (1 + (σ / half_sure)²).

    Detectors do not say what their scores mean. This is monotonic, right for the synthetic detector of
    `hand_recon.data.synthetic.labels`, and for another one as good as its `half_sure`.

    Args:
        confidence: From 0 to 1; NaN where unknown.
        half_sure: σ at confidence ½, pixels of a 224-pixel crop.

    Returns:
        Pixels of a 224-pixel crop; NaN where unknown.
    """
    sigma = half_sure * (1 / confidence.clamp(min=1e-6) - 1).clamp(min=0).sqrt()
    return sigma.clamp(*SIGMA_BOUNDS)


def confidence_of_sigma(
    sigma: Float[Tensor, "hand landmark=21"], half_sure: float = HALF_SURE
) -> Float[Tensor, "hand landmark=21"]:
    """The inverse of `sigma_of_confidence`, but for its bounds."""
    return 1 / (1 + (sigma / half_sure).square())


def observed(batch: HandBatch, half_sure: float = HALF_SURE) -> Observation:
    """The landmarks of a batch of crops; σ where it is told, else from the confidence, else unknown.

    Args:
        batch: Crops of 224 pixels, `label_noise` being the landmarks' σ if anybody knows it.
        half_sure: Of `sigma_of_confidence`.
    """
    camera = batch.intrinsics
    if camera is None:
        camera = default_intrinsics(REFERENCE_SIZE, batch.landmarks_2d).expand(len(batch), 3, 3)
    sigma = batch.label_noise
    if batch.confidence is not None:
        from_confidence = sigma_of_confidence(batch.confidence, half_sure)
        sigma = (
            from_confidence
            if sigma is None
            else torch.where(sigma.isfinite(), sigma, from_confidence)
        )
    if sigma is not None:
        # A σ of a hundredth of a pixel would switch the prior off.
        sigma = sigma.clamp(*SIGMA_BOUNDS)
    return Observation(batch.landmarks_2d, batch.labelled, camera, sigma)
