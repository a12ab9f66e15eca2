"""Audits hand poses of any origin, and repairs them (Sec. 3.2)."""

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf
from rich.console import Console
from rich.table import Table
from rich.text import Text

from hand_recon import __version__
from hand_recon.command_line.resolvers import MANO_HAND
from hand_recon.fitting.hands_file import writing_hands
from hand_recon.fitting.hands_tables import write_tables
from hand_recon.knowledge.functional_anatomy import FunctionalAnatomy
from hand_recon.knowledge.ranges import load_ranges
from hand_recon.plausibility.audit import Audit, audited
from hand_recon.plausibility.audit_report import (
    PRODUCTS,
    ReportOptions,
    repair_tables,
    terminal_tables,
    write_audit,
)
from hand_recon.plausibility.findings import Knowledge
from hand_recon.plausibility.page import PageTable, shown
from hand_recon.plausibility.posed_hands import HandModels
from hand_recon.plausibility.repaired_hands import (
    NOT_REPAIRED,
    RepairedHands,
    repaired,
    to_records,
)
from hand_recon.plausibility.verdicts import Limits
from hand_recon.runs.audit.sources import Reading, read_given
from hand_recon.runs.configuration import build_hand, configure_process, plain
from hand_recon.runs.unfinished import free_folder

logger = logging.getLogger(__name__)


def audit(config: DictConfig) -> dict[str, Any]:
    """Audit the hands of files.

    Args:
        config: `conf/audit.yaml` composed.

    Returns:
        The summary of `audit.json`, with `repair` beside it where hands were repaired.

    Raises:
        ValueError: No file was given.
        SystemExit: With `strict`, a hand is implausible, or none was audited.
    """
    if not config.files:
        raise ValueError(
            "No file was given. Type hand-recon audit <hands.json, pred.json, npz, npy or csv>."
        )
    configure_process(config.threads)
    names = [config.files] if isinstance(config.files, str) else list(config.files)
    if config.landmark_set is None:
        config.landmark_set = "mano" if _mano_folder(config) is not None else "knuckle"
    refuse_report(config.output or config.paths.run)
    hand = build_hand(config)
    models = HandModels.of(hand)
    given = read_given(names, hand, _mano_folder(config), _reading(config))
    knowledge = Knowledge(
        load_ranges(config.ranges, hand.rest_angles), FunctionalAnatomy(variant=config.anatomy)
    )
    found = audited(
        given,
        models,
        knowledge,
        Limits(**plain(config.limits)),
        order=config.order,
        side=config.side,
    )
    folder = claim_report(config.output or config.paths.run)
    OmegaConf.save(OmegaConf.create(plain(config)), folder / "config.yaml")
    repair = repaired(found, models) if config.repair else None
    write_audit(folder, found, models, _options(config, names, repair))
    show(found, repair)
    summary: dict[str, Any] = found.summary()
    if repair is not None:
        summary["repair"] = repair.summary()
        left_out = summary["hands"] - summary["repair"]["hands"]
        if left_out:
            logger.warning("%d of %d hands: %s", left_out, summary["hands"], NOT_REPAIRED)
        write_repaired(folder / "repaired", repair)
    logger.info("Open %s", folder / "index.html")
    if not summary["audited"]:
        logger.warning("No hand was audited: none has 12 landmarks or more, or joint angles.")
    if config.strict and (summary["implausible"] or not summary["audited"]):
        raise SystemExit(1)
    return summary


def claim_report(path: str | Path) -> Path:
    """Make the folder of a report.

    Raises:
        FileExistsError: It already holds one.
    """
    folder = refuse_report(path)
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def refuse_report(path: str | Path) -> Path:
    """Check that a folder has none of the files of a report.

    Raises:
        FileExistsError: It has one.
    """
    return free_folder(path, PRODUCTS)


def write_repaired(folder: Path, repair: RepairedHands) -> None:
    """Write repaired hands as a file of hands, with their tables beside it.

    Args:
        folder: Folder to make.
        repair: The hands.
    """
    folder.mkdir()
    records = to_records(repair, __version__)
    with writing_hands(folder / "hands.json") as write:
        write(records)
    write_tables(folder, records)


def show(found: Audit, repair: RepairedHands | None) -> None:
    """Print the tables of an audit, and its notes.

    Args:
        found: The audit.
        repair: Repaired hands, if there are any.
    """
    console = Console()
    for table in (*terminal_tables(found), *repair_tables(repair)):
        if table.rows:
            console.print(_drawn(table))
    for note in found.hands.given.notes:
        console.print(note, style="dim", markup=False)


def _drawn(table: PageTable) -> Table:
    drawn = Table(title=table.title, title_justify="left", header_style="bold")
    for index, heading in enumerate(table.columns):
        drawn.add_column(heading, justify="right" if index else "left")
    for row in table.rows:
        # Names of files may hold brackets, which are no markup.
        drawn.add_row(*(Text(shown(cell)) for cell in row))
    return drawn


def _mano_folder(config: DictConfig) -> Path | None:
    return Path(config.hand.path) if config.hand._target_ == MANO_HAND else None


def _reading(config: DictConfig) -> Reading:
    return Reading(config.sequence, config.same_person, config.fps)


def _options(
    config: DictConfig, names: Sequence[str], repair: RepairedHands | None
) -> ReportOptions:
    keys = ("ranges", "anatomy", "order", "side", "sequence", "same_person", "fps", "landmark_set")
    settings = {"version": __version__, "files": list(names)} | {key: config[key] for key in keys}
    return ReportOptions(settings | {"hand": config.hand._target_}, config.worst, repair)
