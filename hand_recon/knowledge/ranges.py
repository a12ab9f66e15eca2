"""Range-of-motion tables of the prior (Sec. 3.2, Eq. 1).

A table is a YAML file: degrees, one row per joint and axis, and for each bound the source of its number.
Two are shipped in `tables/`, `literature` (clinical measurements) and `paper_release` (the constants
published with the paper); any path to a file of the same form will do as well. `docs/ranges.md` shows both.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.hand.skeleton import ARTICULATED, AXES
from hand_recon.reading.text import parse_yaml, read_text

TABLES: Final = Path(__file__).parent / "tables"
"""Folder of the shipped tables."""

REFERENCES: Final[tuple[str, ...]] = ("neutral", "template")
"""Zero of a table's angles: the anatomical neutral, or the hand model's rest pose."""


@dataclass(frozen=True)
class RangeOfMotion:
    """Bounds of every joint angle, from the anatomical neutral."""

    lower: Float[Tensor, "*batch joint=15 axis=3"]
    """Smallest bend, splay and twist, radians."""
    upper: Float[Tensor, "*batch joint=15 axis=3"]
    """Largest bend, splay and twist, radians."""

    def clamp(
        self, joint_angles: Float[Tensor, "*batch joint=15 axis=3"]
    ) -> Float[Tensor, "*batch joint=15 axis=3"]:
        """The nearest joint angles inside the ranges, radians."""
        return joint_angles.clamp(self.lower.to(joint_angles), self.upper.to(joint_angles))

    def contains(
        self, joint_angles: Float[Tensor, "*batch joint=15 axis=3"], tolerance: float = 1e-6
    ) -> Tensor:
        """Mask of hands with all angles inside the ranges.

        Args:
            joint_angles: Bend, splay and twist of each joint, radians.
            tolerance: Violation that still counts as inside, radians.
        """
        inside = (joint_angles >= self.lower - tolerance) & (joint_angles <= self.upper + tolerance)
        return inside.flatten(-2).all(dim=-1)


def load_ranges(
    name_or_path: str, rest_angles: Float[Tensor, "joint=15 axis=3"] | None = None
) -> RangeOfMotion:
    """Read a table of ranges.

    Args:
        name_or_path: `literature`, `paper_release`, or a path to a YAML file of the same form.
        rest_angles: The hand's rest pose from the anatomical neutral, radians. A table whose
            `reference` is `template` counts from there, unless it has a `template` of its own.

    Raises:
        FileNotFoundError: There is no such table.
        ValueError: The table is incomplete or contradicts itself, or counts from the template and
            the hand's rest pose was not given.
    """
    path = table_path(name_or_path)
    table = parse_yaml(read_text(path), path)
    if not isinstance(table, dict) or not isinstance(table.get("joints"), dict):
        raise ValueError(
            f"{path} has no `joints:` section; tables/literature.yaml beside this module shows the form."
        )
    _check_names(path, table["joints"])
    bounds = torch.tensor(
        [[_bounds(path, table, joint, axis) for axis in AXES] for joint in ARTICULATED]
    )
    if _reference(path, table) == "template":
        bounds = bounds + _template(path, table, rest_angles)[..., None]
    return RangeOfMotion(lower=bounds[..., 0], upper=bounds[..., 1])


def _template(
    path: Path, table: dict[str, Any], rest_angles: Tensor | None
) -> Float[Tensor, "joint=15 axis=3"]:
    """Zero of a table, radians: its own `template`, or else the rest pose of the hand model."""
    if "template" in table:
        own = table["template"]
        if not isinstance(own, dict) or not all(isinstance(row, dict) for row in own.values()):
            raise ValueError(
                f"{path}: `template` is {own!r:.200}, expected bend, splay and twist in degrees by joint."
            )
        rows = [
            [
                _degrees(path, f"template {joint} {axis}", own.get(joint, {}).get(axis, 0.0))
                for axis in AXES
            ]
            for joint in ARTICULATED
        ]
        return torch.tensor(rows).deg2rad()
    if rest_angles is None:
        raise ValueError(
            f"{path} counts angles from the hand's template and has no `template:` of its own, so "
            "`rest_angles` must be given: pass the hand model's."
        )
    return rest_angles.float()


def table_path(name_or_path: str) -> Path:
    """Path of a table.

    Raises:
        FileNotFoundError: Neither a shipped table nor a file.
    """
    shipped = TABLES / f"{name_or_path}.yaml"
    for candidate in (shipped, Path(name_or_path)):
        if candidate.is_file():
            return candidate
    names = sorted(path.stem for path in TABLES.glob("*.yaml"))
    raise FileNotFoundError(
        f"No range-of-motion table {name_or_path!r}: it is neither one of {names} nor a file."
    )


def _check_names(path: Path, rows: dict[str, dict[str, list[object]]]) -> None:
    missing = [joint for joint in ARTICULATED if joint not in rows]
    unknown = [str(joint) for joint in rows if joint not in ARTICULATED]
    if missing or unknown:
        raise ValueError(
            f"{path}: joints missing {missing}, joints unknown {unknown}. "
            f"A table has one row for each of {list(ARTICULATED)}."
        )
    for joint in ARTICULATED:
        if not isinstance(rows[joint], dict) or set(rows[joint]) != set(AXES):
            found = list(rows[joint]) if isinstance(rows[joint], dict) else rows[joint]
            raise ValueError(f"{path}: {joint} has axes {found!r:.200}, expected {list(AXES)}.")


def _bounds(path: Path, table: dict[str, Any], joint: str, axis: str) -> tuple[float, float]:
    """Lower and upper bound of one row, radians."""
    row = table["joints"][joint][axis]
    if not isinstance(row, list) or len(row) not in (3, 4):
        raise ValueError(
            f"{path}: {joint} {axis} is {row!r:.200}, expected [minimum, maximum, source] in degrees, or "
            "[minimum, maximum, source of the minimum, source of the maximum]."
        )
    for source in map(str, row[2:]):
        if source not in (table.get("sources") or {}):
            raise ValueError(
                f"{path}: {joint} {axis} names the source {source!r}, which `sources:` does not explain."
            )
    lower, upper = (
        _degrees(path, f"{joint} {axis}", row[0]),
        _degrees(path, f"{joint} {axis}", row[1]),
    )
    if not -180 <= lower <= upper <= 180:
        raise ValueError(
            f"{path}: {joint} {axis} goes from {lower} to {upper} degrees; the minimum must not exceed "
            "the maximum and both lie within ±180."
        )
    return math.radians(lower), math.radians(upper)


def _degrees(path: Path, name: str, value: object) -> float:
    """A bound as a number; text such as 1e1 is one, too."""
    try:
        return float(value)  # type: ignore[arg-type]  # the user's
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(
            f"{path}: {name} is {value!r:.80}, expected a number of degrees."
        ) from error


def _reference(path: Path, table: dict[str, Any]) -> str:
    reference = str(table.get("reference"))
    if reference not in REFERENCES:
        raise ValueError(f"{path}: `reference` is {reference!r}, expected one of {REFERENCES}.")
    return reference
