"""Reconstructed hands as they are drawn over their photograph and saved as meshes."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from hand_recon.fitting.hand_records import HandRecords
from hand_recon.rendering.mesh_files import NamedMesh, write_meshes
from hand_recon.visualization.hand_overlay import DrawnHand, OverlayStyle

PHOTO_STYLE: Final = OverlayStyle(smallest=480)
"""Drawings have the resolution of their photographs; smaller ones are enlarged to this many pixels."""


def drawn_hand(
    records: HandRecords, vertices: Float[np.ndarray, "hand vertex 3"], hand: int, label: str
) -> DrawnHand:
    """One hand as it is drawn over its photograph.

    Args:
        records: The hands.
        vertices: Their meshes, camera frame, metres.
        hand: Index of the hand.
        label: Text beside it.
    """
    sigma, covariance = records.sigma_2d[hand], records.covariance_3d[hand]
    return DrawnHand(
        vertices=vertices[hand].astype(np.float64),
        landmarks_2d=records.landmarks_2d[hand],
        given_2d=records.observed_2d[hand],
        sigma_2d=None if np.isnan(sigma).all() else sigma,
        intrinsics=records.intrinsics[hand],
        side=records.sides[hand],
        label=label,
        doubtful=records.verdicts[hand] == "doubtful",
        landmarks_3d=records.landmarks_3d[hand],
        covariance_3d=None if np.isnan(covariance).all() else covariance,
    )


def save_meshes(
    path: Path,
    vertices: Float[np.ndarray, "hand vertex 3"],
    sides: Sequence[str],
    faces: Int[np.ndarray, "face 3"],
) -> None:
    """Write the meshes of hands to one file.

    Args:
        path: The file; its suffix is the format, `.obj`, `.ply` or `.glb`.
        vertices: Vertices, camera frame, metres.
        sides: Side of each hand.
        faces: Triangles of either hand, in either winding.
    """
    meshes = [
        NamedMesh(f"{side} hand", points.astype(np.float64), faces)
        for points, side in zip(vertices, sides, strict=True)
    ]
    write_meshes(path, meshes)
