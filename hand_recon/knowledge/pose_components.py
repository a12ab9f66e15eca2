"""A prior of other work: squared Mahalanobis distance of a pose from the mean of 3D poses.

Boukhayma et al. (CVPR 2019) and those after them keep a pose near the mean of MANO's 3D scans in the space of
its PCA. It is here to compare generic knowledge with knowledge from 3D data, and no default uses it. Its
data are the training gestures of the synthetic hands (`tools/build_pose_components.py`).
"""

from typing import Final

from hand_recon.hand.model import HandModel
from hand_recon.hand.packaged_arrays import packaged_arrays
from hand_recon.knowledge.pose_distance import PoseDistance, PoseDistanceTerm

TABLE: Final = "tables/pose_components.npz"
"""`mean` (45) and `deviations` (45), radians; `components` (45 × 45), one per row, by falling deviation."""


class PoseComponents(PoseDistance):
    """Squared Mahalanobis distance of a pose from the mean pose.

    Raises:
        FileNotFoundError: The table is not beside this module.
    """

    def __init__(self) -> None:
        tables = packaged_arrays(
            "hand_recon.knowledge",
            TABLE,
            what="principal components of poses",
            rebuild="`python tools/build_pose_components.py`",
        )
        super().__init__(tables["mean"], tables["components"] / tables["deviations"][:, None])


class PoseComponentsTerm(PoseDistanceTerm):
    """The distance to the mean pose as a term of the prior, with its weight (`prior=pca_mean`)."""

    def __init__(self, hand: HandModel, *, weight: float) -> None:
        super().__init__(hand, weight=weight, distance=PoseComponents())
