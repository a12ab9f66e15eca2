"""Hands that were fitted to 2D landmarks, in their own images, and what is written of each.

The entry of a hand in `fit.json`:

    name, side           what the hand is called, `left` or `right`
    fitted               false where there was too little to fit; all that follows is null then
    landmarks_3d         21×3, metres, camera frame (x right, y down, z forward)
    landmarks_2d         21×2, projections, pixels of the image
    joint_angles_degrees 15×3, bend, splay and twist of the joints that `joints.json` names
    shape                10, standard deviations
    camera               rotation 3×3 and translation (metres) of the hand's frame, intrinsics 3×3 (pixels
                         of the image), known: whether those were given
    sigma                21×2, pixels of the image; null where the fit has none
    residual             mean distance to the given landmarks, pixels of the image
    loss                 the value of every term
"""

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, TypeVar

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hand_recon.data.landmarks.crops import LandmarkCrops, uncrop_prediction
from hand_recon.data.landmarks.landmark_set import LandmarkSet
from hand_recon.schema import HandParameters, HandPrediction

Record = TypeVar("Record", HandParameters, HandPrediction)


@dataclass(frozen=True)
class FittedHands:
    """Hands that were fitted to landmarks, on the CPU and in their images: left hands are left."""

    observed: LandmarkSet
    """What they were fitted to."""
    prediction: HandPrediction
    """As `uncrop_prediction` gives it: camera frame and pixels of the image."""
    loss: dict[str, Float[Tensor, " hand"]]
    """Value of every term of the objective."""
    scale: Float[Tensor, " hand"]
    """Pixels of the 224-pixel crop per pixel of the image."""
    has_sigma: bool = True
    """Whether σ was fitted; else the prediction's means nothing."""

    def __len__(self) -> int:
        return len(self.observed)

    @property
    def fitted(self) -> Bool[Tensor, " hand"]:
        """Hands that had enough landmarks, and whose results are finite."""
        found = self.prediction
        numbers = torch.cat([found.landmarks_3d.flatten(1), found.landmarks_2d.flatten(1)], dim=1)
        return self.observed.usable & numbers.isfinite().all(dim=1)

    @property
    def distance(self) -> Float[Tensor, "hand landmark=21"]:
        """From each projection to the given landmark, pixels of the image; NaN where none was given."""
        distance = (self.prediction.landmarks_2d - self.observed.landmarks_2d).norm(dim=-1)
        given = self.observed.labelled & self.fitted[:, None]
        return torch.where(given, distance, torch.nan)


def fitted_hands(
    observed: LandmarkSet,
    crops: LandmarkCrops,
    prediction: HandPrediction,
    loss: dict[str, Float[Tensor, " hand"]],
    *,
    has_sigma: bool = True,
) -> FittedHands:
    """Take what was found in the crops back to the images.

    Args:
        observed: The landmarks that the crops were cut about.
        crops: `to_crops(observed)`.
        prediction: In the crops, all right hands, on any device: of every hand, or of the usable ones alone,
            which then get their places among the others.
        loss: Value of every term for the same hands.
        has_sigma: Whether the prediction's σ was fitted.

    Raises:
        ValueError: There are neither as many predictions as hands nor as many as usable hands.
    """
    found, usable, hands = len(prediction.landmarks_3d), observed.usable, len(observed)
    if found not in (hands, int(usable.sum())):
        raise ValueError(
            f"{found} predictions for {hands} hands, {int(usable.sum())} of them usable; expected one for "
            "each, or one for each usable hand."
        )
    scale = torch.linalg.det(crops.matrices[:, :2, :2]).abs().sqrt()
    values = {name: value.detach().cpu() for name, value in loss.items()}
    if found < hands:
        prediction = _spread(prediction.to("cpu").detach(), usable)
        values = {name: _among(value, usable) for name, value in values.items()}
    return FittedHands(observed, uncrop_prediction(crops, prediction), values, scale, has_sigma)


def _spread(record: Record, places: Bool[Tensor, " hand"]) -> Record:
    """A record of some hands as one of all, NaN for the others."""
    changed: dict[str, Any] = {}
    for entry in dataclasses.fields(record):
        value = getattr(record, entry.name)
        if isinstance(value, HandParameters):
            changed[entry.name] = _spread(value, places)
        elif isinstance(value, Tensor):
            changed[entry.name] = _among(value, places)
    return dataclasses.replace(record, **changed)


def _among(values: Tensor, places: Bool[Tensor, " hand"]) -> Tensor:
    everywhere = values.new_full((len(places), *values.shape[1:]), torch.nan)
    everywhere[places] = values
    return everywhere


def entries(part: FittedHands) -> Iterator[dict[str, Any]]:
    """The entries of `fit.json`, rounded to what the numbers are worth."""
    found, parameters = part.prediction, part.prediction.parameters
    rows = {
        "landmarks_3d": _rounded(found.landmarks_3d, 7),
        "landmarks_2d": _rounded(found.landmarks_2d, 4),
        "joint_angles_degrees": _rounded(parameters.joint_angles.rad2deg(), 4),
        "shape": _rounded(parameters.shape, 5),
        "rotation": _rounded(parameters.root_rotation, 8),
        "translation": _rounded(parameters.translation, 7),
        "intrinsics": _rounded(found.intrinsics, 6),
        "sigma": _rounded(found.log_sigma.exp(), 4),
        "residual": _rounded(part.distance.nanmean(dim=1), 4),
    }
    loss = {name: _rounded(value, 6) for name, value in part.loss.items()}
    known = part.observed.intrinsics is not None
    for hand, (name, left, fitted) in enumerate(
        zip(part.observed.names, part.observed.left.tolist(), part.fitted.tolist(), strict=True)
    ):
        row = {key: values[hand] if fitted else None for key, values in rows.items()}
        camera = {key: row.pop(key) for key in ("rotation", "translation", "intrinsics")}
        entry = {"name": name, "side": "left" if left else "right", "fitted": fitted, **row}
        entry["sigma"] = entry["sigma"] if part.has_sigma else None
        entry["camera"] = {**camera, "known": known} if fitted else None
        entry["loss"] = {term: value[hand] for term, value in loss.items()} if fitted else None
        yield entry


def _rounded(values: Tensor, decimals: int) -> list[Any]:
    """Nested lists; a single number that is not finite is none."""
    array = values.double().numpy().round(decimals)
    if array.ndim > 1:
        return array.tolist()
    return [value if math.isfinite(value) else None for value in array.tolist()]
