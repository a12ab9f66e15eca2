"""Plausibility checks of a dataset's labels: statistics over many samples, and diagnoses.

A training runs on labels in a wrong order, unit, frame or side without an error, and learns from them.
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
"""Largest plausible median distance of 2D labels from projected 3D labels, pixels of a 224-pixel crop.

FreiHAND's 2D labels are such projections; those that annotators placed differ by a pixel or two."""

PALM_LENGTHS: Final = (0.04, 0.16)
"""Plausible range of a dataset's median distance from wrist to middle MCP, metres; adults have about 0.09."""

FEWEST_CURLED: Final = 10
"""Fewest hands with bent fingers from which left and right hands are told apart."""

_INDEX, _LITTLE = LANDMARKS.index("index MCP"), LANDMARKS.index("little MCP")


@dataclass(frozen=True)
class LabelReport:
    """Statistics and diagnoses of some samples' labels."""

    numbers: dict[str, float]
    """Statistics by name; the names have the units. Those that the labels do not allow are absent."""
    labelled: dict[str, float]
    """Share of the samples that have each landmark."""
    troubles: tuple[str, ...]
    """Diagnoses with their cures; empty if the labels are plausible."""


def examine_labels(batch: HandBatch) -> LabelReport:
    """Compute statistics of some samples' labels, and diagnose wrong orders, units, frames and sides.

    Args:
        batch: The samples, right hands as from every dataset; more samples give surer diagnoses.
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
    """Masks of the hands with clearly bent fingers, and of those whose fingers bend as a right hand's.

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
                "shorter in that order. Read them with it (data.order for files of landmarks), or rewrite "
                "the files in FreiHAND's order."
            )
    return troubles


def _examine_3d(batch: HandBatch) -> tuple[dict[str, float], list[str]]:
    assert batch.landmarks_3d is not None  # noqa: S101  # the caller selected hands with 3D labels
    landmarks = batch.landmarks_3d.double()
    palm = (landmarks[:, ROOT_LANDMARK] - landmarks[:, 0]).norm(dim=-1)
    numbers = _percentiles("palm_mm", palm * 1000) | _percentiles("depth_m", landmarks[:, 0, 2])
    troubles = []
    if not PALM_LENGTHS[0] < float(palm.median()) < PALM_LENGTHS[1]:
        troubles.append(
            f"The median palm length is {float(palm.median()):.4g} m, expected about 0.09: the 3D labels are "
            "in another unit than metres, or their landmarks are in another order. Convert them to metres, "
            "or read them with their order."
        )
    if (landmarks[..., 2] <= 0).any():
        troubles.append(
            "Some 3D labels are behind the camera (z ≤ 0), expected z > 0. If they are in OpenGL's frame, "
            "change the signs of y and z."
        )
    curled, as_right = curls_to_the_palm(landmarks)
    if curled.sum() >= FEWEST_CURLED:
        share = float(as_right[curled].double().mean())
        numbers["bend_as_right_hands_percent"] = 100 * share
        if share < 0.5:
            troubles.append(
                f"{100 * (1 - share):.0f} % of the hands with bent fingers bend them towards the back of a "
                "right hand: the 3D labels are mirrored, or these are left hands read as right hands. Mirror "
                "the labels, or mark the hands as left."
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
        "median, expected less than 3: the camera matrices are for another image size, or 2D and 3D labels "
        "differ in frame or order. Compare the camera matrices with the size of the images."
    )
    return numbers, [trouble]


def _percentiles(name: str, values: Tensor) -> dict[str, float]:
    if not len(values):
        return {}
    shares = torch.tensor([0.05, 0.5, 0.95], dtype=torch.float64)
    found = torch.quantile(values.double(), shares).tolist()
    return {f"{name}_p{percent}": value for percent, value in zip((5, 50, 95), found, strict=True)}
