"""Parts of the hand in tables of equal rows, and their bounds, for lists of fixed length (decision 99)."""

import math
from typing import Final

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from hand_recon.knowledge.penetration.closed_parts import PALM_PART, ClosedParts

_DIRECTIONS: Final = 16
"""Pairs of parallel planes around each part; with seven, up to twice as many vertices are within."""


def equal_rows(rows: list[Int[np.ndarray, "..."]]) -> Int[np.ndarray, "..."]:
    """Rows of one length; a short row repeats its first entry at the end."""
    length = max(map(len, rows))
    return np.stack(
        [np.concatenate([row, np.repeat(row[:1], length - len(row), axis=0)]) for row in rows]
    )


def closed_rows(parts: ClosedParts) -> Int[np.ndarray, "phalanx face corner=3"]:
    """Triangles of each closed phalanx, in rows of one length.

    A short row ends with triangles whose corners are one vertex, which have no solid angle.
    """
    phalanges = [faces for part, faces in enumerate(parts.faces) if part != PALM_PART]
    length = max(map(len, phalanges))
    nothing = [np.broadcast_to(faces[0, 0], (length - len(faces), 3)) for faces in phalanges]
    return np.stack(
        [np.concatenate([faces, rest]) for faces, rest in zip(phalanges, nothing, strict=True)]
    )


def skin_rows(parts: ClosedParts) -> Int[np.ndarray, "phalanx face"]:
    """Indices of the triangles of each phalanx in the skin, in rows of one length."""
    return equal_rows(
        [
            np.flatnonzero(parts.part_of_face == part)
            for part in range(len(parts.faces))
            if part != PALM_PART
        ]
    )


def directions() -> Float[np.ndarray, "direction 3"]:
    """Unit vectors in pairs of opposites, evenly over the sphere."""
    number = np.arange(_DIRECTIONS) + 0.5
    height, angle = 1 - number / _DIRECTIONS, number * math.pi * (3 - math.sqrt(5))
    radius = np.sqrt(1 - height**2)
    half = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)
    return np.concatenate([half, -half]).astype(np.float32)


class PartPlanes(nn.Module):
    """Planes around every part, the same for all poses in number and direction."""

    normals: Tensor
    opponents: Tensor

    def __init__(self, parts: ClosedParts) -> None:
        """List the corners of each part."""
        super().__init__()
        self.count = len(parts.faces)
        self.register_buffer("normals", torch.from_numpy(directions()), persistent=False)
        self.register_buffer("opponents", torch.from_numpy(parts.opponents), persistent=False)
        for part, triangles in enumerate(parts.faces):
            corners = torch.from_numpy(np.unique(triangles))
            self.register_buffer(f"corners_{part}", corners, persistent=False)

    def forward(self, points: Float[Tensor, "hand point 3"]) -> Float[Tensor, "hand vertex part"]:
        """Distance of each vertex to the nearest plane around each part, metres.

        It is no smaller than the distance to the closed part's surface for a vertex inside, and zero for a
        vertex that is outside or cannot penetrate the part.

        Args:
            points: Vertices, then centres of the openings, metres.
        """
        heights = points @ self.normals.to(points).T
        margins = []
        for part in range(self.count):
            corners = heights.index_select(1, self.get_buffer(f"corners_{part}"))
            within = corners.amax(dim=1, keepdim=True) - heights[:, : len(self.opponents)]
            margins.append(within.amin(dim=-1))
        margin = torch.stack(margins, dim=-1)
        # No number is above zero if a vertex is no number.
        return torch.where((margin > 0) & self.opponents, margin, torch.zeros_like(margin))
