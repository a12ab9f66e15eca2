"""Checks software, devices, disk, datasets and caches, and names the next command to type."""

import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Final

from omegaconf import DictConfig
from rich.console import Console
from rich.table import Table

from hand_recon.inspection.caches import look_at_caches
from hand_recon.inspection.datasets import look_at_datasets, look_at_mano
from hand_recon.inspection.finding import Finding
from hand_recon.inspection.machine import (
    look_at_backbone_weights,
    look_at_devices,
    look_at_disk,
    look_at_versions,
)

MARKS: Final = {"good": "[green]✓[/green]", "absent": "[yellow]–[/yellow]", "wrong": "[red]✗[/red]"}
"""Symbol of each state."""


COMMANDS: Final = ("python ", "make ")
"""First words of cures that are commands; other cures are advice."""


def examine(config: DictConfig) -> dict[str, list[Finding]]:
    """Run every check, by section.

    Args:
        config: `conf/doctor.yaml` composed.
    """
    cache, output = (Path(config.paths[name]).expanduser() for name in ("cache", "output"))
    folders = [config.folder] + ([config.dexycb] if config.dexycb else [])
    return {
        "Versions": look_at_versions(),
        "Devices": look_at_devices(),
        "Disk": [look_at_disk("Caches", cache), look_at_disk("Runs", output)],
        "Licensed and downloaded": [
            *look_at_mano(Path(config.mano).expanduser()),
            *(one for folder in folders for one in look_at_datasets(Path(folder).expanduser())),
            look_at_backbone_weights(),
        ],
        "Caches": look_at_caches(cache),
    }


def next_command(sections: dict[str, list[Finding]]) -> str:
    """Next command to type: repair what is broken, else check the data that are there, else the first run."""
    findings = [finding for section in sections.values() for finding in section]
    commands = [one for one in findings if one.cure.startswith(COMMANDS)]
    broken = [one for one in commands if one.state == "wrong"]
    waiting = [one for one in commands if one.state == "absent" and "not converted" in one.found]
    datasets = [one for one in commands if one.state == "good"]
    # Datasets of the user's own, and incomplete ones.
    partial = [one for one in commands if one.state == "absent" and "prepare check" in one.cure]
    for candidates in (broken, waiting, datasets, partial):
        if candidates:
            return candidates[0].cure
    return "python -m hand_recon.train"


def show(sections: dict[str, list[Finding]], console: Console) -> None:
    """Print the findings as tables, and the next command."""
    for title, findings in sections.items():
        table = Table(
            title=title, title_justify="left", show_header=False, box=None, pad_edge=False
        )
        table.add_column(width=1)
        table.add_column(no_wrap=True)
        table.add_column(overflow="fold")
        for finding in findings:
            text = finding.found + (f"\n[dim]→ {finding.cure}[/dim]" if finding.cure else "")
            table.add_row(MARKS[finding.state], finding.subject, text)
        console.print(table)
        console.print()
    console.print(f"Next: [bold]{next_command(sections)}[/bold]", soft_wrap=True)


def doctor(config: DictConfig) -> bool:
    """Run the checks and print them.

    Args:
        config: `conf/doctor.yaml` composed.

    Returns:
        Whether nothing is broken; what is only absent is not.
    """
    sections = examine(config)
    if config.json:
        content = {title: [asdict(one) for one in found] for title, found in sections.items()}
        sys.stdout.write(json.dumps({**content, "next": next_command(sections)}, indent=2) + "\n")
    else:
        # Commands are copied from the output, so lines of a log are not broken.
        width = None if sys.stdout.isatty() else 200
        show(sections, Console(highlight=False, width=width))
    return all(one.state != "wrong" for found in sections.values() for one in found)


def doctor_command(config: DictConfig) -> None:
    """Run the checks; exit with status 1 if something is broken.

    Args:
        config: `conf/doctor.yaml` composed.

    Raises:
        SystemExit: Something is broken.
    """
    if not doctor(config):
        raise SystemExit(1)
