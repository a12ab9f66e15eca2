"""One audit: posed hands, what was measured of them, and the verdicts."""

from collections import Counter
from dataclasses import dataclass
from typing import Any, Self

import torch
from torch import Tensor

from hand_recon.hand.skeleton import ARTICULATED, AXES
from hand_recon.plausibility.findings import Findings, Knowledge, findings_of
from hand_recon.plausibility.given_hands import GivenHands
from hand_recon.plausibility.metric_points import in_metres, without_placeholders
from hand_recon.plausibility.posed_hands import HandModels, PosedHands, posed_hands
from hand_recon.plausibility.sequences import SequenceFindings, sequence_findings
from hand_recon.plausibility.verdicts import Limits, Verdict, verdicts_on

SHOWN: float = 1.0
"""Least violation of a range that is listed and counted, degrees."""


@dataclass(frozen=True)
class Audit:
    """Result of an audit."""

    hands: PosedHands
    """The hands."""
    findings: Findings
    """Measurements of each."""
    verdicts: tuple[Verdict, ...]
    """Verdict on each."""
    sequences: tuple[SequenceFindings, ...]
    """Measurements of each sequence."""
    knowledge: Knowledge
    """Knowledge that the hands were audited against."""
    limits: Limits
    """Limits of plausibility."""

    @classmethod
    def of(
        cls, hands: PosedHands, models: HandModels, knowledge: Knowledge, limits: Limits
    ) -> Self:
        """Audit posed hands.

        Args:
            hands: The hands.
            models: Hand models.
            knowledge: Ranges, functional anatomy and tolerance.
            limits: Limits of plausibility.
        """
        findings = findings_of(hands, models, knowledge)
        return cls(
            hands,
            findings,
            verdicts_on(hands, findings, limits),
            tuple(sequence_findings(hands)),
            knowledge,
            limits,
        )

    def counts(self) -> Counter[str]:
        """Number of hands by verdict."""
        return Counter(verdict.value for verdict in self.verdicts)

    def summary(self) -> dict[str, Any]:
        """Numbers and rates over all hands; rates are percent of the audited ones, None without any."""
        found, posed = self.findings, self.hands.posed
        counts = self.counts()
        limits = self.limits
        meshed = posed & found.depth.isfinite()
        fitted = posed & ~self.hands.exact
        depth_tolerance = 1000 * self.knowledge.tolerance
        return {
            "hands": len(self.verdicts),
            "audited": int(posed.sum()),
            "angles_given": int((posed & self.hands.exact).sum()),
            "fitted_to_points": int(fitted.sum()),
            "plausible": counts["plausible"],
            "implausible": counts["implausible"],
            "implausible_percent": _percent(self.implausible(), posed),
            "beyond_range_percent": _percent(found.worst_range > limits.degrees, posed),
            "beyond_anatomy_percent": _percent(found.worst_anatomy > limits.degrees, posed),
            "worst_range_degrees_mean": _mean(found.worst_range, posed),
            "worst_anatomy_degrees_mean": _mean(found.worst_anatomy, posed),
            "penetration_rate_percent": _percent(found.depth > depth_tolerance, meshed),
            "deeper_than_limit_percent": _percent(found.depth > limits.depth, meshed),
            "depth_mm_mean": _mean(found.depth, meshed),
            "depth_mm_greatest": float(found.depth[meshed].max()) if bool(meshed.any()) else None,
            "residual_mm_mean": _mean(found.residual, fitted),
            "beyond_bone_limit_percent": _percent(found.worst_bone > limits.bone_error, fitted),
        }

    def implausible(self) -> Tensor:
        """Mask of the implausible hands."""
        return torch.tensor([one.value == "implausible" for one in self.verdicts], dtype=torch.bool)

    def joints(self) -> list[dict[str, Any]]:
        """Violations by joint and axis, those without any left out."""
        rows = []
        for joint, name in enumerate(ARTICULATED):
            for axis, turn in enumerate(AXES):
                row = self._joint(joint, axis)
                if row is not None:
                    rows.append({"joint": name, "axis": turn} | row)
        return rows

    def _joint(self, joint: int, axis: int) -> dict[str, Any] | None:
        found, at = self.findings, (slice(None), joint, axis)
        counted = found.counted[at]
        if not bool(counted.any()):
            return None
        beyond, anatomy = found.beyond_range[at][counted], found.beyond_anatomy[at][counted]
        if not bool((torch.maximum(beyond.abs(), anatomy.abs()) > SHOWN).any()):
            return None
        angles = found.angles[at][counted]
        every = torch.ones_like(counted[counted])
        limit = self.limits.degrees
        ranges = self.knowledge.ranges
        return {
            "lower_degrees": float(ranges.lower[joint, axis].rad2deg()),
            "upper_degrees": float(ranges.upper[joint, axis].rad2deg()),
            "least_degrees": float(angles.min()),
            "median_degrees": float(angles.median()),
            "greatest_degrees": float(angles.max()),
            "violated_percent": _percent(beyond.abs() > SHOWN, every),
            "beyond_limit_percent": _percent(beyond.abs() > limit, every),
            "greatest_violation_degrees": float(beyond.abs().max()),
            "anatomy_violated_percent": _percent(anatomy.abs() > SHOWN, every),
            "anatomy_beyond_limit_percent": _percent(anatomy.abs() > limit, every),
            "greatest_anatomy_violation_degrees": float(anatomy.abs().max()),
        }

    def badness(self) -> Tensor:
        """Violation of each hand's limits, 1 at a limit; −1 for hands that were not audited."""
        found, limits = self.findings, self.limits
        measured = [
            (found.worst_range, limits.degrees),
            (found.depth, limits.depth),
            (found.residual, limits.residual),
            (found.worst_bone, limits.bone_error),
            (found.shape, limits.shape),
        ]
        if limits.anatomy:
            measured.append((found.worst_anatomy, limits.degrees))
        # A limit may be 0.
        parts = torch.stack([one.nan_to_num(0.0) / max(limit, 1e-6) for one, limit in measured])
        return torch.where(self.hands.posed, parts.amax(dim=0), -1.0)


def audited(
    given: GivenHands,
    models: HandModels,
    knowledge: Knowledge,
    limits: Limits,
    *,
    order: str = "auto",
    side: str = "auto",
) -> Audit:
    """Audit hands as files give them.

    Args:
        given: Hands in the units, orders and sides of their files.
        models: Hand models.
        knowledge: Ranges, functional anatomy and tolerance.
        limits: Limits of plausibility.
        order: Order of the landmarks, or `auto`.
        side: Side of points that do not tell it, or `auto`.
    """
    hands = posed_hands(in_metres(without_placeholders(given), order), models, side)
    return Audit.of(hands, models, knowledge, limits)


def _percent(hit: Tensor, among: Tensor) -> float | None:
    count = int(among.sum())
    return 100 * int((hit & among).sum()) / count if count else None


def _mean(values: Tensor, among: Tensor) -> float | None:
    return float(values[among].mean()) if bool(among.any()) else None
