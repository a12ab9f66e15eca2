"""A peer's prior: the distance to the mean pose, measured by how natural poses vary.

Boukhayma et al. (CVPR 2019) and those after them keep a pose near the mean of MANO's 3D scans in the space of
its PCA. It is here to compare knowledge from books with knowledge from 3D data, and no default uses it. Its
data are the training gestures of the synthetic hands (`tools/build_pose_components.py`).
"""

from importlib.resources import files
from typing import Final

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

TABLE: Final = "tables/pose_components.npz"
"""`mean` (45) and `components` (45 × 45, one per row, by decreasing spread), radians, and `deviations`."""


class PoseComponents(nn.Module):
    """The squared Mahalanobis distance of a pose from the mean pose.

    Raises:
        FileNotFoundError: The table is not beside this module.
    """

    mean: Tensor
    whitening: Tensor

    def __init__(self) -> None:
        super().__init__()
        path = files("hand_recon.knowledge") / TABLE
        if not path.is_file():
            raise FileNotFoundError(
                f"No principal components of poses at {path}. They are part of the repository: restore them "
                "with git, or rebuild them with `python tools/build_pose_components.py`."
            )
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
            tables = {name: torch.from_numpy(archive[name]) for name in archive.files}
        whitening = tables["components"] / tables["deviations"][:, None]
        self.register_buffer("mean", tables["mean"], persistent=False)
        self.register_buffer("whitening", whitening, persistent=False)

    def forward(
        self, joint_angles: Float[Tensor, "*batch joint=15 axis=3"]
    ) -> Float[Tensor, "*batch"]:
        """One value per hand: the sum of squared coefficients, each in standard deviations.

        Args:
            joint_angles: Bend, splay and twist, radians.
        """
        from_mean = joint_angles.flatten(-2) - self.mean.to(joint_angles)
        coefficients = from_mean @ self.whitening.to(joint_angles).mT
        return coefficients.square().sum(dim=-1)
