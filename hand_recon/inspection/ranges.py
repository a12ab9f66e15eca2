"""Joint ranges of a dataset's labelled poses: how many exceed those of real joints (Sec. 3.2, Table 1)."""

import logging
import math

from jaxtyping import Float
from torch import Tensor

from hand_recon.data.datamodule import HandDataModule
from hand_recon.evaluation.plausibility import ROM_TOLERANCE, range_violation
from hand_recon.knowledge.ranges import load_ranges

logger = logging.getLogger(__name__)


def examine_poses(
    data: HandDataModule, rest_angles: Float[Tensor, "joint=15 axis=3"], limit: int
) -> dict[str, float]:
    """Compare the joint angles of a dataset's training hands with the ranges of the clinical literature.

    Args:
        data: The dataset; its training hands' parameters are used.
        rest_angles: Joint angles of the hand model's rest pose, radians.
        limit: The most hands to compare.

    Returns:
        `poses`, the number of hands compared; `beyond_ranges_percent`, the percentage of hands with a joint
        beyond its range by more than `ROM_TOLERANCE`; `largest_violation_degrees_mean`, the mean over hands
        of the largest violation, degrees. Empty for a dataset without poses, with a log line that gives
        the reason.
    """
    try:
        parameters = data.train_parameters(limit)
    except (OSError, ValueError) as error:
        logger.warning("The poses of %s were not compared with joint ranges: %s", data.name, error)
        return {}
    if parameters is None:
        logger.info("%s has no labelled poses: no comparison with joint ranges.", data.name)
        return {}
    angles = parameters.joint_angles
    angles = angles[angles.isfinite().flatten(1).all(dim=1)].double()
    if not len(angles):
        logger.warning(
            "No labelled pose of %s is finite: no comparison with joint ranges.", data.name
        )
        return {}
    violation = range_violation(angles, load_ranges("literature", rest_angles))
    return {
        "poses": float(len(angles)),
        "beyond_ranges_percent": 100 * float((violation > ROM_TOLERANCE).double().mean()),
        "largest_violation_degrees_mean": math.degrees(float(violation.mean())),
    }
