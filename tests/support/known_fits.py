"""Prior and distances for fits of known hands."""

from jaxtyping import Float
from torch import Tensor

from hand_recon.fitting.objective import Fitted
from hand_recon.hand.model import HandModel
from hand_recon.knowledge.functional_anatomy import FunctionalAnatomy
from hand_recon.knowledge.prior import Prior
from hand_recon.knowledge.terms import RangeOfMotionTerm, ShapeTerm
from hand_recon.schema import HandBatch

COUNT = 8
"""Hands of a batch."""


def without_penetration(hand: HandModel) -> Prior:
    """Row 3 of Table 1."""
    return Prior(
        {
            "range_of_motion": RangeOfMotionTerm(hand, anatomy=FunctionalAnatomy()),
            "shape": ShapeTerm(hand),
        }
    )


def distance(found: Fitted, batch: HandBatch) -> Float[Tensor, "hand landmark"]:
    """Distance of the fitted landmarks from those of the batch, pixels."""
    return (found.prediction.landmarks_2d - batch.landmarks_2d).norm(dim=-1)
