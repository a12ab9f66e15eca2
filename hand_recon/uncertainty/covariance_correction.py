"""Correction of the 3D covariances of a fit, measured where the ground truth is known (decision 83).

Laplace's approximation has the noise of the landmarks and the prior. It does not have that no shape of the
hand model is the hand, that σ is given too small, and that minima are missed. Per group of landmarks, the
correction scales it and adds variance across the line of sight and along it; factors of the ellipsoids
account for errors whose distribution is no Gaussian.
"""

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final, Self

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.hand.skeleton import LANDMARKS

TABLE: Final = Path(__file__).with_name("error_bars.json")
"""The shipped corrections, written by `tools/measure_error_bars.py`."""

LAPLACE: Final = "laplace"
"""Name for covariances without a correction."""

LEVELS: Final = (0.50, 0.80, 0.95)
"""Coverages for which factors were measured."""


@dataclass(frozen=True)
class CovarianceCorrection:
    """Corrected covariance Σ = s² Σ₀ + a² (I − d dᵀ) + b² d dᵀ of each landmark, d the line of sight."""

    scale: Float[Tensor, " landmark=21"]
    """Factor s of the standard deviations of Laplace's approximation Σ₀."""
    across: Float[Tensor, " landmark=21"]
    """Added standard deviation a along each axis across the line of sight, metres."""
    depth: Float[Tensor, " landmark=21"]
    """Added standard deviation b along the line of sight, metres."""
    factors: Float[Tensor, "landmark=21 level=3"]
    """Factors of Σ with which a Gaussian's ellipsoids of `LEVELS` have held these shares of the errors."""

    @classmethod
    def of_groups(cls, groups: list[dict[str, Any]]) -> Self:
        """Correction of a table.

        Args:
            groups: Groups of landmarks, each with `landmarks` (names), `scale`, `across_mm`, `depth_mm` and
                `factors`.

        Raises:
            ValueError: A landmark is in no group or in two.
        """
        named = [name for group in groups for name in group["landmarks"]]
        if sorted(named) != sorted(LANDMARKS):
            raise ValueError(
                f"Found the landmarks {', '.join(named)} in the groups of a correction; expected each of the "
                "21 once. Write the table again with tools/measure_error_bars.py."
            )
        row = {name: group for group in groups for name in group["landmarks"]}

        def column(key: str, unit: float = 1.0) -> Tensor:
            values = [row[name][key] for name in LANDMARKS]
            return unit * torch.tensor(values, dtype=torch.float64)

        return cls(
            column("scale"),
            column("across_mm", 1e-3),
            column("depth_mm", 1e-3),
            column("factors"),
        )

    def __call__(
        self,
        covariance: Float[Tensor, "hand landmark=21 3 3"],
        origin: Float[Tensor, "hand 3"],
    ) -> Float[Tensor, "hand landmark=21 3 3"]:
        """Correct Laplace's covariances.

        Args:
            covariance: Σ₀ of each landmark, axes of a camera, square metres.
            origin: Origin of each hand in that camera's frame, metres; the line of sight is towards it.
        """
        scale, added = self._parts(covariance, origin)
        return scale.square() * covariance + added

    def laplace_of(
        self,
        corrected: Float[Tensor, "hand landmark=21 3 3"],
        origin: Float[Tensor, "hand 3"],
    ) -> Float[Tensor, "hand landmark=21 3 3"]:
        """Laplace's covariances from corrected ones, such as those of a file of hands.

        Args:
            corrected: Σ of each landmark, axes of a camera, square metres.
            origin: Origin of each hand in that camera's frame, metres.
        """
        scale, added = self._parts(corrected, origin)
        return (corrected - added) / scale.square()

    def region(
        self, corrected: Float[Tensor, "*batch landmark=21 3 3"], level: float
    ) -> Float[Tensor, "*batch landmark=21 3 3"]:
        """Matrices whose Gaussian ellipsoid of a level has held this share of the measured errors.

        Args:
            corrected: Σ of each landmark.
            level: One of `LEVELS`.

        Raises:
            ValueError: No factor was measured for the level.
        """
        if level not in LEVELS:
            raise ValueError(
                f"Found the level {level}; expected one of {', '.join(map(str, LEVELS))}, for which factors "
                "were measured."
            )
        return self.factors[:, LEVELS.index(level), None, None].to(corrected) * corrected

    def _parts(self, covariance: Tensor, origin: Tensor) -> tuple[Tensor, Tensor]:
        """Factor s and the added covariance, in the kind of numbers of a covariance."""
        sight = torch.nn.functional.normalize(origin, dim=-1).to(covariance)
        along = (sight[:, :, None] * sight[:, None, :])[:, None]
        scale, across, depth = (
            values.to(covariance)[:, None, None] for values in (self.scale, self.across, self.depth)
        )
        eye = torch.eye(3, dtype=covariance.dtype, device=covariance.device)
        return scale, across.square() * (eye - along) + depth.square() * along


@cache
def correction_named(name: str, table: Path = TABLE) -> CovarianceCorrection | None:
    """Correction of a name; None for `laplace`, which is without one.

    Args:
        name: Name in the table, or `LAPLACE`.
        table: File of corrections.

    Raises:
        ValueError: There is no correction of that name.
    """
    if name == LAPLACE:
        return None
    corrections = json.loads(table.read_text(encoding="utf-8"))["corrections"]
    if name not in corrections:
        raise ValueError(
            f"Found error_bars={name}; expected one of {', '.join([*corrections, LAPLACE])}."
        )
    return CovarianceCorrection.of_groups(corrections[name]["groups"])
