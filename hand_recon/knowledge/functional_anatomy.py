"""Functional anatomy: where one joint is decides how far another can go (Sec. 3.2, Eq. 2–3).

Eq. 2–3 are rules from a pose to narrower ranges; Eq. 1 then takes those instead of the table's. The text
and the authors' code differ, so there are variants; `docs/ranges.md` has them side by side.
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
"""Angles of the joints that a rule looks at, one axis, radians."""

VARIANTS: Final[tuple[str, ...]] = ("paper", "printed", "release")
"""Eq. 2 as the text describes it, Eq. 2 to the letter, and the code released with the paper."""

RELEASE_LIMIT: Final = math.radians(70)
"""The released code closes splay linearly until every joint is flexed by this much."""

_BEND, _SPLAY = AXES.index("bend"), AXES.index("splay")
_MCP, _PIP, _DIP = (
    [
        place
        for place, joint in enumerate(ARTICULATED)
        if joint.endswith(level) and not joint.startswith("thumb")
    ]
    for level in ("MCP", "PIP", "DIP")
)
_CMC: Final = [ARTICULATED.index("thumb CMC")]


@dataclass(frozen=True)
class FunctionalAnatomy:
    """Which rules narrow the ranges, and in whose reading.

    Raises:
        ValueError: The variant is unknown.
    """

    splay_by_bend: bool = True
    """Type (i), Eq. 2: the farther an MCP is bent, the less it can splay."""
    bend_by_splay: bool = False
    """The reverse that the text asks for: the farther an MCP is splayed, the less it can bend. Off: it
    forbids what `splay_by_bend` forbids, in degrees of bend, and costs accuracy (decision 24)."""
    pip_by_dip: bool = True
    """Type (ii), Eq. 3: a PIP does not overstretch while its DIP is flexed."""
    thumb_cmc: bool = True
    """Type (i) at the thumb, which only the released code has: the CMC flexed cannot abduct."""
    variant: str = "paper"
    """One of `VARIANTS`."""

    def __post_init__(self) -> None:
        """Check what a configuration asks for."""
        if self.variant not in VARIANTS:
            raise ValueError(
                f"Unknown variant of functional anatomy {self.variant!r}, expected one of {VARIANTS}."
            )

    def refine(
        self, ranges: RangeOfMotion, joint_angles: Float[Tensor, "*batch joint=15 axis=3"]
    ) -> RangeOfMotion:
        """The ranges that hold in a pose: one set per hand, never wider than the table's.

        The bounds are constants to the gradient. Else Eq. 1 could be reduced by bending a finger out of
        the way of its own bounds.

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
        rule: tuple[list[int], int, int],
    ) -> None:
        """Shrink the bounds of one axis of some joints by the room that another axis leaves them."""
        joints, driver, driven = rule
        rooms = self._rooms(
            inside[..., joints, driver],
            base.lower[..., joints, driver],
            base.upper[..., joints, driver],
            thumb=joints == _CMC,
        )
        lower, upper = base.lower[..., joints, driven], base.upper[..., joints, driven]
        # A table whose range does not contain zero keeps its order: the ends meet at the nearest bound.
        refined.lower[..., joints, driven] = (lower * rooms[0]).clamp(lower, upper)
        refined.upper[..., joints, driven] = (upper * rooms[1]).clamp(lower, upper)

    def _rooms(
        self, angle: Driver, lower: Driver, upper: Driver, *, thumb: bool
    ) -> tuple[Driver, Driver]:
        """What is left of the lower and of the upper bound of the other axis, from 0 to 1."""
        if self.variant == "release":
            left = 1 - angle.clamp(0, RELEASE_LIMIT) / RELEASE_LIMIT
            return left, left
        left = 1 - _way_to_limit(angle, lower, upper)
        flexed = torch.where(angle > 0, left, 1)
        if thumb:
            # A flexed thumb lies in the palm as readily as anywhere: only its abduction closes.
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
        # The released code asks the DIP's lower limit, not its angle; no table has that above zero.
        asked = base.lower if self.variant == "release" else angles
        flexed = asked[..., _DIP, _BEND] > 0
        lower, upper = base.lower[..., _PIP, _BEND], base.upper[..., _PIP, _BEND]
        straight = torch.zeros_like(lower).clamp(lower, upper)
        refined.lower[..., _PIP, _BEND] = torch.where(flexed, straight, lower)


def _way_to_limit(angle: Driver, lower: Driver, upper: Driver) -> Driver:
    """Where an angle is between zero and the limit on its side: 0 at zero, 1 at either limit.

    An axis without freedom on one side cannot be on the way anywhere: zero there, not 0/0.
    """
    limit = torch.where(angle > 0, upper, lower)
    return angle / torch.where(limit == 0, 1, limit)
