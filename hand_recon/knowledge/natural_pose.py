"""Natural poses: the distance of a pose from how living hands are held, as a term of the prior.

Ranges of motion say what a hand can do, and inside them every pose is equally good. What one image leaves
open, such as the depth of a bent finger, is then left open. Living hands prefer some poses: PIP and DIP of a
finger bend together, neighbouring fingers do, and few joints are held at the end of their range. The mean and
the covariance of all joint angles hold this; their principal axes are the postural synergies of Santello et
al. (J. Neurosci. 18(23), 1998). Ours are learnt from 2D landmarks of photographs, with no 3D data:
`tools/learn_from_landmarks.py`.
"""

from typing import Final

from jaxtyping import Float
from torch import Tensor

from hand_recon.hand.model import HandModel
from hand_recon.hand.packaged_arrays import packaged_arrays
from hand_recon.knowledge.pose_distance import PoseDistance, PoseDistanceTerm

TABLE: Final = "tables/natural_poses.npz"
"""`mean` (45), radians, and `covariance` (45 × 45), squared radians."""


class NaturalPoseTerm(PoseDistanceTerm):
    """Squared distance of a pose from natural poses (`prior=natural`).

    Args:
        hand: The hand model.
        weight: Factor of the squared distance. ½ makes it the negative logarithm of a Gaussian; twice that is
            more accurate where σ of the landmarks is given too small (decision 64).

    Raises:
        FileNotFoundError: The table is not beside this module.
    """

    def __init__(self, hand: HandModel, *, weight: float = 1.0) -> None:
        distance = PoseDistance.of_gaussian(*natural_poses())
        super().__init__(hand, weight=weight, distance=distance)


def natural_poses() -> tuple[Float[Tensor, " angle=45"], Float[Tensor, "angle=45 angle=45"]]:
    """Read the mean, radians, and the covariance, squared radians, of natural poses.

    Raises:
        FileNotFoundError: The table is not beside this module.
    """
    tables = packaged_arrays(
        "hand_recon.knowledge",
        TABLE,
        what="natural poses",
        rebuild="`python -m tools.learn_from_landmarks`",
    )
    return tables["mean"], tables["covariance"]
