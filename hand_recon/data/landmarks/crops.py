"""Converts landmarks of whole images to crops of right hands, and predictions back (Sec. 4.1).

Batched form of `hand_recon.data.crop`, with the same squares, matrices and cameras.
"""

from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hand_recon.camera import move_points
from hand_recon.data.landmarks.image_landmarks import (
    ImageLandmarks,
    boxes,
    mirror_camera,
    mirror_left,
    mirror_matrices,
)
from hand_recon.schema import (
    REFERENCE_SIZE,
    HandBatch,
    HandEstimate,
    HandParameters,
    HandPrediction,
)


@dataclass(frozen=True)
class LandmarkCrops:
    """Crops of `REFERENCE_SIZE` pixels without image data, and the matrices that made them."""

    batch: HandBatch
    """Input of a regressor or a fit; `label_noise` is the labels' σ in pixels of the crop."""
    matrices: Float[Tensor, "hand 3 3"]
    """Matrices from image pixels to crop pixels, double precision; they mirror left hands."""
    mirrored: Bool[Tensor, " hand"]
    """True for left hands, which are mirrored."""


def to_crops(landmarks: ImageLandmarks, expansion: float = 1.5) -> LandmarkCrops:
    """Cut a square about each hand's labelled landmarks.

    Where fewer than two landmarks are labelled, or all coincide, there is no box: the crop is centred on
    the labelled landmark at the image's own resolution, so that the other hands keep their positions in the
    batch (`ImageLandmarks.usable` is False for such hands).

    Args:
        landmarks: Hands of any image size; left ones are mirrored.
        expansion: Side of a square as a multiple of the box's longer side.

    Raises:
        ValueError: The expansion is not positive.
    """
    if not expansion > 0:
        raise ValueError(f"A crop at expansion {expansion} shows nothing; 1.5 leaves a margin.")
    right = mirror_left(landmarks)
    crop = _crop_matrices(right, expansion)
    scale = crop[:, 0, 0]
    sigma, confidence, intrinsics = right.sigma, right.confidence, right.intrinsics
    hands = len(landmarks)
    batch = HandBatch(
        image=torch.empty(hands, 3, 0, 0, dtype=torch.uint8),
        landmarks_2d=move_points(right.landmarks_2d, crop).float(),
        labelled=right.labelled,
        index=torch.arange(hands),
        source=right.names,
        intrinsics=None if intrinsics is None else (crop @ intrinsics).float(),
        label_noise=None if sigma is None else (sigma * scale[:, None]).float(),
        confidence=None if confidence is None else confidence.float(),
        estimate=_scaled(right.estimate, scale),
    )
    return LandmarkCrops(batch, crop @ mirror_matrices(landmarks, landmarks.left), landmarks.left)


def _scaled(estimate: HandEstimate | None, scale: Float[Tensor, " hand"]) -> HandEstimate | None:
    """An estimate whose σ are in pixels of crops in place of images."""
    if estimate is None:
        return None
    log_sigma = estimate.log_sigma + scale.log()[:, None, None]
    return replace(estimate, log_sigma=log_sigma).to(torch.float32)


def _crop_matrices(landmarks: ImageLandmarks, expansion: float) -> Float[Tensor, "hand 3 3"]:
    low, high = boxes(landmarks)
    side = (high - low).amax(dim=-1) * expansion
    side = torch.where(side > 0, side, float(REFERENCE_SIZE))
    scale = REFERENCE_SIZE / side
    matrices = torch.eye(3, dtype=low.dtype).repeat(len(landmarks), 1, 1)
    matrices[:, 0, 0] = matrices[:, 1, 1] = scale
    matrices[:, :2, 2] = REFERENCE_SIZE / 2 - scale[:, None] * (low + high) / 2
    return matrices


def uncrop_prediction(crops: LandmarkCrops, prediction: HandPrediction) -> HandPrediction:
    """Convert predictions from crops to images; mirrored left hands become left hands again.

    3D points are in the camera's frame of the unmirrored image. The camera matrix, the projections and σ are
    in pixels of the image; `project(landmarks_3d, intrinsics)` still gives the projections. Joint angles and
    shape mean the same for a left hand as for the right one that it mirrors; rotation and translation are
    those of a left hand's model, which is the right one's with x → −x. All tensors are on the CPU.

    Args:
        crops: Crops that were fitted.
        prediction: Predictions, one per hand of these crops.
    """
    mirrored, matrices = crops.mirrored, crops.matrices
    found = prediction.to("cpu").detach()
    back = torch.linalg.inv(matrices)
    kept = found.parameters
    rotation = mirror_camera(kept.root_rotation, mirrored)
    rotation = mirror_camera(rotation.mT, mirrored).mT
    # Both axes have the same scale; the determinant is negative for mirrored hands.
    log_scale = torch.linalg.det(matrices[:, :2, :2]).abs().log() / 2
    intrinsics = mirror_camera(back @ found.intrinsics.double(), mirrored)
    correlation = found.correlation
    if correlation is not None:
        correlation = torch.where(mirrored[:, None], -correlation, correlation)
    covariance = found.covariance_3d
    if covariance is not None:
        covariance = mirror_camera(mirror_camera(covariance, mirrored).mT, mirrored)
    return HandPrediction(
        parameters=HandParameters(
            joint_angles=kept.joint_angles,
            shape=kept.shape,
            root_rotation=rotation,
            translation=mirror_camera(kept.translation, mirrored),
        ),
        vertices=mirror_camera(found.vertices, mirrored),
        joints=mirror_camera(found.joints, mirrored),
        landmarks_3d=mirror_camera(found.landmarks_3d, mirrored),
        landmarks_2d=move_points(found.landmarks_2d.double(), back),
        log_sigma=found.log_sigma - log_scale[:, None, None],
        intrinsics=intrinsics,
        correlation=correlation,
        covariance_3d=covariance,
    )
