"""Change of a hand from one row of knowledge to another, in millimetres and degrees."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hand_recon.fitting.hand_records import HandRecords
from hand_recon.hand.skeleton import ARTICULATED


@dataclass(frozen=True)
class Change:
    """Difference between two fits of one hand."""

    millimetres: float
    """Mean distance between the landmarks, both hands' wrists in one place."""
    largest_millimetres: float
    """The largest of these distances."""
    degrees: float
    """Mean over the joints of the angle that changed most."""
    largest_degrees: float
    """The largest change of an angle."""
    joint: str
    """Joint with this angle."""


def changes(before: HandRecords, after: HandRecords) -> list[Change | None]:
    """Compare two fits of the same hands.

    Args:
        before: Hands of one fit.
        after: The same hands of another one, in the same order.

    Returns:
        One for each hand; None where a fit has no result.
    """
    both = (before.fitted & after.fitted).tolist()
    return [
        _change(
            after.landmarks_3d[hand] - before.landmarks_3d[hand],
            after.joint_angles_degrees[hand] - before.joint_angles_degrees[hand],
        )
        if known
        else None
        for hand, known in enumerate(both)
    ]


def _change(
    moved: Float[np.ndarray, "landmark=21 3"], turned: Float[np.ndarray, "joint=15 axis=3"]
) -> Change:
    """The change of one hand from differences of its landmarks (metres) and angles (degrees)."""
    distances = 1000 * np.linalg.norm(moved - moved[0], axis=-1)
    angles = np.abs(turned).max(axis=-1)
    return Change(
        float(distances.mean()),
        float(distances.max()),
        float(angles.mean()),
        float(angles.max()),
        ARTICULATED[int(angles.argmax())],
    )
