"""Uncertainty as ellipses around the landmarks (Fig. 4a)."""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8

from hand_recon.hand.skeleton import LANDMARK_PARENTS
from hand_recon.schema import REFERENCE_SIZE, HandBatch, HandPrediction
from hand_recon.visualization.canvas import background
from hand_recon.visualization.overlay import FINGER_COLOURS

SIGMA_LEVELS: Final = (1.0, 2.0)
"""Half axes of the ellipses, in σ; the first ellipse is filled."""

_OPACITY: Final = 0.35
_FRACTION_BITS: Final = 4


def covariances(
    log_sigma: Float[torch.Tensor, "*batch landmark 2"],
    correlation: Float[torch.Tensor, "*batch landmark"] | None,
    size: int,
) -> Float[np.ndarray, "*batch landmark 2 2"]:
    """Compute covariance matrices of landmarks in an image, squared pixels of that image.

    Args:
        log_sigma: Logarithm of σ along u and v, σ in pixels of a 224-pixel crop.
        correlation: Correlation of the two coordinates, −1 to 1; None for zero.
        size: Side of the image, pixels.
    """
    sigma = log_sigma.detach().double().cpu().exp().numpy() * (size / REFERENCE_SIZE)
    matrices = sigma[..., :, None] * sigma[..., None, :]
    mixed = 0.0 if correlation is None else correlation.detach().double().cpu().numpy()
    matrices[..., 0, 1] *= mixed
    matrices[..., 1, 0] *= mixed
    return matrices


def principal_axes(
    covariance: Float[np.ndarray, "*batch 2 2"],
) -> tuple[Float[np.ndarray, "*batch 2"], Float[np.ndarray, "*batch"]]:
    """Half axes and angle of the one-σ ellipse.

    Args:
        covariance: Symmetric, squared pixels.

    Returns:
        Long and short half axis, pixels; angle of the long axis from u (right) towards v (down), radians.
    """
    variances, directions = np.linalg.eigh(covariance)
    long = directions[..., :, 1]
    halves = np.sqrt(variances[..., ::-1].clip(min=0.0))
    return halves, np.arctan2(long[..., 1], long[..., 0])


def draw_ellipses(
    image: UInt8[np.ndarray, "height width 3"],
    landmarks: Float[np.ndarray, "landmark=21 2"],
    covariance: Float[np.ndarray, "landmark=21 2 2"],
    shown: Bool[np.ndarray, "landmark=21"] | None = None,
) -> UInt8[np.ndarray, "height width 3"]:
    """Draw the ellipses of `SIGMA_LEVELS` on a copy of an image, in the fingers' colours, largest first.

    Args:
        image: RGB.
        landmarks: Centres, pixels, pixel i covering [i, i + 1).
        covariance: Covariance of each landmark, squared pixels.
        shown: Mask of the landmarks to draw; without it, all. Those that are not finite are never drawn.
    """
    finite = np.isfinite(landmarks).all(axis=1) & np.isfinite(covariance).all(axis=(1, 2))
    shown = finite if shown is None else shown & finite
    canvas = np.ascontiguousarray(image.copy())
    width = max(1, image.shape[0] // 220)
    halves, angles = principal_axes(np.where(finite[:, None, None], covariance, 0.0))
    order = [index for index in np.argsort(-halves.prod(axis=1)).tolist() if shown[index]]
    for index in order:
        colour = FINGER_COLOURS[max(index - 1, 0) // 4]
        for level, thickness in zip(SIGMA_LEVELS, (cv2.FILLED, width), strict=True):
            layer = canvas.copy()
            ellipse = _Ellipse(landmarks[index], level * halves[index], float(angles[index]))
            _draw(layer, ellipse, colour, thickness)
            opacity = _OPACITY if thickness == cv2.FILLED else 0.8
            canvas = cv2.addWeighted(layer, opacity, canvas, 1 - opacity, 0)
    for index in order:
        parent = LANDMARK_PARENTS[index]
        colour = FINGER_COLOURS[max(index - 1, 0) // 4]
        if parent >= 0 and shown[parent]:
            ends = [_fixed(landmarks[end] - 0.5) for end in (parent, index)]
            cv2.line(canvas, ends[0], ends[1], colour, width, cv2.LINE_AA, _FRACTION_BITS)
    drawn: UInt8[np.ndarray, "height width 3"] = np.asarray(canvas, dtype=np.uint8)
    return drawn


@dataclass(frozen=True)
class _Ellipse:
    centre: Float[np.ndarray, "2"]
    halves: Float[np.ndarray, "2"]
    angle: float


def ellipse_panels(
    batch: HandBatch, prediction: HandPrediction, panel: int = 224
) -> list[UInt8[np.ndarray, "height width 3"]]:
    """Draw each crop with the ellipses of its predicted landmarks; on white for a crop without an image.

    Args:
        batch: Images as bytes, or as floats 0–1.
        prediction: Predictions for these images.
        panel: Side of each panel, pixels.
    """
    centres = (prediction.landmarks_2d * (panel / batch.crop_size)).double().cpu().numpy()
    matrices = covariances(prediction.log_sigma, prediction.correlation, panel)
    return [
        draw_ellipses(background(image, panel), centres[index], matrices[index])
        for index, image in enumerate(batch.image)
    ]


def _draw(
    canvas: UInt8[np.ndarray, "height width 3"],
    ellipse: _Ellipse,
    colour: tuple[int, int, int],
    thickness: int,
) -> None:
    # OpenCV's pixel centres are at whole numbers; coordinates are in 1/16 pixel.
    halves = np.minimum(ellipse.halves, 8.0 * max(canvas.shape))
    cv2.ellipse(
        canvas, _fixed(ellipse.centre - 0.5), _fixed(halves), float(np.degrees(ellipse.angle)),
        0, 360, colour, thickness, cv2.LINE_AA, _FRACTION_BITS,
    )  # fmt: skip


def _fixed(pixels: Float[np.ndarray, "2"]) -> tuple[int, int]:
    bounded = (pixels * 2**_FRACTION_BITS).clip(-(2**20), 2**20).round()
    return int(bounded[0]), int(bounded[1])
