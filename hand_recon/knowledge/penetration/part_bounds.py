"""Bounds of the parts, a fast test for vertices that may be inside another part (Sec. 3.2, Eq. 4)."""

from typing import Final

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from hand_recon.knowledge.penetration.closed_parts import ClosedParts

_SLABS: Final = np.array(
    [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1], [1, 1, -1], [1, -1, 1], [1, -1, -1]], np.float32
)
"""Normals of the seven pairs of planes around a part: along the axes and the diagonals of space."""


class PartBounds(nn.Module):
    """Seven slabs around every part, tested against slabs of vertex groups, then against single vertices."""

    slabs: Tensor
    opponents: Tensor
    groups: Tensor
    suspects: Tensor

    def __init__(self, parts: ClosedParts) -> None:
        """List the pairs of a vertex group and a part that it can penetrate."""
        super().__init__()
        suspects = np.argwhere(parts.opponents[parts.groups].any(axis=1))
        for name, array in (
            ("slabs", _SLABS), ("opponents", parts.opponents),
            ("groups", parts.groups), ("suspects", suspects),
        ):  # fmt: skip
            self.register_buffer(name, torch.from_numpy(array), persistent=False)
        for part, triangles in enumerate(parts.faces):
            corners = torch.from_numpy(np.unique(triangles))
            self.register_buffer(f"corners_{part}", corners, persistent=False)
        self.count = len(parts.faces)

    def forward(
        self, points: Float[Tensor, "point hand 3"]
    ) -> tuple[Int[Tensor, " query"], Int[Tensor, " query"], list[int]]:
        """Indices of hand and vertex of all vertices within the bounds of a part that they can penetrate.

        Args:
            points: Vertices, then centres of the openings, metres.

        Returns:
            Hand, vertex, and number of queries of each part; the queries are sorted by part.
        """
        # For whole rows, `index_select` is several times as fast as indexing.
        heights = points @ self.slabs.to(points).T
        low, high = self._extents(heights)
        group, part = self.suspects.T
        rows = heights.flatten(1).index_select(0, self.groups.flatten())
        rows = rows.view(*self.groups.shape, *heights.shape[1:])
        overlap = rows.amin(dim=1).index_select(0, group) <= high.index_select(0, part)
        overlap &= rows.amax(dim=1).index_select(0, group) >= low.index_select(0, part)
        pair, hand = overlap.all(dim=-1).nonzero(as_tuple=True)
        vertex, part = self.groups[group[pair]], part[pair]
        row = vertex * heights.shape[1] + hand[:, None]
        height = (
            heights.flatten(0, 1).index_select(0, row.flatten()).view(*row.shape, heights.shape[-1])
        )
        within = height <= high[part, hand][:, None]
        within &= height >= low[part, hand][:, None]
        wanted = within.all(dim=-1) & self.opponents[vertex, part[:, None]]
        row, member = wanted.nonzero(as_tuple=True)
        by_part = part[row].argsort()
        row, member = row[by_part], member[by_part]
        counts = torch.bincount(part[row], minlength=self.count).tolist()
        return hand[row], vertex[row, member], counts

    def _extents(
        self, heights: Float[Tensor, "point hand slab"]
    ) -> tuple[Float[Tensor, "part hand slab"], Float[Tensor, "part hand slab"]]:
        """Smallest and largest height of each part along each normal, metres."""
        of_parts = [
            heights.index_select(0, self.get_buffer(f"corners_{part}"))
            for part in range(self.count)
        ]
        return (
            torch.stack([some.amin(dim=0) for some in of_parts]),
            torch.stack([some.amax(dim=0) for some in of_parts]),
        )
