"""Input of a fit: 2D landmarks in crops, and the standard deviation σ of each (Sec. 3.3)."""

from dataclasses import dataclass
from typing import Final

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hand_recon.camera import default_intrinsics
from hand_recon.schema import REFERENCE_SIZE, HandBatch, HandEstimate

UNKNOWN_SIGMA: Final = 3.0
"""σ of a landmark without σ or confidence, pixels of a 224-pixel crop."""

SIGMA_AT_HALF_CONFIDENCE: Final = 5.0
"""σ of a landmark of confidence ½, pixels of a 224-pixel crop."""

SIGMA_BOUNDS: Final = (1.0, 25.0)
"""Least and greatest σ, pixels of a 224-pixel crop; every σ is clipped to them."""


@dataclass(frozen=True)
class Observation:
    """Landmarks of the hands to fit, in crops of 224 pixels."""

    landmarks_2d: Float[Tensor, "hand landmark=21 2"]
    """Landmarks, pixels of the crop; ignored where not labelled."""
    labelled: Bool[Tensor, "hand landmark=21"]
    """Mask of the given landmarks; at least three of each hand."""
    intrinsics: Float[Tensor, "hand 3 3"]
    """Camera matrix of the crop, pixels."""
    sigma: Float[Tensor, "hand landmark=21"] | None = None
    """Standard deviation of each landmark, pixels of the crop; NaN where unknown."""
    estimate: HandEstimate | None = None
    """A network's estimate of each hand, camera frame and σ in pixels of the crop; None without one."""

    def __len__(self) -> int:
        return len(self.landmarks_2d)

    def __getitem__(self, hands: slice | Tensor) -> "Observation":
        """The observation of some of the hands."""
        sigma = None if self.sigma is None else self.sigma[hands]
        return Observation(
            self.landmarks_2d[hands],
            self.labelled[hands],
            self.intrinsics[hands],
            sigma,
            None if self.estimate is None else self.estimate.select(hands),
        )

    def log_sigma(self) -> Float[Tensor, "hand landmark=21 2"]:
        """Logarithm of σ of each coordinate, `UNKNOWN_SIGMA` where σ is not known."""
        unknown = torch.full_like(self.landmarks_2d[..., 0], UNKNOWN_SIGMA)
        sigma = (
            unknown
            if self.sigma is None
            else torch.where(self.sigma.isfinite(), self.sigma, unknown)
        )
        return sigma.log()[..., None].expand(*sigma.shape, 2)


def sigma_of_confidence(
    confidence: Float[Tensor, "hand landmark=21"],
    sigma_at_half_confidence: float = SIGMA_AT_HALF_CONFIDENCE,
) -> Float[Tensor, "hand landmark=21"]:
    """Convert detector confidences to σ, by confidence = 1 / (1 + (σ / sigma_at_half_confidence)²).

    Detectors do not define their confidences. The formula is exact for the synthetic detector of
    `hand_recon.data.synthetic.labels`; for another detector, `sigma_at_half_confidence` has to be tuned.

    Args:
        confidence: Confidences, 0 to 1; NaN where unknown.
        sigma_at_half_confidence: σ at confidence ½, pixels of a 224-pixel crop.

    Returns:
        σ, pixels of a 224-pixel crop, clipped to `SIGMA_BOUNDS`; NaN where unknown.
    """
    sigma = sigma_at_half_confidence * (1 / confidence.clamp(min=1e-6) - 1).clamp(min=0).sqrt()
    return sigma.clamp(*SIGMA_BOUNDS)


def confidence_of_sigma(
    sigma: Float[Tensor, "hand landmark=21"],
    sigma_at_half_confidence: float = SIGMA_AT_HALF_CONFIDENCE,
) -> Float[Tensor, "hand landmark=21"]:
    """Convert σ to confidences; inverts `sigma_of_confidence` within `SIGMA_BOUNDS`."""
    return 1 / (1 + (sigma / sigma_at_half_confidence).square())


def observed(
    batch: HandBatch, sigma_at_half_confidence: float = SIGMA_AT_HALF_CONFIDENCE
) -> Observation:
    """Take the landmarks of a batch of crops, with σ from `label_noise`, else from the confidence.

    Args:
        batch: Crops of 224 pixels; `label_noise` is the landmarks' σ where it is known.
        sigma_at_half_confidence: σ at confidence ½, pixels of a 224-pixel crop.
    """
    camera = batch.intrinsics
    if camera is None:
        camera = default_intrinsics(REFERENCE_SIZE, batch.landmarks_2d).expand(len(batch), 3, 3)
    sigma = batch.label_noise
    if batch.confidence is not None:
        from_confidence = sigma_of_confidence(batch.confidence, sigma_at_half_confidence)
        sigma = (
            from_confidence
            if sigma is None
            else torch.where(sigma.isfinite(), sigma, from_confidence)
        )
    if sigma is not None:
        # With a σ of a hundredth of a pixel the data term would outweigh the prior.
        sigma = sigma.clamp(*SIGMA_BOUNDS)
    return Observation(batch.landmarks_2d, batch.labelled, camera, sigma, batch.estimate)
