"""Verdicts on a column of 3D landmarks: what `hand-recon audit` does, with errors as values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from omegaconf import OmegaConf

from hand_recon.command_line.resolvers import MANO_HAND
from hand_recon.knowledge.functional_anatomy import FunctionalAnatomy
from hand_recon.knowledge.ranges import load_ranges
from hand_recon.plausibility.audit import Audit, audited
from hand_recon.plausibility.findings import Knowledge
from hand_recon.plausibility.given_hands import GivenHands, of_points
from hand_recon.plausibility.posed_hands import HandModels
from hand_recon.plausibility.verdicts import Limits
from hand_recon.runs.configuration import build_hand, configure_process, plain
from hand_recon.runs.fit_landmarks import SIDES
from hand_recon.scale.isolation import rows_or_errors
from hand_recon.scale.landmark_worker import points_of
from hand_recon.scale.schema import AUDIT_NUMBERS, numbers


@dataclass(frozen=True)
class AuditTask:
    """3D landmarks of one hand."""

    points: object
    """21 × 3, any unit and frame; null or NaN where one is missing."""
    side: object = None
    """`left` or `right`; None to see it by the way fingers bend."""


class AuditWorker:
    """Hand models and knowledge of one process."""

    def __init__(self, settings: Mapping[str, Any]) -> None:
        """Build the hand models.

        Args:
            settings: `conf/audit.yaml` composed, as plain dictionaries.

        Raises:
            ValueError: A setting is out of its range.
        """
        configure_process(1)
        config = OmegaConf.create(dict(settings))
        if config.landmark_set is None:
            is_mano = config.hand._target_ == MANO_HAND
            config.hand.landmark_set = "mano" if is_mano else "knuckle"
        hand = build_hand(config)
        self.models = HandModels.of(hand)
        self.knowledge = Knowledge(
            load_ranges(config.ranges, hand.rest_angles), FunctionalAnatomy(variant=config.anatomy)
        )
        self.limits = Limits(**plain(config.limits))
        self.order, self.side = str(config.order), str(config.side)

    def __call__(self, tasks: Sequence[AuditTask]) -> list[dict[str, Any]]:
        """Audit hands.

        Args:
            tasks: Landmarks of each hand.

        Returns:
            One row per hand, as `schema.audit_type` describes it, in order.
        """
        return rows_or_errors(tasks, self._audited, _failed)

    def _audited(self, tasks: Sequence[AuditTask]) -> list[dict[str, Any]]:
        found = audited(
            _given(tasks),
            self.models,
            self.knowledge,
            self.limits,
            order=self.order,
            side=self.side,
        )
        return [_row(found, hand) for hand in range(len(tasks))]


def _given(tasks: Sequence[AuditTask]) -> GivenHands:
    """Landmarks of a column; units and orders are recognised hand by hand, as each were a file."""
    sides = [None if task.side is None else str(task.side) for task in tasks]
    if not set(sides) <= {None, *SIDES}:
        wrong = next(one for one in sides if one not in (None, *SIDES))
        raise ValueError(f"side is {wrong!r}; expected right, left or null.")
    points = torch.from_numpy(np.stack([points_of(task.points, 3) for task in tasks]))
    given = of_points(
        points,
        "",
        left=[None if one is None else one == "left" for one in sides],
        sides=[one or "" for one in sides],
    )
    return _each_its_own_file(given)


def _each_its_own_file(given: GivenHands) -> GivenHands:
    files = tuple(f"row {row}" for row in range(len(given)))
    return GivenHands(**{**vars(given), "files": files})


def _row(found: Audit, hand: int) -> dict[str, Any]:
    verdict, findings = found.verdicts[hand], found.findings
    posed = bool(found.hands.posed[hand])
    measured = (
        findings.worst_range, findings.worst_anatomy, findings.depth, findings.residual, findings.worst_bone,
    )  # fmt: skip
    values = [numbers(values[hand].item()) if posed else None for values in measured]
    return {
        "verdict": verdict.value,
        "reasons": list(verdict.reasons),
        "handedness": ("left" if bool(found.hands.left[hand]) else "right") if posed else None,
        "joint_angles_degrees": numbers(findings.angles[hand].numpy()) if posed else None,
        "error": None,
    } | dict(zip(AUDIT_NUMBERS, values, strict=True))


def _failed(task: AuditTask, error: str) -> dict[str, Any]:
    del task
    nothing = dict.fromkeys(("verdict", "reasons", "handedness", "joint_angles_degrees"))
    return nothing | dict.fromkeys(AUDIT_NUMBERS) | {"error": error}
