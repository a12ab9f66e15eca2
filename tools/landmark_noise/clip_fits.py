"""Fits to one camera's landmarks of a clip by two cameras, with one σ and with each landmark's own."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from depth.scores import aligned_errors, grouped_mean
from depth.stereo import BLOCK, stereo_clip
from hand_recon.command_line.composing import composed
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.detection.landmark_noise import SHARED_ERROR, NoiseTable
from hand_recon.fitting.in_parts import Fitter, fit_in_parts
from hand_recon.runs.configuration import build_hand
from hand_recon.runs.fit_run import adapted_to_data
from hand_recon.runs.fitters import build_fitter
from landmark_noise.clip import Clip, calibrate

METHODS: Final = (
    (0, "fit"),
    (0, "equal"),
    (0, "table"),
    (1, "fit"),
    (1, "equal"),
    (1, "table"),
    (1, "both"),
    (2, "fit"),
    (2, "both"),
    (3, "both"),
    (8, "fit"),
    (8, "equal"),
    (8, "copies"),
    (8, "both"),
)
"""Numbers of copies and sources of σ, as for `calibrate`, or `fit` for the σ that a fit takes by itself."""


def compare(clip: Clip, folder: Path, table: NoiseTable) -> Iterator[str]:
    """Fit the hands of both cameras by every method; yield a line for each.

    PA-MPJPE (E_J) is to the triangulated points. Intervals draw blocks of consecutive frames.

    Args:
        clip: The hands of the clip.
        folder: Its folder, with `landmarks.npz`.
        table: Table of the spread.
    """
    ground_truth = stereo_clip(folder)
    rows = {name: row for row, name in enumerate(ground_truth.landmarks.names)}
    kept = [place for place, frame in enumerate(clip.frames) if f"frame {frame}" in rows]
    expected = ground_truth.ground_truth[[rows[f"frame {clip.frames[place]}"] for place in kept]]
    groups = [f"{camera} {clip.frames[place] // BLOCK}" for camera in (0, 1) for place in kept]
    config = adapted_to_data(composed("fit", []))
    fitter = build_fitter(config, build_hand(config))
    first: Tensor | None = None
    for copies, use in METHODS:
        found = torch.cat(
            [_fitted(one, fitter)[kept] for one in _landmarks(clip, table, copies, use)]
        )
        errors = aligned_errors(torch.cat([expected, expected]), found).mean(dim=1)
        first = errors if first is None else first
        change = grouped_mean(errors - first, groups).signed()
        yield f"{copies} copies, σ {use}: {grouped_mean(errors, groups)} mm, change {change}"


def _landmarks(
    clip: Clip, table: NoiseTable, copies: int, use: str
) -> tuple[ImageLandmarks, ImageLandmarks]:
    """The landmarks of each camera."""
    points = clip.landmarks(copies)
    gain = 1.0 if use == "fit" else calibrate(clip, table, copies, use).gain
    spreads = clip.spread(table, copies, use="equal" if use == "fit" else use)
    one, other = (
        _of_camera(points[number], clip.cameras[number].matrix, sigma)
        for number, sigma in enumerate(
            None if use == "fit" else np.hypot(SHARED_ERROR * sides, gain * spread)
            for sides, spread in zip(clip.sides, spreads, strict=True)
        )
    )
    return one, other


def _of_camera(
    points: Float[np.ndarray, "frame landmark=21 2"],
    matrix: Float[np.ndarray, "3 3"],
    sigma: Float[np.ndarray, "frame landmark=21"] | None,
) -> ImageLandmarks:
    count = len(points)
    return ImageLandmarks(
        landmarks_2d=torch.from_numpy(points),
        labelled=torch.ones(count, 21, dtype=torch.bool),
        left=torch.zeros(count, dtype=torch.bool),
        names=tuple(map(str, range(count))),
        sigma=None if sigma is None else torch.from_numpy(sigma),
        intrinsics=torch.from_numpy(matrix).expand(count, 3, 3).clone(),
    )


def _fitted(landmarks: ImageLandmarks, fitter: Fitter) -> Float[Tensor, "hand landmark=21 3"]:
    parts = fit_in_parts(landmarks, fitter)
    return torch.cat([part.prediction.landmarks_3d for part in parts]).double()
