"""Numbers of an audit as `audit.json` and `audit.csv` (docs/audit.md has every key)."""

import csv
import io
import json
import math
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from hand_recon.data.whole_files import replaced_when_whole
from hand_recon.hand.skeleton import ARTICULATED, AXES, LANDMARKS
from hand_recon.plausibility.audit import Audit
from hand_recon.plausibility.findings import PHALANGES
from hand_recon.plausibility.repaired_hands import RepairedHands
from hand_recon.plausibility.verdicts import Worst, violations

DECIMALS: Final = 3
"""Decimals of numbers in the files."""

ANGLES: Final = tuple(
    f"{joint} {axis} degrees".replace(" ", "_") for joint in ARTICULATED for axis in AXES
)
"""Columns of the joint angles."""

COLUMNS: Final = (
    "name", "file", "side", "angles", "verdict", "range_joint", "range_axis", "range_degrees",
    "anatomy_joint", "anatomy_axis", "anatomy_degrees", "depth_mm", "deep_vertices", "residual_mm", "bone",
    "bone_percent", "shape_sd", *ANGLES,
)  # fmt: skip
"""Columns of `audit.csv`."""


def write_report(
    folder: Path, audit: Audit, settings: dict[str, Any], repair: RepairedHands | None = None
) -> None:
    """Write `audit.json` and `audit.csv`.

    Args:
        folder: Folder of the report.
        audit: The audit.
        settings: Settings of the command, for the file.
        repair: Repaired hands, if there are any.
    """
    content: dict[str, Any] = {
        "settings": settings,
        "limits": asdict(audit.limits)
        | {"penetration_rate_depth": 1000 * audit.knowledge.tolerance},
        "notes": list(audit.hands.given.notes),
        "summary": audit.summary(),
        "joints": audit.joints(),
        "sequences": [_sequence(asdict(one)) for one in audit.sequences],
        "hands": list(hand_rows(audit)),
    }
    if repair is not None:
        content["repair"] = repair.summary()
        for entry, moved in zip(content["hands"], repair.moved, strict=True):
            entry["moved_mm_mean"] = float(moved.mean())
            entry["moved_mm_greatest"] = float(moved.max())
    with replaced_when_whole(folder / "audit.json") as path:
        path.write_text(
            json.dumps(_finite(content), indent=1, ensure_ascii=False),
            encoding="utf-8",
            # Bytes of names that are no letters become escapes, which JSON has, too.
            errors="backslashreplace",
        )
    with replaced_when_whole(folder / "audit.csv") as path:
        path.write_text(_table(audit), encoding="utf-8", errors="backslashreplace", newline="")


def _sequence(found: dict[str, Any]) -> dict[str, Any]:
    return {
        "name": found["name"],
        "frames": found["frames"],
        "jitter_mm_s2": found["jitter"],
        "bone": found["bone"],
        "bone_variation_percent": found["bone_variation"],
    }


def hand_rows(audit: Audit) -> Iterator[dict[str, Any]]:
    """Objects of the hands in `audit.json`.

    Args:
        audit: The audit.
    """
    found, hands = audit.findings, audit.hands
    for row, verdict in enumerate(audit.verdicts):
        exact = bool(hands.exact[row])
        yield {
            "name": hands.given.names[row],
            "file": hands.given.files[row],
            "side": "left" if bool(hands.left[row]) else "right",
            "angles": "given" if exact else "fitted to points",
            "verdict": verdict.value,
            "reasons": list(verdict.reasons),
            "range_violations": [_violation(one) for one in violations(found, row)],
            "anatomy_violations": [_violation(one) for one in violations(found, row, anatomy=True)],
            "depth_mm": float(found.depth[row]),
            "deep_vertices": float(found.deep[row]),
            "residual_mm": float(found.residual[row]),
            "bone": _worst_bone(audit, row)[0],
            "bone_percent": _worst_bone(audit, row)[1],
            "shape_sd": float(found.shape[row]),
        }


def _violation(one: Worst) -> dict[str, Any]:
    return {
        "joint": one.joint,
        "axis": one.axis,
        "angle_degrees": one.angle,
        "beyond_degrees": one.beyond,
    }


def _worst_bone(audit: Audit, row: int) -> tuple[str | None, float]:
    errors = audit.findings.bone_error[row, list(PHALANGES)]
    if not bool(errors.isfinite().any()):
        return None, math.nan
    worst = int(errors.abs().nan_to_num(-1.0).argmax())
    return LANDMARKS[PHALANGES[worst]], 100 * float(errors[worst])


def _table(audit: Audit) -> str:
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(COLUMNS)
    angles = audit.findings.angles.flatten(1).tolist()
    for row, entry in enumerate(hand_rows(audit)):
        cells = [entry[key] for key in COLUMNS[:5]]
        for kind in ("range_violations", "anatomy_violations"):
            worst = entry[kind][0] if entry[kind] else {}
            cells += [worst.get("joint"), worst.get("axis"), worst.get("beyond_degrees", 0.0)]
        cells += [entry[key] for key in COLUMNS[11:17]]
        writer.writerow([_cell(cell) for cell in (*cells, *angles[row])])
    return stream.getvalue()


def _cell(value: object) -> object:
    if isinstance(value, float):
        return round(value, DECIMALS) if math.isfinite(value) else ""
    return "" if value is None else value


def _finite(value: Any) -> Any:  # noqa: ANN401  # any JSON
    """JSON without NaN: null in its place, numbers rounded."""
    if isinstance(value, float):
        return round(value, DECIMALS) if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _finite(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(one) for one in value]
    return value
