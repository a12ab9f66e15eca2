"""Scores of methods on sets, the paired changes between them, and their tables."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import torch
from jaxtyping import Float
from torch import Tensor

from depth.methods import Run
from depth.scores import Mean, aligned_errors, grouped_mean, second_view_errors
from depth.sets import DepthSet
from hand_recon.hand.skeleton import LANDMARKS

COLUMNS: Final = (
    "set", "method", "PA-MPJPE, mm (95 %)", "median", "change (95 %)", "second view, px", "change, px",
    "ms per hand", "ms alone",
)  # fmt: skip
"""Titles of the table's columns."""

PREVIOUS: Final = "previous"
"""Reference that stands for the method before each."""


@dataclass(frozen=True)
class Scored:
    """A run with its errors."""

    hands: DepthSet
    """The set."""
    run: Run
    """The fitted hands."""
    landmark_errors: Float[Tensor, "hand landmark=21"]
    """Distance of each landmark from the ground truth after Procrustes alignment, millimetres."""
    second_view: Float[Tensor, " hand"] | None
    """Mean distance of projections in the second camera, pixels; none without a second camera."""

    @classmethod
    def of(cls, hands: DepthSet, run: Run) -> "Scored":
        """Score a run."""
        found = run.landmarks_3d
        second = None if hands.second is None else second_view_errors(found, hands.second)
        return cls(hands, run, aligned_errors(hands.ground_truth, found), second)

    @property
    def errors(self) -> Float[Tensor, " hand"]:
        """PA-MPJPE (E_J) of each hand, millimetres."""
        return self.landmark_errors.mean(dim=1)

    def mean(self) -> Mean:
        """PA-MPJPE (E_J), millimetres."""
        return grouped_mean(self.errors, self.hands.groups)

    def change(self, reference: "Scored") -> Mean:
        """PA-MPJPE minus that of another run on the same hands, millimetres."""
        return grouped_mean(self.errors - reference.errors, self.hands.groups)

    def second_mean(self) -> Mean | None:
        """Distance in the second camera, pixels."""
        if self.second_view is None:
            return None
        return grouped_mean(self.second_view, self.hands.groups)

    def second_change(self, reference: "Scored") -> Mean | None:
        """Distance in the second camera minus that of another run, pixels."""
        if self.second_view is None or reference.second_view is None:
            return None
        return grouped_mean(self.second_view - reference.second_view, self.hands.groups)


def markdown(scored: Sequence[Scored], against: str) -> str:
    """Table of all runs, with changes against one method on the same set.

    Args:
        scored: Runs of any sets.
        against: Name of that method, or `PREVIOUS` for the method before each.
    """
    lines = [_line(COLUMNS), _line(["---"] * len(COLUMNS))]
    for one in scored:
        reference = _reference(scored, one, against)
        second = one.second_mean()
        change = second_change = "—"
        if reference is not one:
            change = one.change(reference).signed()
            found = one.second_change(reference)
            second_change = "—" if found is None else found.signed()
        lines.append(
            _line(
                [
                    f"{one.hands.name} ({len(one.hands)})",
                    one.run.method.name,
                    str(one.mean()),
                    f"{float(one.errors.median()):.2f}",
                    change,
                    "—" if second is None else str(second),
                    second_change,
                    f"{one.run.batch_ms:.1f}",
                    f"{one.run.alone_ms:.1f}",
                ]
            )
        )
    return "\n".join(lines)


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _reference(scored: Sequence[Scored], one: Scored, against: str) -> Scored:
    """The run that a run is compared with, on the same set; the first method has none but itself."""
    same = [each for each in scored if each.hands is one.hands]
    if against == PREVIOUS:
        return same[max(0, [each is one for each in same].index(True) - 1)]
    return next(each for each in same if each.run.method.name == against)


def as_json(scored: Sequence[Scored], against: str) -> dict[str, Any]:
    """Everything in the table, with the error of every hand and the mean of every landmark.

    Args:
        scored: Runs of any sets.
        against: Name of the reference method, or `PREVIOUS`.
    """
    entries = []
    for one in scored:
        reference = _reference(scored, one, against)
        by_landmark = one.landmark_errors.mean(dim=0).tolist()
        entries.append(
            {
                "set": one.hands.name,
                "hands": len(one.hands),
                "groups": len(set(one.hands.groups)),
                "method": one.run.method.name,
                "overrides": list(one.run.method.overrides),
                "pa_mpjpe_mm": _numbers(one.mean()),
                "median_mm": float(one.errors.median()),
                "against": reference.run.method.name,
                "change_mm": _numbers(one.change(reference)),
                "second_view_px": _numbers(one.second_mean()),
                "second_view_change_px": _numbers(one.second_change(reference)),
                "ms_per_hand": one.run.batch_ms,
                "ms_alone": one.run.alone_ms,
                "landmarks_mm": dict(zip(LANDMARKS, by_landmark, strict=True)),
                "errors_mm": dict(zip(one.hands.landmarks.names, one.errors.tolist(), strict=True)),
            }
        )
    return {"runs": entries}


def _numbers(mean: Mean | None) -> list[float] | None:
    """Mean and ends of the interval."""
    return None if mean is None else [mean.value, mean.interval.low, mean.interval.high]


def worst(scored: Scored, count: int) -> list[int]:
    """Positions of the hands of the largest PA-MPJPE, the worst first."""
    order = torch.argsort(scored.errors, descending=True, stable=True)
    return [int(place) for place in order[:count]]
