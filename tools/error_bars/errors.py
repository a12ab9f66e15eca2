"""Errors of fitted landmarks from the hand's root beside the covariances of Laplace's approximation."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Self

import torch
from jaxtyping import Float
from torch import Tensor

from depth.methods import Method, run
from depth.sets import DepthSet
from hand_recon.evaluation.calibration_3d import Calibration3D
from hand_recon.hand.skeleton import LANDMARKS, ROOT_LANDMARK
from hand_recon.uncertainty.covariance_correction import CovarianceCorrection

MEASURED: Final = tuple(place for place in range(len(LANDMARKS)) if place != ROOT_LANDMARK)
"""Landmarks that have an error: the root is the ground truth's origin."""

Correction = Callable[[Tensor, Tensor], Tensor]
"""From covariances and origins to covariances."""


@dataclass(frozen=True)
class Errors:
    """Errors of the hands of a set, with what a correction takes."""

    name: str
    """Name of the set."""
    error: Float[Tensor, "hand landmark=21 3"]
    """Position from the hand's origin minus that of the ground truth from its root, camera's axes, metres."""
    laplace: Float[Tensor, "hand landmark=21 3 3"]
    """Covariances without a correction, square metres."""
    origin: Float[Tensor, "hand 3"]
    """Origins of the fitted hands, camera frame, metres."""
    groups: tuple[str, ...]
    """Group of each hand, for intervals."""

    @classmethod
    def of(cls, hands: DepthSet, overrides: tuple[str, ...] = ()) -> Self:
        """Fit a set by default, and compare it with its ground truth.

        Args:
            hands: The set.
            overrides: Overrides of `conf/fit.yaml`.

        Raises:
            ValueError: The fit gives no covariances.
        """
        found = run(Method("default", ("descent.error_bars=laplace", *overrides)), hands, alone=0)
        covariances = [part.prediction.covariance_3d for part in found.parts]
        known = [one for one in covariances if one is not None]
        if len(known) < len(covariances):
            raise ValueError(
                f"The fit of {hands.name} gives no covariances; expected a likelihood and a prior that "
                "bounds every angle. Leave out the overrides that change them."
            )
        origin = torch.cat([part.prediction.parameters.translation for part in found.parts])
        truth = hands.ground_truth - hands.ground_truth[:, ROOT_LANDMARK, None]
        return cls(
            hands.name,
            found.landmarks_3d - origin.double()[:, None] - truth,
            torch.cat(known).double(),
            origin.double(),
            hands.groups,
        )

    def __len__(self) -> int:
        return len(self.error)

    def covariance(
        self, correction: CovarianceCorrection | None
    ) -> Float[Tensor, "hand landmark=21 3 3"]:
        """Corrected covariances, square metres; without a correction those of Laplace."""
        return self.laplace if correction is None else correction(self.laplace, self.origin)

    def scores(self, covariance: Float[Tensor, "hand landmark=21 3 3"]) -> dict[str, float]:
        """Calibration of covariances of these hands, as `Calibration3D` gives it."""
        known = torch.zeros(self.error.shape[:2], dtype=torch.bool)
        known[:, MEASURED] = True
        metric = Calibration3D()
        metric.update(self.error, covariance, known, torch.arange(len(self)))
        return metric.compute()
