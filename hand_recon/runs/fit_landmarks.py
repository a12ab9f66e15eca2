"""Fits 3D hands to arrays of 2D landmarks: what `hand-recon fit` does, as a function."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from jaxtyping import Float

from hand_recon.command_line.composing import composed
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.fitting.in_parts import fit_in_parts
from hand_recon.runs.configuration import build_hand
from hand_recon.runs.fit_run import adapted_to_data, file_origins, source_of
from hand_recon.runs.fitters import fitter_of
from hand_recon.runs.reconstructed_hands import ReconstructedHands

SIDES: Final = ("right", "left")
"""Sides that a hand can have."""

COMMAND_ONLY: Final = frozenset(
    {"data", "hands", "image_size", "images", "intrinsics", "landmarks", "name", "order", "output",
     "placeholders", "results", "seed", "side", "strict", "third_value", "threads"}
)  # fmt: skip
"""Settings of `hand-recon fit` that a fit of arrays does not read."""


def fit_landmarks(
    points: Any,  # noqa: ANN401  # anything that NumPy takes
    *,
    side: str | Sequence[str] | None = None,
    intrinsics: Any = None,  # noqa: ANN401
    confidence: Any = None,  # noqa: ANN401
    images: Sequence[str | Path | None] | None = None,
    overrides: Sequence[str] = (),
) -> ReconstructedHands:
    """Fit 3D hands to 2D landmarks with knowledge of hands and a likelihood (Sec. 3.2-3.4).

    Args:
        points: What `hand_recon.read_landmarks` read from a file, which then says the rest; or 21 landmarks
            per hand in the order of MediaPipe, OpenPose and FreiHAND, pixels of the image
            (pixel i covers [i, i + 1)): hand × 21 × 2, or 21 × 2 for one hand. NaN where one is missing.
        side: `right` or `left`, one for all hands or one per hand; right by default.
        intrinsics: Camera matrix, pixels: 3 × 3, or one per hand; none for an assumed camera of 500 px on a
            crop of 224 px.
        confidence: Detector confidence of each landmark, 0 to 1; none if unknown.
        images: Image file of each hand, for drawing.
        overrides: Settings of `hand-recon fit`, such as `prior=biomechanics` or `descent.steps=100`.

    Raises:
        ValueError: Shapes, sides, cameras or confidences are not as above; or an argument is given twice.
    """
    check_overrides(overrides, COMMAND_ONLY, "fit_landmarks")
    # A fit takes gradients, also for callers who take none.
    with torch.inference_mode(False), torch.enable_grad():
        if isinstance(points, ImageLandmarks):
            if not (side is None and intrinsics is None and confidence is None):
                raise ValueError(
                    "side, intrinsics and confidence belong to arrays, and these landmarks have their own. "
                    "Read the camera with read_landmarks(file, intrinsics_file), or pass an array."
                )
            # Copied, since tensors of inference mode have no gradients.
            landmarks = points.select(slice(None))
        else:
            landmarks = image_landmarks(points, side or "right", intrinsics, confidence)
        if images is not None:
            files = tuple(None if one is None else Path(one) for one in images)
            landmarks = replace(landmarks, images=files)
        config = adapted_to_data(composed("fit", overrides))
        hand = build_hand(config)
        origins = file_origins(landmarks, source_of(config, hand))
        parts = tuple(fit_in_parts(landmarks, fitter_of(config, hand, landmarks), origins=origins))
    return ReconstructedHands(parts, hand.faces.numpy())


def check_overrides(overrides: Sequence[str], command_only: frozenset[str], function: str) -> None:
    """Check that settings are ones that a function reads, not only the command.

    Args:
        overrides: The settings.
        command_only: Names of those that only the command reads.
        function: The function, for the message.

    Raises:
        ValueError: One of them is not.
    """
    if isinstance(overrides, str):
        raise ValueError(f"overrides is one string, {overrides!r}; expected a list of them.")
    for word in overrides:
        name = word.lstrip("+~").partition("=")[0]
        if name in command_only:
            raise ValueError(
                f"The override {word!r} has no effect here: {name} is an argument of {function} or is the "
                "command's own."
            )


def image_landmarks(
    points: Any,  # noqa: ANN401
    side: str | Sequence[str],
    intrinsics: Any,  # noqa: ANN401
    confidence: Any,  # noqa: ANN401
) -> ImageLandmarks:
    """Check arrays of landmarks and make the record that is fitted to; arguments as of `fit_landmarks`.

    Raises:
        ValueError: Shapes, sides, cameras or confidences are not as there.
    """
    if isinstance(points, torch.Tensor):
        points = points.detach().cpu()
    found = np.asarray(points, dtype=np.float64)
    array = found[None] if found.ndim == 2 else found
    if array.ndim != 3 or array.shape[1:] != (21, 2) or not len(array):
        raise ValueError(
            f"points have the shape {found.shape}; expected hand × 21 × 2, or 21 × 2 for one hand: "
            "pixels (u, v) of 21 landmarks, NaN where one is missing."
        )
    count = len(array)
    sides = [side] * count if isinstance(side, str) else list(side)
    if len(sides) != count or not set(sides) <= set(SIDES):
        raise ValueError(
            f"side is {side!r}; expected right or left, or one of them for each of {count} hands."
        )
    tensor = torch.from_numpy(array)
    return ImageLandmarks(
        landmarks_2d=tensor,
        labelled=tensor.isfinite().all(dim=-1),
        left=torch.tensor([one == "left" for one in sides]),
        names=tuple(str(number) for number in range(count)),
        confidence=None if confidence is None else _per_hand("confidence", confidence, (count, 21)),
        intrinsics=None
        if intrinsics is None
        else _per_hand("intrinsics", intrinsics, (count, 3, 3)),
    )


def _per_hand(name: str, values: Any, shape: tuple[int, ...]) -> torch.Tensor:  # noqa: ANN401
    """Check an array of one entry per hand, or one entry for all, and expand it to one per hand."""
    array = np.asarray(values, dtype=np.float64)
    if array.shape not in (shape, shape[1:]):
        raise ValueError(f"{name} has the shape {array.shape}; expected {shape} or {shape[1:]}.")
    if name == "confidence" and not bool((np.isnan(array) | ((array >= 0) & (array <= 1))).all()):
        raise ValueError(
            "A confidence is not between 0 and 1; a detector's raw score is no confidence."
        )
    if name == "intrinsics":
        check_cameras(name, array)
    return torch.from_numpy(np.broadcast_to(array, shape).copy())


def check_cameras(name: str, matrices: Float[np.ndarray, "*hand 3 3"]) -> None:
    """Check that every matrix can be a camera's.

    Args:
        name: The argument, for the message.
        matrices: Camera matrices, pixels.

    Raises:
        ValueError: One cannot.
    """
    focal = matrices[..., [0, 1], [0, 1]]
    last = np.abs(matrices[..., 2, :] - [0.0, 0.0, 1.0])
    if not (np.isfinite(matrices).all() and (focal > 0).all() and (last < 1e-6).all()):
        raise ValueError(
            f"{name} is no camera matrix; expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels, "
            "finite, with fx and fy above 0."
        )
