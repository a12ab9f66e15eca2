"""Surfaces and parameters of HO3D's training hands, from the metas' MANO parameters and the user's MANO."""

import logging
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.data.ho3d.annotations import Annotations
from hand_recon.hand.mano.labels import ho3d_parameters
from hand_recon.hand.mano.layer import ManoLayer, ManoParameters
from hand_recon.schema import HandParameters

logger = logging.getLogger(__name__)

PROBES = 64
"""Number of frames whose labels are compared with MANO's landmarks."""

FAR = 0.003
"""Largest median distance of labels from MANO's landmarks, metres; rounding explains less."""


def load_mano_if_there(path: Path | str | None) -> ManoLayer | None:
    """MANO's right hand with HO3D's landmarks; None, with a warning, if MANO is missing."""
    if path is None:
        return None
    try:
        return ManoLayer.load(path, "right", "ho3d")
    except FileNotFoundError as error:
        logger.warning("Without MANO, HO3D's training hands have no surfaces: %s", error)
        return None


class ManoHands:
    """Hands of some annotations, computed by MANO on request."""

    def __init__(self, layer: ManoLayer, annotations: Annotations, path: Path) -> None:
        """Compare MANO's landmarks with the labels.

        Args:
            layer: The right hand with HO3D's landmarks.
            annotations: Annotations of the training part.
            path: Path of the part, for messages.

        Raises:
            ValueError: MANO's landmarks differ from the labels.
        """
        self.layer = layer
        self.mano = annotations.mano
        known = np.flatnonzero(np.isfinite(self.mano).all(axis=-1) & annotations.annotated)
        some = known[:: max(1, len(known) // PROBES)]
        with torch.no_grad():
            made = layer(*self._placed(some)).landmarks.numpy()
        missed = np.linalg.norm(made - annotations.points[some], axis=-1)
        if len(some) and np.median(missed) > FAR:
            raise ValueError(
                f"{path}: MANO's hands miss handJoints3D by {1000 * np.median(missed):.1f} mm in the median. "
                "handPose must be absolute axis angles (flat mean), handTrans MANO's translation in OpenGL's "
                "axes, and data.mano the right hand of MANO's release. For landmarks alone, set "
                "data.mano=null."
            )

    def vertices(self, row: int) -> Float[np.ndarray, "vertex 3"] | None:
        """Surface of a frame, camera frame, metres; None without MANO's parameters."""
        if not np.isfinite(self.mano[row]).all():
            return None
        with torch.no_grad():
            return np.asarray(self.layer(*self._placed(np.array([row]))).vertices[0].numpy())

    def parameters(self, rows: np.ndarray) -> HandParameters | None:
        """Pose and shape of some frames as this project's parameters; None without MANO's parameters."""
        known = rows[np.isfinite(self.mano[rows]).all(axis=-1)]
        if not len(known):
            return None
        with torch.no_grad():
            return self.layer.hand_parameters(*self._placed(known))

    def _placed(self, rows: np.ndarray) -> ManoParameters:
        """MANO's parameters in this project's camera frame."""
        numbers: Tensor = torch.from_numpy(self.mano[rows]).float()
        pose, shape, translation = numbers.split((48, 10, 3), dim=-1)
        return ho3d_parameters(self.layer, pose, shape, translation)
