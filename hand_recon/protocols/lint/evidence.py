"""What the lint of predictions measures with, and when it calls a difference a mistake.

Alignment with reflections hides mirrored hands, wrong axes and wrong units, so that nothing here uses it.
"""

from dataclasses import dataclass
from typing import Final, Literal

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.evaluation.alignment import align_proper
from hand_recon.evaluation.point_error import point_errors

Confidence = Literal["certain", "likely", "note"]
"""A note is no mistake: something that the reader of the scores should know."""

DEVIATIONS: Final = 6.0
"""Standard errors by which a paired difference must exceed zero: dozens of hypotheses are tried."""

SHARE_BETTER: Final = 0.75
"""Of the frames that a cure must improve."""

LEAST_GAIN: Final = 0.0005
"""Metres: what is smaller matters to nobody."""

FEWEST: Final = 4
"""Frames below which every one of them must improve, and by a third."""


@dataclass(frozen=True)
class Hands:
    """The frames that are looked at, in FreiHAND's order, OpenCV's axes and metres as far as is known."""

    ground_truth: Float[Tensor, "hand landmark=21 3"]
    """Ground truth."""
    prediction: Float[Tensor, "hand landmark=21 3"]
    """Of the same frames, mended as far as mistakes were found."""


@dataclass(frozen=True)
class Suspicion:
    """A mistake, or something to know, before it is scored."""

    kind: str
    """One word for programs."""
    found: str
    """A sentence without its full stop: what the file looks like."""
    cure: str | None = None
    """What to do, to follow "if you"; none where nothing can be done to the file."""
    score: str = "E_J"
    """The score that shows the mistake, a column of `LANDMARK_SCORES`."""
    confidence: Confidence = "likely"
    """How sure this is."""
    measured: tuple[float, float | None] | None = None
    """Now and once mended, millimetres, for what is not among the landmark scores."""


def shape_error(
    ground_truth: Float[Tensor, "hand point 3"], prediction: Float[Tensor, "hand point 3"]
) -> Float[Tensor, " hand"]:
    """Mean error after rotation, scale and translation, but no reflection, metres."""
    return point_errors(ground_truth, align_proper(ground_truth, prediction)).mean(dim=-1)


def turned_error(
    ground_truth: Float[Tensor, "hand point 3"], prediction: Float[Tensor, "hand point 3"]
) -> Float[Tensor, " hand"]:
    """Mean error after translation and one scale for all hands, but no rotation, metres."""
    centred = prediction - prediction.mean(dim=1, keepdim=True)
    scaled = centred / size_ratio(ground_truth, prediction)
    return point_errors(ground_truth - ground_truth.mean(dim=1, keepdim=True), scaled).mean(dim=-1)


def sizes(points: Float[Tensor, "hand point 3"]) -> Float[Tensor, " hand"]:
    """Root of the mean squared distance from the centroid."""
    centred = points - points.mean(dim=1, keepdim=True)
    return centred.square().sum(dim=-1).mean(dim=-1).sqrt()


def size_ratio(
    ground_truth: Float[Tensor, "hand point 3"], prediction: Float[Tensor, "hand point 3"]
) -> float:
    """How many times too large the predicted hands are: the median over frames."""
    return float((sizes(prediction) / sizes(ground_truth)).median())


def is_constant(prediction: Float[Tensor, "hand point 3"]) -> bool:
    """Whether one hand is predicted for all frames, at most moved from place to place."""
    if len(prediction) < 2:
        return False
    centred = prediction - prediction.mean(dim=1, keepdim=True)
    change = (centred - centred[:1]).abs().amax()
    return bool(change <= 1e-3 * centred.abs().amax())


def clearly_better(
    now: Float[Tensor, " hand"], mended: Float[Tensor, " hand"], share: float
) -> bool:
    """Whether a cure lowers an error by a share of it, in nearly every frame, and not by chance."""
    gain = now - mended
    if gain.mean() < max(share * float(now.mean()), LEAST_GAIN):
        return False
    if len(gain) < FEWEST:
        return bool((gain > now / 3).all())
    error = gain.std() / len(gain) ** 0.5
    return bool(gain.mean() > DEVIATIONS * error) and bool(
        (gain > 0).double().mean() >= SHARE_BETTER
    )


def certainty(now: Float[Tensor, " hand"], mended: Float[Tensor, " hand"]) -> Confidence:
    """Certain where the cure takes away half of the error or more."""
    return "certain" if float(mended.mean()) <= 0.5 * float(now.mean()) else "likely"


def spread_evenly(count: int, most: int) -> Tensor:
    """At most so many positions among so many frames, from the first on."""
    step = max(1, -(-count // most))
    return torch.arange(0, count, step)
