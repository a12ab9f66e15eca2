"""Verdicts on audited hands, each with its reasons (decision 81)."""

from dataclasses import dataclass
from typing import Final

from hand_recon.fitting.doubts.anatomy import DEEPEST, GREATEST_SHAPE, RANGE_TOLERANCE
from hand_recon.hand.skeleton import ARTICULATED, AXES, LANDMARKS
from hand_recon.plausibility.findings import PHALANGES, Findings
from hand_recon.plausibility.posed_hands import PosedHands

PLAUSIBLE: Final = "plausible"
IMPLAUSIBLE: Final = "implausible"
NOT_AUDITED: Final = "not audited"

GREATEST_RESIDUAL: Final = 8.0
"""Greatest mean distance of a fitted hand to its points, millimetres."""

GREATEST_BONE_ERROR: Final = 0.5
"""Greatest relative difference of a phalanx's length from the fitted hand's."""


@dataclass(frozen=True)
class Limits:
    """Violations up to which a hand is plausible."""

    degrees: float = RANGE_TOLERANCE
    """Beyond a range of motion, degrees (decision 25)."""
    anatomy: bool = False
    """True if functional anatomy counts as the ranges do. Living hands violate it (docs/audit.md)."""
    depth: float = 1000 * DEEPEST
    """Depth of penetration, millimetres (decision 59)."""
    residual: float = GREATEST_RESIDUAL
    """Mean distance to the given points, millimetres."""
    bone_error: float = GREATEST_BONE_ERROR
    """Relative error of a phalanx's length."""
    shape: float = GREATEST_SHAPE
    """Shape coefficient, standard deviations."""


@dataclass(frozen=True)
class Verdict:
    """Verdict on one hand."""

    value: str
    """`plausible`, `implausible` or `not audited`."""
    reasons: tuple[str, ...] = ()
    """Sentences of what was found and what was expected; empty for plausible hands."""


@dataclass(frozen=True)
class Worst:
    """Angle of a hand that violates its range the most."""

    joint: str
    """Name of the joint."""
    axis: str
    """`bend`, `splay` or `twist`."""
    angle: float
    """Its angle, degrees."""
    beyond: float
    """Degrees above the upper bound (positive) or below the lower one (negative)."""

    @property
    def text(self) -> str:
        """Joint, axis, angle and violation in words."""
        where = "above its upper" if self.beyond > 0 else "below its lower"
        return f"{self.axis} of the {self.joint} is {self.angle:.0f}°, {abs(self.beyond):.0f}° {where} bound"


def violations(
    findings: Findings, hand: int, *, anatomy: bool = False, least: float = 1.0
) -> list[Worst]:
    """Violations of one hand among the angles that count, greatest first.

    Args:
        findings: Findings.
        hand: Row.
        anatomy: True for those of functional anatomy, which are inside the table's ranges.
        least: Smallest violation, degrees.
    """
    every = findings.beyond_anatomy if anatomy else findings.beyond_range
    beyond = every[hand] * findings.counted[hand]
    rows = [
        Worst(ARTICULATED[joint], AXES[axis], float(findings.angles[hand, joint, axis]), value)
        for joint, values in enumerate(beyond.tolist())
        for axis, value in enumerate(values)
        if abs(value) > least
    ]
    return sorted(rows, key=lambda one: -abs(one.beyond))


def verdicts_on(hands: PosedHands, findings: Findings, limits: Limits) -> tuple[Verdict, ...]:
    """Judge every hand.

    Args:
        hands: The hands.
        findings: What was measured of them.
        limits: Limits of plausibility.
    """
    posed = hands.posed.tolist()
    return tuple(
        _judged(findings, hand, limits)
        if posed[hand]
        else Verdict(
            NOT_AUDITED, ("Too few landmarks; expected 12 or more of 21 with finite coordinates.",)
        )
        for hand in range(len(hands))
    )


def _judged(findings: Findings, hand: int, limits: Limits) -> Verdict:
    reasons = [
        f"The {one.text}, expected within {limits.degrees:g}° of it."
        for one in violations(findings, hand, least=limits.degrees)
    ]
    if limits.anatomy:
        reasons += [
            f"The {one.text} as functional anatomy leaves it, expected within {limits.degrees:g}° of it."
            for one in violations(findings, hand, anatomy=True, least=limits.degrees)
        ]
    reasons += [*_of_penetration(findings, hand, limits), *_of_bones(findings, hand, limits)]
    return Verdict(IMPLAUSIBLE if reasons else PLAUSIBLE, tuple(reasons))


def _of_penetration(findings: Findings, hand: int, limits: Limits) -> list[str]:
    depth = float(findings.depth[hand])
    if not depth > limits.depth:
        return []
    return [
        f"A part of the hand is {depth:.1f} mm inside another, expected up to {limits.depth:g} mm."
    ]


def _of_bones(findings: Findings, hand: int, limits: Limits) -> list[str]:
    reasons = []
    residual, shape = float(findings.residual[hand]), float(findings.shape[hand])
    errors = findings.bone_error[hand]
    for landmark in PHALANGES:
        error = float(errors[landmark])
        if abs(error) > limits.bone_error:
            reasons.append(
                f"The bone to the {LANDMARKS[landmark]} is {100 * error:+.0f} % of the fitted hand's length "
                f"off, expected up to {100 * limits.bone_error:.0f} %."
            )
    if residual > limits.residual:
        reasons.append(
            f"The nearest hand is {residual:.1f} mm from the points in the mean, expected up to "
            f"{limits.residual:g} mm."
        )
    if shape > limits.shape:
        reasons.append(
            f"The shape is {shape:.1f} standard deviations from the mean hand, expected up to "
            f"{limits.shape:g}."
        )
    return reasons
