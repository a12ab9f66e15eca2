"""Hands that were fitted to 2D landmarks, in the frame of their own images."""

import dataclasses
from dataclasses import dataclass
from typing import Any, TypeVar

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hand_recon.data.landmarks.crops import LandmarkCrops, uncrop_prediction
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.fitting.origin import Origin
from hand_recon.schema import HandParameters, HandPrediction

Record = TypeVar("Record", HandParameters, HandPrediction)


@dataclass(frozen=True)
class FittedHands:
    """Hands that were fitted to landmarks, on the CPU and in their images: left hands are left hands."""

    observed: ImageLandmarks
    """The given landmarks."""
    prediction: HandPrediction
    """The hands, camera frame and pixels of the image, as `uncrop_prediction` returns them."""
    loss: dict[str, Float[Tensor, " hand"]]
    """Value of every term of the objective."""
    scale: Float[Tensor, " hand"]
    """Pixels of the 224-pixel crop per pixel of the image."""
    has_sigma: bool = True
    """True if the prediction's σ is its own; false if it is that of the landmarks, or a placeholder."""
    origins: tuple[Origin, ...] = ()
    """Origin of each hand; by default from landmarks without further information."""

    def __post_init__(self) -> None:
        if not self.origins:
            camera = "assumed" if self.observed.intrinsics is None else "given"
            found = tuple(
                Origin(image=None if file is None else file.name, camera=camera)
                for file in self.observed.images
            )
            object.__setattr__(self, "origins", found)
        if len(self.origins) != len(self.observed):
            raise ValueError(
                f"Found {len(self.origins)} origins of {len(self.observed)} hands; expected one per hand."
            )

    def __len__(self) -> int:
        return len(self.observed)

    @property
    def fitted(self) -> Bool[Tensor, " hand"]:
        """Mask of the hands that had enough landmarks, and whose landmarks came out finite."""
        found = self.prediction
        numbers = torch.cat([found.landmarks_3d.flatten(1), found.landmarks_2d.flatten(1)], dim=1)
        return self.observed.usable & numbers.isfinite().all(dim=1)

    @property
    def sigma_2d(self) -> Float[Tensor, "hand landmark=21 2"]:
        """σ of each coordinate as the fit used it, pixels of the image; NaN for hands without any.

        A hand has σ if one of its landmarks was given with σ or a confidence, or if it is the prediction's.
        """
        sigma = self.prediction.log_sigma.exp()
        if self.has_sigma:
            return sigma
        known = torch.zeros(len(self), dtype=torch.bool)
        for given in (self.observed.sigma, self.observed.confidence):
            if given is not None:
                known |= (given.isfinite() & self.observed.labelled).any(dim=1)
        return sigma.masked_fill(~known[:, None, None], torch.nan)

    @property
    def distance(self) -> Float[Tensor, "hand landmark=21"]:
        """Distance of each projection to the given landmark, pixels of the image; NaN without one."""
        distance = (self.prediction.landmarks_2d - self.observed.landmarks_2d).norm(dim=-1)
        given = self.observed.labelled & self.fitted[:, None]
        return torch.where(given, distance, torch.nan)


def fitted_hands(
    observed: ImageLandmarks,
    crops: LandmarkCrops,
    prediction: HandPrediction,
    loss: dict[str, Float[Tensor, " hand"]],
    *,
    has_sigma: bool = True,
    origins: tuple[Origin, ...] = (),
) -> FittedHands:
    """Transform hands that were fitted in crops back to their images.

    Args:
        observed: The landmarks that the crops were cut about.
        crops: `to_crops(observed)`.
        prediction: Hands in the crops, all right hands, on any device: one for every observed hand, or one
            for every usable hand, in order.
        loss: Value of every term for the same hands.
        has_sigma: True if the prediction's σ is its own.
        origins: Origin of each observed hand; none for landmarks without further information.

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
        prediction = _with_missing(prediction.to("cpu").detach(), usable)
        values = {name: _with_missing_rows(value, usable) for name, value in values.items()}
    return FittedHands(
        observed, uncrop_prediction(crops, prediction), values, scale, has_sigma, origins
    )


def _with_missing(record: Record, present: Bool[Tensor, " hand"]) -> Record:
    """Expand a record of the hands that a mask selects to all hands, NaN for the others."""
    changed: dict[str, Any] = {}
    for entry in dataclasses.fields(record):
        value = getattr(record, entry.name)
        if isinstance(value, HandParameters):
            changed[entry.name] = _with_missing(value, present)
        elif isinstance(value, Tensor):
            changed[entry.name] = _with_missing_rows(value, present)
    return dataclasses.replace(record, **changed)


def _with_missing_rows(values: Tensor, present: Bool[Tensor, " hand"]) -> Tensor:
    expanded = values.new_full((len(present), *values.shape[1:]), torch.nan)
    expanded[present] = values
    return expanded
