"""Error measures and decision thresholds of the lint of predictions.

No measure allows reflections, which would hide mirrored hands and wrong axes.
"""

from dataclasses import dataclass
from typing import Final, Literal

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.evaluation.alignment import align_proper
from hand_recon.evaluation.point_error import point_errors

Confidence = Literal["certain", "likely", "note"]
"""Certainty of a mistake; a note is no mistake but a fact that limits the scores."""

DEVIATIONS: Final = 6.0
"""Standard errors by which a paired gain must exceed zero; high, because dozens of hypotheses are tried."""

SHARE_BETTER: Final = 0.75
"""Least share of the frames that a fix must improve."""

MINIMUM_GAIN: Final = 0.0005
"""Least mean gain of a fix, metres."""

FEW_FRAMES: Final = 4
"""With fewer frames than this, a fix must lower the error of every frame by more than a third."""


@dataclass(frozen=True)
class Hands:
    """Inspected frames, in FreiHAND's order, OpenCV's axes and metres unless the file is wrong."""

    ground_truth: Float[Tensor, "hand landmark=21 3"]
    """True landmarks."""
    prediction: Float[Tensor, "hand landmark=21 3"]
    """Predicted landmarks of the same frames, corrected for the mistakes found so far."""


@dataclass(frozen=True)
class Suspicion:
    """A mistake or a note, not yet scored."""

    kind: str
    """Identifier, one of those listed in `Finding.kind`."""
    found: str
    """Description of the file, a sentence without its full stop."""
    fix: str | None = None
    """Remedy, worded to follow "if you"; none where the file cannot be corrected."""
    score: str = "E_J"
    """Score that shows the mistake, a column of `LANDMARK_SCORES`."""
    confidence: Confidence = "likely"
    """Certainty of the mistake."""
    measured: tuple[float, float | None] | None = None
    """Score before and after the fix, millimetres, where it is no landmark score."""


def shape_error(
    ground_truth: Float[Tensor, "hand point 3"], prediction: Float[Tensor, "hand point 3"]
) -> Float[Tensor, " hand"]:
    """Mean error of each hand after alignment without reflection, metres."""
    return point_errors(ground_truth, align_proper(ground_truth, prediction)).mean(dim=-1)


def orientation_error(
    ground_truth: Float[Tensor, "hand point 3"], prediction: Float[Tensor, "hand point 3"]
) -> Float[Tensor, " hand"]:
    """Mean error of each hand after translation and one scale for all hands, without rotation, metres."""
    centred = prediction - prediction.mean(dim=1, keepdim=True)
    scaled = centred / size_ratio(ground_truth, prediction)
    return point_errors(ground_truth - ground_truth.mean(dim=1, keepdim=True), scaled).mean(dim=-1)


def sizes(points: Float[Tensor, "hand point 3"]) -> Float[Tensor, " hand"]:
    """Size of each hand: root mean square distance of its points from their centroid, metres."""
    centred = points - points.mean(dim=1, keepdim=True)
    return centred.square().sum(dim=-1).mean(dim=-1).sqrt()


def size_ratio(
    ground_truth: Float[Tensor, "hand point 3"], prediction: Float[Tensor, "hand point 3"]
) -> float:
    """Median over frames of the predicted size divided by the true size."""
    return float((sizes(prediction) / sizes(ground_truth)).median())


def is_constant(prediction: Float[Tensor, "hand point 3"]) -> bool:
    """True if all predictions are the same hand up to translation."""
    if len(prediction) < 2:
        return False
    centred = prediction - prediction.mean(dim=1, keepdim=True)
    change = (centred - centred[:1]).abs().amax()
    return bool(change <= 1e-3 * centred.abs().amax())


def clearly_better(
    now: Float[Tensor, " hand"], corrected: Float[Tensor, " hand"], share: float
) -> bool:
    """True if a fix lowers the error by at least a share of it, in nearly every frame, beyond chance."""
    gain = now - corrected
    if gain.mean() < max(share * float(now.mean()), MINIMUM_GAIN):
        return False
    if len(gain) < FEW_FRAMES:
        return bool((gain > now / 3).all())
    error = gain.std() / len(gain) ** 0.5
    return bool(gain.mean() > DEVIATIONS * error) and bool(
        (gain > 0).double().mean() >= SHARE_BETTER
    )


def certainty(now: Float[Tensor, " hand"], corrected: Float[Tensor, " hand"]) -> Confidence:
    """Certain where the fix removes half of the error or more, else likely."""
    return "certain" if float(corrected.mean()) <= 0.5 * float(now.mean()) else "likely"


def spread_evenly(count: int, most: int) -> Tensor:
    """Indices of at most `most` frames of `count`, evenly spaced from the first on."""
    step = max(1, -(-count // most))
    return torch.arange(0, count, step)
