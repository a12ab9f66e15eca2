"""A prior of other work: squared Mahalanobis distance of a pose from the mean of 3D poses.

Boukhayma et al. (CVPR 2019) and those after them keep a pose near the mean of MANO's 3D scans in the space of
its PCA. It is here to compare generic knowledge with knowledge from 3D data, and no default uses it. Its
data are the training gestures of the synthetic hands (`tools/build_pose_components.py`).
"""

from importlib.resources import files
from typing import Final

import numpy as np
import torch

from hand_recon.hand.model import HandModel
from hand_recon.knowledge.pose_distance import PoseDistance, PoseDistanceTerm

TABLE: Final = "tables/pose_components.npz"
"""`mean` (45) and `deviations` (45), radians; `components` (45 × 45), one per row, by falling deviation."""


class PoseComponents(PoseDistance):
    """Squared Mahalanobis distance of a pose from the mean pose.

    Raises:
        FileNotFoundError: The table is not beside this module.
    """

    def __init__(self) -> None:
        path = files("hand_recon.knowledge") / TABLE
        if not path.is_file():
            raise FileNotFoundError(
                f"No principal components of poses at {path}. They are part of the repository: restore them "
                "with git, or rebuild them with `python tools/build_pose_components.py`."
            )
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
            tables = {name: torch.from_numpy(archive[name]) for name in archive.files}
        super().__init__(tables["mean"], tables["components"] / tables["deviations"][:, None])


class PoseComponentsTerm(PoseDistanceTerm):
    """The distance to the mean pose as a term of the prior, with its weight (`prior=pca_mean`)."""

    def __init__(self, hand: HandModel, *, weight: float) -> None:
        super().__init__(hand, weight=weight, distance=PoseComponents())
