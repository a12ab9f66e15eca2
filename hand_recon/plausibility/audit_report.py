"""The report of an audit: files, pictures of the worst hands, the map, the page and its tables."""

import logging
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2

from hand_recon.plausibility.audit import Audit
from hand_recon.plausibility.audit_files import write_report
from hand_recon.plausibility.drawing import draw_hand
from hand_recon.plausibility.natural_map import draw_map, natural_map
from hand_recon.plausibility.page import Page, PageTable, PictureOfHand, write_page
from hand_recon.plausibility.posed_hands import HandModels
from hand_recon.plausibility.repaired_hands import RepairedHands

logger = logging.getLogger(__name__)

PRODUCTS = ("audit.json", "audit.csv", "index.html", "worst", "map.png", "repaired", "config.yaml")
"""Files and folders of a report."""


@dataclass(frozen=True)
class ReportOptions:
    """Content of a report besides the audit."""

    settings: dict[str, Any]
    """Settings of the command."""
    worst: int = 12
    """Number of hands that are drawn."""
    repair: RepairedHands | None = None
    """Repaired hands, if there are any."""


def write_audit(folder: Path, audit: Audit, models: HandModels, options: ReportOptions) -> None:
    """Write everything about an audit but repaired hands.

    Args:
        folder: The report's folder.
        audit: The audit.
        models: Hand models.
        options: What the report holds besides.
    """
    write_report(folder, audit, options.settings, options.repair)
    write_page(
        folder / "index.html",
        Page(
            "Audit of " + ", ".join(Path(name).name for name in options.settings["files"]),
            (*tables(audit), *repair_tables(options.repair)),
            audit.hands.given.notes,
            _map(folder, audit),
            _worst(folder, audit, models, options.worst),
        ),
    )


def repair_tables(repair: RepairedHands | None) -> tuple[PageTable, ...]:
    """Table of repaired hands; none without any.

    Args:
        repair: Repaired hands.
    """
    if repair is None:
        return ()
    rows = [[_words(key), value] for key, value in repair.summary().items()]
    return (PageTable("Repaired hands", ("measure", "value"), rows),)


def _words(key: str) -> str:
    """Words of a key of the summaries."""
    return key.replace("_", " ").replace("percent", "%")


def tables(audit: Audit) -> tuple[PageTable, ...]:
    """Tables of an audit: all hands, joint by joint, and sequences.

    Args:
        audit: The audit.
    """
    summary = audit.summary()
    words = [[_words(key), value] for key, value in summary.items()]
    joints = [list(row.values()) for row in audit.joints()]
    columns = (
        "joint", "axis", "lower °", "upper °", "least °", "median °", "greatest °", "violated %",
        "beyond limit %", "worst °", "anatomy violated %", "anatomy beyond limit %", "anatomy worst °",
    )  # fmt: skip
    sequences = [
        [one.name, one.frames, one.jitter, one.bone, one.bone_variation] for one in audit.sequences
    ]
    return (
        PageTable("All hands", ("measure", "value"), words),
        PageTable("Violations by joint and axis", columns, joints),
        PageTable(
            "Sequences",
            ("sequence", "frames", "jitter, mm/s²", "bone", "its variation %"),
            sequences,
        ),
    )


def terminal_tables(audit: Audit) -> tuple[PageTable, ...]:
    """Tables of an audit in the width of a terminal.

    Args:
        audit: The audit.
    """
    every, _, sequences = tables(audit)
    joints = [
        [
            f"{row['joint']} {row['axis']}",
            f"{row['lower_degrees']:.0f} to {row['upper_degrees']:.0f}",
            *(row[key] for key in _BRIEF),
        ]
        for row in audit.joints()
    ]
    columns = ("joint", "range °", "violated %", "beyond limit %", "worst °", "anatomy, worst °")
    return every, PageTable("Violations by joint and axis", columns, joints), sequences


_BRIEF = (
    "violated_percent",
    "beyond_limit_percent",
    "greatest_violation_degrees",
    "greatest_anatomy_violation_degrees",
)


def _map(folder: Path, audit: Audit) -> str | None:
    if find_spec("matplotlib") is None:
        logger.info("No map: matplotlib is not installed; the extra hand_recon[train] has it.")
        return None
    draw_map(natural_map(audit), folder / "map.png")
    return "map.png"


def _worst(folder: Path, audit: Audit, models: HandModels, count: int) -> list[PictureOfHand]:
    """Draw the hands with the greatest violations, over their limits."""
    badness = audit.badness()
    order = badness.argsort(descending=True, stable=True)[:count].tolist()
    pictures = []
    for place, row in enumerate(order, start=1):
        if float(badness[row]) < 0:
            continue
        target = folder / "worst" / f"{place:03d}.png"
        target.parent.mkdir(exist_ok=True)
        cv2.imwrite(str(target), draw_hand(audit, models, row)[..., ::-1])
        given, verdict = audit.hands.given, audit.verdicts[row]
        side = "left" if bool(audit.hands.left[row]) else "right"
        name = f"{place}. {given.names[row]} ({Path(given.files[row]).name}, {side} hand)"
        pictures.append(PictureOfHand(f"worst/{target.name}", name, verdict.value, verdict.reasons))
    return pictures
