"""Whether a dataset's labels can be what they are taken for: numbers over many samples, and diagnoses.

A wrong order of landmarks, unit, axis or side does not stop a training. It spoils it.
"""

from dataclasses import dataclass
from typing import Final

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hand_recon.camera import project
from hand_recon.hand.landmark_order import better_order
from hand_recon.hand.skeleton import LANDMARKS, ROOT_LANDMARK
from hand_recon.schema import REFERENCE_SIZE, HandBatch

LARGEST_MEDIAN: Final = 3.0
"""Pixels of a 224-pixel crop by which labels may differ from the projected truth in the median. FreiHAND's
are the projections; the annotators of others were a pixel or two away."""

PALM_LENGTHS: Final = (0.04, 0.16)
"""Metres from wrist to middle MCP between which every hand's median lies; adults have about 0.09."""

FEWEST_CURLED: Final = 10
"""Hands with bent fingers without which their side is not judged."""

_INDEX, _LITTLE = LANDMARKS.index("index MCP"), LANDMARKS.index("little MCP")


@dataclass(frozen=True)
class LabelReport:
    """What the labels of some samples are like."""

    numbers: dict[str, float]
    """By name; units are in the names. What cannot be known is not there."""
    labelled: dict[str, float]
    """Share of the samples that have each landmark."""
    troubles: tuple[str, ...]
    """Diagnoses with their cures; empty if nothing speaks against the labels."""


def examine_labels(batch: HandBatch) -> LabelReport:
    """Look at the labels of some samples.

    Args:
        batch: As many as can be had; right hands, as every dataset gives them.
    """
    numbers: dict[str, float] = {"samples": float(len(batch))}
    numbers["left_hands_percent"] = (
        0.0 if batch.mirrored is None else 100 * float(batch.mirrored.double().mean())
    )
    numbers |= _sizes_in_crop(batch)
    troubles = _order_troubles(batch)
    if batch.landmarks_3d is not None:
        known = batch.landmarks_3d.isfinite().flatten(1).all(dim=1)
        if known.any():
            found, more = _examine_3d(batch.select(known))
            numbers |= found
            troubles += more
    shares = batch.labelled.double().mean(dim=0).tolist()
    return LabelReport(numbers, dict(zip(LANDMARKS, shares, strict=True)), tuple(troubles))


def curls_to_the_palm(
    landmarks: Float[Tensor, "hand landmark=21 3"],
) -> tuple[Bool[Tensor, " hand"], Bool[Tensor, " hand"]]:
    """Which hands have clearly bent fingers, and which of all bend them as a right hand does.

    The normal (index MCP − wrist) × (little MCP − wrist) points out of a right hand's palm, in a right-handed
    frame such as the camera's, and out of the back of a left hand.
    """
    wrist = landmarks[:, 0]
    normal = torch.linalg.cross(landmarks[:, _INDEX] - wrist, landmarks[:, _LITTLE] - wrist)
    normal = torch.nn.functional.normalize(normal, dim=-1)
    fingers = landmarks[:, 5:].unflatten(1, (4, 4))
    ahead = fingers[:, :, 3] - fingers[:, :, 0]
    lift = torch.einsum("hfx,hx->hf", ahead, normal) / ahead.norm(dim=-1).clamp(min=1e-9)
    mean = lift.mean(dim=1)
    return mean.abs() > 0.3, mean > 0


def _sizes_in_crop(batch: HandBatch) -> dict[str, float]:
    points = batch.landmarks_2d
    high = points.masked_fill(points.isnan(), -torch.inf).amax(dim=1)
    low = points.masked_fill(points.isnan(), torch.inf).amin(dim=1)
    side = ((high - low).amax(dim=-1) / batch.crop_size).double()
    side = side[side.isfinite()]
    outside = ((points < 0) | (points > batch.crop_size)).any(dim=-1) & batch.labelled
    numbers = _percentiles("hand_side_of_crop", side)
    numbers["landmarks_outside_crop_percent"] = 100 * float(
        outside.sum() / batch.labelled.sum().clamp(min=1)
    )
    return numbers


def _order_troubles(batch: HandBatch) -> list[str]:
    spaces = {"2D": batch.landmarks_2d, "3D": batch.landmarks_3d}
    troubles = []
    for name, points in spaces.items():
        order = None if points is None else better_order(points.double().numpy())
        if order is not None:
            troubles.append(
                f"The {name} landmarks look to be in the order of {order!r}, not in FreiHAND's: bones are "
                "shorter so. Read them with that order (data.order for files of landmarks), or write them "
                "anew."
            )
    return troubles


def _examine_3d(batch: HandBatch) -> tuple[dict[str, float], list[str]]:
    assert batch.landmarks_3d is not None  # noqa: S101  # the caller chose these hands for having them
    landmarks = batch.landmarks_3d.double()
    palm = (landmarks[:, ROOT_LANDMARK] - landmarks[:, 0]).norm(dim=-1)
    numbers = _percentiles("palm_mm", palm * 1000) | _percentiles("depth_m", landmarks[:, 0, 2])
    troubles = []
    if not PALM_LENGTHS[0] < float(palm.median()) < PALM_LENGTHS[1]:
        troubles.append(
            f"The palm is {float(palm.median()):.4g} m long in the median, expected about 0.09: the 3D "
            "labels are in another unit than metres, or the order of landmarks is another."
        )
    if (landmarks[..., 2] <= 0).any():
        troubles.append(
            "Some 3D labels are behind the camera (z ≤ 0): OpenGL's axes? Turn y and z round."
        )
    curled, as_right = curls_to_the_palm(landmarks)
    if curled.sum() >= FEWEST_CURLED:
        share = float(as_right[curled].double().mean())
        numbers["bend_as_right_hands_percent"] = 100 * share
        if share < 0.5:
            troubles.append(
                f"{100 * (1 - share):.0f} % of the hands with bent fingers bend them towards the back of a "
                "right hand: the 3D labels are mirrored, or these are left hands taken for right ones."
            )
    if batch.intrinsics is not None:
        numbers_2d, more = _reprojection(batch)
        numbers, troubles = numbers | numbers_2d, troubles + more
    return numbers, troubles


def _reprojection(batch: HandBatch) -> tuple[dict[str, float], list[str]]:
    assert batch.landmarks_3d is not None  # noqa: S101  # as above
    assert batch.intrinsics is not None  # noqa: S101  # as above
    projected = project(batch.landmarks_3d.double(), batch.intrinsics.double())
    error = (projected - batch.landmarks_2d).norm(dim=-1)[batch.labelled]
    error = error[error.isfinite()] * (REFERENCE_SIZE / batch.crop_size)
    numbers = _percentiles("reprojection_px224", error)
    median = numbers.get("reprojection_px224_p50", 0.0)
    if median <= LARGEST_MEDIAN:
        return numbers, []
    trouble = (
        f"The projected 3D labels are {median:.1f} px (of a 224-pixel crop) from the 2D labels in the "
        "median, expected less than 3: the cameras belong to another picture size, or the axes or orders of "
        "the two differ."
    )
    return numbers, [trouble]


def _percentiles(name: str, values: Tensor) -> dict[str, float]:
    if not len(values):
        return {}
    shares = torch.tensor([0.05, 0.5, 0.95], dtype=torch.float64)
    found = torch.quantile(values.double(), shares).tolist()
    return {f"{name}_p{percent}": value for percent, value in zip((5, 50, 95), found, strict=True)}
