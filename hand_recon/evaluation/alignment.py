"""Alignment of a prediction with its ground truth before it is scored (Sec. 4.1, evaluation metrics).

The benchmarks align by a similarity transform that may mirror the hand (`align_official`): a left hand
predicted for a right one, or a hand flipped in depth, then has no error. `align_proper` allows rotations
only. The two agree unless the prediction is closer to the mirrored hand.
"""

from dataclasses import dataclass
from typing import Final

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hand_recon.hand.skeleton import LANDMARKS, ROOT_LANDMARK

WRIST: Final[int] = LANDMARKS.index("wrist")
"""The landmark at the root of root-relative errors."""

NORM_OFFSET: Final = 1e-8
"""Added to each norm by the benchmarks' scripts, against division by zero; in the points' unit."""


@dataclass(frozen=True)
class Similarity:
    """Similarity transform of each hand: rotation (or reflection), scale and translation."""

    rotation: Float[Tensor, "*batch 3 3"]
    """Orthogonal matrix; its determinant is −1 where it mirrors the hand."""
    scale: Float[Tensor, "*batch"]
    """Scale factor, without unit."""
    source: Float[Tensor, "*batch 3"]
    """Centroid of the prediction, in the points' unit."""
    target: Float[Tensor, "*batch 3"]
    """Centroid of the ground truth, in the points' unit."""

    @property
    def mirrors(self) -> Bool[Tensor, "*batch"]:
        """Hands that the transform mirrors."""
        return torch.linalg.det(self.rotation) < 0

    def apply(self, points: Float[Tensor, "*batch point 3"]) -> Float[Tensor, "*batch point 3"]:
        """Transform points of the prediction into the ground truth's frame."""
        matrix = self.scale[..., None, None] * self.rotation.mT
        return (points - self.source[..., None, :]) @ matrix + self.target[..., None, :]


def fit_similarity(
    ground_truth: Float[Tensor, "*batch point 3"],
    prediction: Float[Tensor, "*batch point 3"],
    *,
    reflections: bool,
) -> Similarity:
    """Least-squares similarity transform from the prediction to the ground truth.

    Procrustes analysis (Schönemann 1966; the determinant's sign as in Kabsch 1976 and Umeyama
    1991), with the benchmarks' offset of 1e-8 on each norm, in double precision. A prediction whose
    points are all equal is moved to the ground truth's centroid.

    Args:
        ground_truth: Any unit and frame; the offset makes the last digits depend on the unit.
        prediction: The same points in the same unit.
        reflections: Whether the hand may be mirrored, as in the official scripts.
    """
    ground_truth, prediction = ground_truth.double(), prediction.double()
    target, source = ground_truth.mean(dim=-2), prediction.mean(dim=-2)
    centred_ground_truth = ground_truth - target[..., None, :]
    centred_prediction = prediction - source[..., None, :]
    ground_truth_norm = torch.linalg.matrix_norm(centred_ground_truth) + NORM_OFFSET
    prediction_norm = torch.linalg.matrix_norm(centred_prediction) + NORM_OFFSET
    correlation = centred_ground_truth.mT @ centred_prediction
    correlation = correlation / (ground_truth_norm * prediction_norm)[..., None, None]
    left, singular_values, right = torch.linalg.svd(correlation)
    if not reflections:
        # Where the best fit is a reflection, the axis of the smallest singular value is negated.
        sign = torch.sign(torch.linalg.det(left @ right))
        singular_values = torch.cat(
            [singular_values[..., :2], singular_values[..., 2:] * sign[..., None]], dim=-1
        )
        left = torch.cat([left[..., :2], left[..., 2:] * sign[..., None, None]], dim=-1)
    scale = singular_values.sum(dim=-1) * ground_truth_norm / prediction_norm
    return Similarity(rotation=left @ right, scale=scale, source=source, target=target)


def align_official(
    ground_truth: Float[Tensor, "*batch point 3"], prediction: Float[Tensor, "*batch point 3"]
) -> Float[Tensor, "*batch point 3"]:
    """Align as the scripts of FreiHAND, HO3D and DexYCB do: reflections are allowed.

    Returns:
        The aligned prediction, in double precision.
    """
    return fit_similarity(ground_truth, prediction, reflections=True).apply(prediction.double())


def align_proper(
    ground_truth: Float[Tensor, "*batch point 3"], prediction: Float[Tensor, "*batch point 3"]
) -> Float[Tensor, "*batch point 3"]:
    """Align by rotation, scale and translation only: a mirrored hand keeps its error.

    Returns:
        The aligned prediction, in double precision.
    """
    return fit_similarity(ground_truth, prediction, reflections=False).apply(prediction.double())


def root_relative(
    points: Float[Tensor, "*batch point 3"], root: Float[Tensor, "*batch 3"]
) -> Float[Tensor, "*batch point 3"]:
    """Points relative to a root, neither rotated nor scaled, in double precision."""
    return points.double() - root.double()[..., None, :]


def align_scale_translation(
    ground_truth: Float[Tensor, "*batch landmark=21 3"],
    prediction: Float[Tensor, "*batch landmark=21 3"],
) -> Float[Tensor, "*batch landmark=21 3"]:
    """Align by scale and translation as HO3D's script does: equal wrist-to-middle-MCP length, equal wrist.

    A prediction whose length is zero keeps its scale, as in the current official script.

    Returns:
        The aligned prediction, in double precision.
    """
    ground_truth, prediction = ground_truth.double(), prediction.double()
    length = _palm_length(prediction)
    length = torch.where(length > 0, length, torch.ones_like(length))
    scaled = prediction / length * _palm_length(ground_truth)
    return scaled - scaled[..., WRIST, None, :] + ground_truth[..., WRIST, None, :]


def _palm_length(landmarks: Tensor) -> Tensor:
    palm = landmarks[..., ROOT_LANDMARK, :] - landmarks[..., WRIST, :]
    return palm.square().sum(dim=-1).sqrt()[..., None, None]
