"""Tables of scores in Markdown, and all numbers for a file."""

from collections.abc import Sequence
from typing import Any, Final

import torch

from photos.scores import Scored

COLUMNS: Final = ("E_2D", "PCK@0.10", "PR", "ROM", "PA-MPJPE", "second view")
"""Scores in the order of the table's columns."""

CALIBRATION: Final = ("coverage_1sigma", "coverage_2sigma", "rank_sigma_error")
"""Calibration in the order of the table's columns."""


def main_table(scored: Sequence[Scored]) -> str:
    """One line per method and set, with 95 % intervals."""
    lines = []
    for name in dict.fromkeys(one.hands.name for one in scored):
        chosen = [one for one in scored if one.hands.name == name]
        columns = [column for column in COLUMNS if column in chosen[0].values]
        lines += [
            f"{name} ({len(chosen[0].hands)})",
            "",
            "| method | " + " | ".join([*columns, *CALIBRATION]) + " |",
            "|---" * (1 + len(columns) + len(CALIBRATION)) + "|",
        ]
        for one in chosen:
            cells = [str(one.mean(column)) for column in columns]
            # A network that was trained without the likelihood has no σ to score.
            sigma = [one.calibration.get(column) for column in CALIBRATION]
            cells += ["—" if value is None else f"{value:.3f}" for value in sigma]
            lines.append(f"| {one.method} | " + " | ".join(cells) + " |")
        lines.append("")
    return "\n".join(lines)


def group_table(scored: Sequence[Scored], unseen: Sequence[str] = ()) -> str:
    """E_2D by group, beside its ratio to all hands, for every set that has groups.

    Args:
        scored: Scores of methods.
        unseen: Gestures that training did not have: their mean is compared with that of the others.
    """
    lines = []
    for one in (one for one in scored if one.hands.groups):
        every = one.mean("E_2D").value
        lines += [f"{one.hands.name}, {one.method}: E_2D {one.mean('E_2D')}", ""]
        lines += ["| group | hands | E_2D | × all |", "|---|---|---|---|"]
        for label, rows in _groups(one, unseen):
            found = one.mean("E_2D", rows)
            lines.append(f"| {label} | {len(rows)} | {found} | {found.value / every:.2f} |")
        lines.append("")
    return "\n".join(lines)


def _groups(one: Scored, unseen: Sequence[str]) -> list[tuple[str, torch.Tensor]]:
    found = [
        (f"{kind}: {name}", one.group(kind, name))
        for kind, names in one.hands.groups.items()
        for name in sorted(set(names) - {""})
    ]
    if unseen:
        gestures = one.hands.groups["gesture"]
        for label, wanted in (("gestures left out", True), ("gestures seen", False)):
            rows = [row for row, name in enumerate(gestures) if (name in unseen) == wanted]
            found.append((label, torch.tensor(rows)))
    return found


def as_json(scored: Sequence[Scored]) -> dict[str, Any]:
    """All means with their intervals."""
    entries = [
        {
            "set": one.hands.name,
            "method": one.method,
            "hands": len(one.hands),
            "calibration": one.calibration,
            **{
                name: {"mean": mean.value, "low": mean.interval.low, "high": mean.interval.high}
                for name in one.values
                for mean in (one.mean(name),)
            },
        }
        for one in scored
    ]
    return {"scores": entries}
