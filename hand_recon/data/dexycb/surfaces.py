"""DexYCB's surfaces, computed by MANO from the labels, for evaluation (Sec. 4.1).

Two conventions are in use. `official` poses a left hand with MANO's left hand as it was released, which is
how the labels were made (dex-ycb-toolkit issue 28). `mirror_right` mirrors the pose and takes the right hand
with the same shape, as H2ONet does; the release's left shape directions are not the mirrored ones, so the
two differ on left hands.
"""

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from hand_recon.hand.axis_angle import mirror_axis_angle
from hand_recon.hand.mano.labels import dexycb_parameters
from hand_recon.hand.mano.layer import ManoLayer, ManoParameters
from hand_recon.hand.mano.store import Side
from hand_recon.schema import HandParameters

logger = logging.getLogger(__name__)

GT_MODES: Final = ("official", "mirror_right")
"""Constructions of left hands' surfaces."""

_CHUNK: Final = 4096
"""Number of hands whose parameters are computed at a time."""


@dataclass(frozen=True)
class ManoPair:
    """MANO's right and left hand in the conventions of DexYCB's labels."""

    right: ManoLayer
    """Right hand, also used for mirrored left hands."""
    left: ManoLayer | None
    """Left hand with the shape directions of the release; None where there are no left hands."""

    def parameters(
        self,
        pose_m: Float[Tensor, "*batch number=51"],
        betas: Float[Tensor, "*batch direction=10"],
        left: bool,
    ) -> ManoParameters:
        """MANO's parameters of hands of one side, for the layer of that side."""
        return dexycb_parameters(self.layer(left), pose_m, betas)

    def mirrored(
        self,
        pose_m: Float[Tensor, "*batch number=51"],
        betas: Float[Tensor, "*batch direction=10"],
        left: bool,
    ) -> ManoParameters:
        """MANO's parameters for the right layer, with left hands mirrored in x.

        Rotations become (x, −y, −z) as axis angles; coefficients of pose components have no such rule.
        """
        own = self.parameters(pose_m, betas, left)
        if not left:
            return own
        pose = mirror_axis_angle(own.pose.unflatten(-1, (15, 3))).flatten(-2)
        flip = own.translation.new_tensor([-1.0, 1.0, 1.0])
        return ManoParameters(
            mirror_axis_angle(own.global_rotation), pose, own.shape, flip * own.translation
        )

    def layer(self, left: bool) -> ManoLayer:
        """The hand of one side.

        Raises:
            ValueError: The left hand is needed but was not loaded.
        """
        if not left:
            return self.right
        if self.left is None:
            raise ValueError("MANO's left hand was not loaded, but there are left hands.")
        return self.left


class DexYcbSurfaces:
    """Function from a row to its ground truth vertices, camera frame, metres, not mirrored."""

    def __init__(
        self,
        mano: ManoPair,
        pose_m: Float[np.ndarray, "row number=51"],
        betas: Float[np.ndarray, "row direction=10"],
        left: Bool[np.ndarray, " row"],
        gt_mode: str = "official",
    ) -> None:
        """Store the labels; surfaces are computed on request."""
        self.mano = mano
        self.pose_m = pose_m
        self.betas = betas
        self.left = left
        self.mirror = gt_mode == "mirror_right"

    def __call__(self, row: int) -> Float[np.ndarray, "vertex 3"]:
        """The surface of a hand."""
        pose_m, betas = (
            torch.from_numpy(array[row]).float() for array in (self.pose_m, self.betas)
        )
        left = bool(self.left[row])
        with torch.no_grad():
            if left and self.mirror:
                vertices = self.mano.right(*self.mano.mirrored(pose_m, betas, left)).vertices
                vertices = vertices * vertices.new_tensor([-1.0, 1.0, 1.0])
            else:
                vertices = self.mano.layer(left)(
                    *self.mano.parameters(pose_m, betas, left)
                ).vertices
        return np.asarray(vertices.numpy())

    def __len__(self) -> int:
        return len(self.pose_m)

    def select(self, rows: Int[np.ndarray, " row"]) -> "DexYcbSurfaces":
        """Surfaces of some rows."""
        mode = "mirror_right" if self.mirror else "official"
        return DexYcbSurfaces(self.mano, self.pose_m[rows], self.betas[rows], self.left[rows], mode)

    def parameters(self) -> HandParameters:
        """All hands as right ones in this project's parameters."""
        sides = []
        order = [np.flatnonzero(~self.left), np.flatnonzero(self.left)]
        for left, rows in zip((False, True), order, strict=True):
            for chunk in np.array_split(rows, max(1, -(-len(rows) // _CHUNK))):
                pose_m, betas = (
                    torch.from_numpy(array[chunk]).float() for array in (self.pose_m, self.betas)
                )
                if len(chunk):
                    own = self.mano.mirrored(pose_m, betas, left)
                    sides.append(self.mano.right.hand_parameters(*own))
        back = np.argsort(np.concatenate(order))
        return HandParameters.join(sides).select(torch.from_numpy(back))


def load_pair(folder: Path | str | None, left_hands: bool) -> ManoPair | None:
    """Load MANO's hands from the user's folder; None, with a warning, if they are missing.

    Args:
        folder: Folder that `hand_recon.prepare mano` filled.
        left_hands: Load the left hand too.
    """
    if folder is None:
        logger.warning(
            "DexYCB stores no surfaces, and data.mano names no folder of MANO to make them with: vertex "
            "metrics are left out."
        )
        return None
    try:
        right = _load(folder, "right")
        return ManoPair(right, _load(folder, "left") if left_hands else None)
    except FileNotFoundError as error:
        logger.warning(
            "DexYCB stores no surfaces; MANO makes them, and is not there: vertex metrics are left out. %s",
            error,
        )
        return None


def _load(folder: Path | str, side: Side) -> ManoLayer:
    return ManoLayer.load(folder, side, "dexycb", fix_left_shape=False)
