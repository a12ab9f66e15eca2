"""Checks of the anatomy of a fit: shape, length, ranges of motion, penetration (decision 59)."""

from functools import cache
from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.fitting.doubts.reasons import Reasons, reasons
from hand_recon.fitting.fitted_hands import FittedHands
from hand_recon.hand.open_hand import open_hand
from hand_recon.hand.skeleton import ARTICULATED, AXES, LANDMARKS
from hand_recon.knowledge.penetration.non_penetration import NonPenetration
from hand_recon.knowledge.ranges import RangeOfMotion, load_ranges

GREATEST_SHAPE: Final = 4.5
"""Greatest shape coefficient, standard deviations."""

HAND_LENGTHS: Final = (0.10, 0.24)
"""Length from the wrist to the middle fingertip along the bones, metres: that of a child of two years, and
more than that of the largest adult hands of anthropometric surveys."""

RANGE_TOLERANCE: Final = 22.5
"""Greatest violation of a range of motion, degrees (decision 25)."""

DEEPEST: Final = 0.008
"""Greatest depth of a vertex inside another part of the hand, metres."""


def anatomy_doubts(hands: FittedHands) -> dict[str, Reasons]:
    """Check shape, length, ranges of motion and penetration."""
    shape = hands.prediction.parameters.shape.abs().amax(dim=1)
    length = hand_lengths(hands.prediction.landmarks_3d)
    shortest, longest = HAND_LENGTHS
    return {
        "shape": reasons(
            shape > GREATEST_SHAPE,
            lambda hand: (
                f"The shape is {float(shape[hand]):.1f} standard deviations from the mean hand, expected "
                f"below {GREATEST_SHAPE}: check the order of the landmarks, the camera, and that u and v "
                "have one scale."
            ),
        ),
        "length": reasons(
            (length < shortest) | (length > longest),
            lambda hand: (
                f"The hand is {100 * float(length[hand]):.1f} cm long, expected {100 * shortest:.0f} to "
                f"{100 * longest:.0f} cm: check the order of the landmarks and the camera."
            ),
        ),
        "range of motion": _range_doubts(hands),
        "penetration": _penetration_doubts(hands),
    }


def hand_lengths(landmarks: Float[Tensor, "hand landmark=21 3"]) -> Float[Tensor, " hand"]:
    """Length from the wrist to the middle fingertip along the bones, metres."""
    line = [LANDMARKS.index(f"middle {part}") for part in ("MCP", "PIP", "DIP", "tip")]
    return landmarks[:, [0, *line]].diff(dim=1).norm(dim=-1).sum(dim=-1)


@cache
def _ranges() -> RangeOfMotion:
    return load_ranges("literature")


def _range_doubts(hands: FittedHands) -> Reasons:
    angles = hands.prediction.parameters.joint_angles
    violation = (angles - _ranges().clamp(angles)).abs().rad2deg().flatten(1)
    worst, which = violation.max(dim=1)

    def sentence(hand: int) -> str:
        joint, axis = divmod(int(which[hand]), len(AXES))
        return (
            f"The {AXES[axis]} of the {ARTICULATED[joint]} is {float(worst[hand]):.0f}° outside its range of "
            f"motion, expected below {RANGE_TOLERANCE}°: check the landmarks, or fit with a prior "
            "of the ranges."
        )

    return reasons(worst > RANGE_TOLERANCE, sentence)


@cache
def _open_surface() -> NonPenetration:
    return NonPenetration(open_hand())


def _penetration_doubts(hands: FittedHands) -> Reasons:
    """Find open hands that penetrate themselves; where the loss says that none does, nothing is computed."""
    suspects = hands.fitted & torch.tensor(
        [one.hand_model == "open" for one in hands.origins], dtype=torch.bool
    )
    if "non_penetration" in hands.loss:
        suspects &= hands.loss["non_penetration"] > 0
    depth = torch.zeros(len(hands))
    if bool(suspects.any()):
        # A left hand's surface is mirrored, and its inside is outside for the winding number.
        sign = torch.ones(len(hands), 1, 3)
        sign[hands.observed.left, :, 0] = -1.0
        surface = (hands.prediction.vertices.float() * sign)[suspects]
        depth[suspects] = _open_surface().depths(surface).amax(dim=1)
    return reasons(
        depth > DEEPEST,
        lambda hand: (
            f"A part of the hand is {1000 * float(depth[hand]):.0f} mm inside another, expected below "
            f"{1000 * DEEPEST:.0f} mm: check the landmarks, or fit with non-penetration."
        ),
    )
