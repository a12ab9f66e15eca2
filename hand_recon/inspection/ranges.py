"""Whether the poses that a dataset's labels claim are ones that joints can take (Sec. 3.2, Table 1)."""

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
    """How far the training hands' own joint angles are beyond the ranges of the clinical literature.

    Args:
        data: Asked for the parameters of its training hands.
        rest_angles: Of the hand model, radians.
        limit: At most so many hands.

    Returns:
        By name: how many hands were looked at, the percentage with a joint beyond its range by more than
        `ROM_TOLERANCE`, and the mean over hands of the largest violation, degrees. Nothing, and a line that
        says why, where the dataset does not know its poses.
    """
    try:
        parameters = data.train_parameters(limit)
    except (OSError, ValueError) as error:
        logger.warning("The poses of %s were not compared with joint ranges: %s", data.name, error)
        return {}
    if parameters is None:
        logger.info("%s does not know its poses: no comparison with joint ranges.", data.name)
        return {}
    angles = parameters.joint_angles
    angles = angles[angles.isfinite().flatten(1).all(dim=1)].double()
    if not len(angles):
        logger.warning("%s has no pose that is finite: no comparison with joint ranges.", data.name)
        return {}
    violation = range_violation(angles, load_ranges("literature", rest_angles))
    return {
        "poses": float(len(angles)),
        "beyond_ranges_percent": 100 * float((violation > ROM_TOLERANCE).double().mean()),
        "largest_violation_degrees_mean": math.degrees(float(violation.mean())),
    }
