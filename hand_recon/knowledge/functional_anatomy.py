"""Functional anatomy: ranges of motion that depend on the angles of other joints (Sec. 3.2, Eq. 2–3).

Eq. 2–3 are rules from a pose to narrower ranges, which Eq. 1 then uses in place of the table's. The text and
the authors' code differ, so there are variants; `docs/ranges.md` has them side by side.
"""

import math
from dataclasses import dataclass
from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.hand.skeleton import ARTICULATED, AXES
from hand_recon.knowledge.ranges import RangeOfMotion

Driver = Float[Tensor, "*batch joint"]
"""Angles of some joints about one axis, on which the ranges of another axis depend, radians."""

VARIANTS: Final[tuple[str, ...]] = ("paper", "printed", "release")
"""Readings of Eq. 2–3: the paper's text, the formula to the letter, and the authors' released code."""

RELEASE_LIMIT: Final = math.radians(70)
"""Flexion at which the released code, linearly, leaves no splay, radians."""

_BEND, _SPLAY = AXES.index("bend"), AXES.index("splay")
# Slices, since a list of indices would be copied to a GPU, and waited for, at each use.
_MCP, _PIP, _DIP = (
    slice(ARTICULATED.index(f"index {level}"), ARTICULATED.index("thumb CMC"), 3)
    for level in ("MCP", "PIP", "DIP")
)
"""A joint of each of the four fingers, which have three each."""
_CMC: Final = slice(ARTICULATED.index("thumb CMC"), ARTICULATED.index("thumb CMC") + 1)


@dataclass(frozen=True)
class FunctionalAnatomy:
    """The rules that narrow the ranges, and their variant.

    Raises:
        ValueError: The variant is unknown.
    """

    splay_by_bend: bool = True
    """Type (i), Eq. 2: the farther an MCP is bent, the less it can splay."""
    bend_by_splay: bool = False
    """The reverse, also in the text: the farther an MCP is splayed, the less it can bend. Off by default: it
    forbids the same poses as `splay_by_bend`, measured in bend, and costs accuracy (decision 24)."""
    pip_by_dip: bool = True
    """Type (ii), Eq. 3: a PIP does not overstretch while its DIP is flexed."""
    thumb_cmc: bool = True
    """Type (i) at the thumb, in the released code only: a flexed CMC cannot abduct."""
    variant: str = "paper"
    """One of `VARIANTS`."""

    def __post_init__(self) -> None:
        """Refuse an unknown variant."""
        if self.variant not in VARIANTS:
            raise ValueError(
                f"Unknown variant of functional anatomy {self.variant!r}, expected one of {VARIANTS}."
            )

    def refine(
        self, ranges: RangeOfMotion, joint_angles: Float[Tensor, "*batch joint=15 axis=3"]
    ) -> RangeOfMotion:
        """The ranges of each pose: one set per hand, never wider than the table's.

        The bounds have no gradient. Otherwise Eq. 1 could be reduced by a pose that widens its own bounds.

        Args:
            ranges: The table's bounds, one set for all hands or one per hand.
            joint_angles: Bend, splay and twist of each joint, radians.
        """
        angles = joint_angles.detach()
        lower, upper, angles = torch.broadcast_tensors(
            ranges.lower.to(angles), ranges.upper.to(angles), angles
        )
        base = RangeOfMotion(lower, upper)
        # Inside the table's ranges the shares below stay within 0 and 1.
        inside = base.clamp(angles)
        refined = RangeOfMotion(lower.clone(), upper.clone())
        if self.splay_by_bend:
            self._narrow(refined, base, inside, (_MCP, _BEND, _SPLAY))
        if self.bend_by_splay and self.variant != "release":
            self._narrow(refined, base, inside, (_MCP, _SPLAY, _BEND))
        if self.thumb_cmc:
            self._narrow(refined, base, inside, (_CMC, _BEND, _SPLAY))
        if self.pip_by_dip:
            self._straighten(refined, base, angles)
        return refined

    def _narrow(
        self,
        refined: RangeOfMotion,
        base: RangeOfMotion,
        inside: Float[Tensor, "*batch joint=15 axis=3"],
        rule: tuple[slice, int, int],
    ) -> None:
        """Scale the bounds of one axis of some joints by the shares that another axis leaves; in place."""
        joints, driver, driven = rule
        shares = self._remaining_shares(
            inside[..., joints, driver],
            base.lower[..., joints, driver],
            base.upper[..., joints, driver],
            thumb=joints == _CMC,
        )
        lower, upper = base.lower[..., joints, driven], base.upper[..., joints, driven]
        # Clamped, so that a range without zero keeps lower ≤ upper: both ends go to the bound nearest zero.
        refined.lower[..., joints, driven] = (lower * shares[0]).clamp(lower, upper)
        refined.upper[..., joints, driven] = (upper * shares[1]).clamp(lower, upper)

    def _remaining_shares(
        self, angle: Driver, lower: Driver, upper: Driver, *, thumb: bool
    ) -> tuple[Driver, Driver]:
        """Remaining shares of the lower and the upper bound of the other axis, 0 to 1."""
        if self.variant == "release":
            left = 1 - angle.clamp(0, RELEASE_LIMIT) / RELEASE_LIMIT
            return left, left
        left = 1 - _share_of_bound(angle, lower, upper)
        flexed = torch.where(angle > 0, left, 1)
        if thumb:
            # A flexed thumb can still adduct into the palm, so only its abduction is limited.
            return torch.ones_like(left), flexed
        return (
            (left, left) if self.variant == "paper" else (torch.where(angle < 0, left, 1), flexed)
        )

    def _straighten(
        self,
        refined: RangeOfMotion,
        base: RangeOfMotion,
        angles: Float[Tensor, "*batch joint=15 axis=3"],
    ) -> None:
        """Raise the lower bound of the PIPs to straight where the DIPs are flexed (Eq. 3)."""
        # The released code tests the DIP's lower bound, not its angle, and no table has that above zero.
        driver = base.lower if self.variant == "release" else angles
        flexed = driver[..., _DIP, _BEND] > 0
        lower, upper = base.lower[..., _PIP, _BEND], base.upper[..., _PIP, _BEND]
        straight = torch.zeros_like(lower).clamp(lower, upper)
        refined.lower[..., _PIP, _BEND] = torch.where(flexed, straight, lower)


def _share_of_bound(angle: Driver, lower: Driver, upper: Driver) -> Driver:
    """Angle as a share of the bound on its side of zero: 0 at zero, 1 at either bound.

    Zero where that bound is zero, in place of 0/0.
    """
    limit = torch.where(angle > 0, upper, lower)
    return angle / torch.where(limit == 0, 1, limit)
