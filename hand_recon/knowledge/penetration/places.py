"""Lists of fixed length for non-penetration on a GPU, and the number of vertices that had no place.

The poses decide how many vertices are near another part. A list whose length depends on them has to be
waited for; here its length depends on the number of hands, and places may stay empty (decision 99).
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Self

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from hand_recon.processes import process_group

logger = logging.getLogger(__name__)

LISTS: Final = ("candidates", "tested", "inside", "triangles")
"""Lists that may be too short, in the order in which they are made."""


@dataclass(frozen=True)
class Places:
    """Number of places in each list for each hand of a batch, which share them.

    Raises:
        ValueError: A number is not positive.
    """

    candidates: int = 128
    """Vertices within the bounds of a phalanx, and as many within those of the palm."""
    tested: int = 80
    """Vertices whose winding number is computed: as many for phalanges as for the palm."""
    inside: int = 64
    """Vertices inside another part, whose depth is computed."""
    triangles: int = 128
    """Triangles that may be the nearest of a vertex inside; not per hand but per vertex."""
    spare: int = 4
    """Hands for which there are places beyond those of the batch, since few hands may all be bad ones."""

    def __post_init__(self) -> None:
        """Refuse lists without a place."""
        if min(self.candidates, self.tested, self.inside, self.triangles) < 1 or self.spare < 0:
            raise ValueError(
                f"Found {self}; expected at least one place in each list and no negative spare. Leave "
                "places out for the measured numbers."
            )

    def of(self, name: str, hands: int) -> int:
        """Length of one of `LISTS` for a batch."""
        number: int = getattr(self, name)
        return number if name == "triangles" else number * (hands + self.spare)


@dataclass(frozen=True)
class Queries:
    """Pairs of a vertex and a part of its hand that may contain it, in places that may be empty."""

    hand: Int[Tensor, " place"]
    """Index of the hand."""
    vertex: Int[Tensor, " place"]
    """Index of the vertex in its hand."""
    part: Int[Tensor, " place"]
    """Index of the part."""
    bound: Float[Tensor, " place"]
    """Upper bound of the depth, in a unit that its maker names; zero or less for an empty place."""

    @classmethod
    def all_pairs(cls, bounds: Float[Tensor, "hand vertex part"], first: int) -> "Queries":
        """Every vertex of every hand with each of some consecutive parts.

        Args:
            bounds: Upper bound of the depth, zero or less where the vertex is not in the part.
            first: Index of the first of the parts.
        """
        _, vertices, parts = bounds.shape
        number = torch.arange(bounds.numel(), device=bounds.device)
        row = number // parts
        part = number - row * parts + first
        return cls(row // vertices, row % vertices, part, bounds.flatten())

    @classmethod
    def joined(cls, first: "Queries", second: "Queries") -> "Queries":
        """Places of one list, then those of another."""
        return cls(
            torch.cat([first.hand, second.hand]),
            torch.cat([first.vertex, second.vertex]),
            torch.cat([first.part, second.part]),
            torch.cat([first.bound, second.bound]),
        )

    def bounded(self, bound: Float[Tensor, " place"]) -> "Queries":
        """The same places with other bounds; an empty place stays empty."""
        bound = torch.where(self.bound > 0, bound, torch.zeros_like(bound))
        return Queries(self.hand, self.vertex, self.part, bound)

    def lots(self, size: int) -> list["Queries"]:
        """The places in lists of at most some length.

        Args:
            size: That length; at least one place is in a list.
        """
        columns = (self.hand, self.vertex, self.part, self.bound)
        split = [column.split(max(1, size)) for column in columns]
        return [Queries(*some) for some in zip(*split, strict=True)]

    def filled(self) -> Int[Tensor, ""]:
        """Number of places that are not empty."""
        return (self.bound > 0).sum()

    def deepest(self, count: int) -> "Queries":
        """The places with the largest bounds, in a list of another length.

        Args:
            count: Its length, if there are as many places.
        """
        bound, chosen = self.bound.topk(min(count, len(self.bound)))
        return Queries(self.hand[chosen], self.vertex[chosen], self.part[chosen], bound)


class LeftOut(nn.Module):
    """Counter, on the device, of what had no place, so that nothing is left out unnoticed."""

    def __init__(self) -> None:
        super().__init__()
        # No buffer: training in several processes gives all of them the buffers of the first.
        self._counts = torch.zeros(len(LISTS) + 1, dtype=torch.int64)

    def _apply(self, fn: Callable[[Tensor], Tensor], recurse: bool = True) -> Self:
        """Move the counter with the module."""
        self._counts = fn(self._counts)
        super()._apply(fn, recurse)  # type: ignore[no-untyped-call]
        return self

    def add(self, counts: list[Int[Tensor, ""]], hands: int) -> None:
        """Count a batch, without waiting for its numbers.

        Args:
            counts: What had no place in each of `LISTS`.
            hands: Number of hands of the batch.
        """
        self._counts[:-1].add_(torch.stack(counts))
        self._counts[-1].add_(hands)

    def take(self) -> tuple[dict[str, int], int]:
        """Numbers without a place since the last call, by list, and of hands; waits for the device.

        Both are sums over all processes that train together, and all have to call it.
        """
        *counts, hands = process_group.summed(self._counts).tolist()
        self._counts.zero_()
        return dict(zip(LISTS, counts, strict=True)), hands


def warn_of_left_out(module: nn.Module) -> None:
    """Log what had no place in the lists of a module's terms since the last call; waits for the device.

    Args:
        module: Anything that may have a `FixedSizeNonPenetration` in it.
    """
    for part in module.modules():
        if not isinstance(part, LeftOut):
            continue
        counts, hands = part.take()
        if any(counts.values()):
            found = ", ".join(f"{name} {count}" for name, count in counts.items())
            logger.warning(
                "Non-penetration had too few places for vertices near another part, and left out the least "
                "deep: %s, of %d hands. Set prior.non_penetration.sizes=by_pose, which leaves none out.",
                found,
                hands,
            )
