"""Writes, reads and compares the provenance of runs."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from hand_recon.data.whole_files import replaced_when_whole
from hand_recon.runs.provenance.code_state import code_state
from hand_recon.runs.provenance.data_manifest import data_manifests
from hand_recon.runs.provenance.machine import hardware

PROVENANCE_FILE: Final = "provenance.json"
"""File of a run's provenance."""

DIFF_FILE: Final = "git.diff"
"""File of the changes of the checkout, where there were some."""

OF_THE_MACHINE: Final = ("hardware", "used")
"""Entries that are told where they differ, but never refused."""

PACKAGES_THAT_COUNT: Final = frozenset(
    {
        "torch", "torchvision", "lightning", "pytorch-lightning", "torchmetrics", "numpy", "scipy", "trimesh",
        "embreex", "opencv-python-headless", "pillow", "timm", "hydra-core", "omegaconf",
    }
)  # fmt: skip
"""Packages that losses may depend on; others are told, not refused."""


def provenance(config: Mapping[str, Any]) -> tuple[dict[str, Any], str]:
    """Provenance of a run that begins now, and the patch of its checkout.

    Args:
        config: The run's resolved configuration.
    """
    code = code_state()
    found = {"code": code.entries(), "data": data_manifests(config), "hardware": hardware()}
    return found, code.diff


def write_provenance(folder: Path, content: Mapping[str, Any], diff: str = "") -> None:
    """Write the provenance of a run in its folder, and the patch of the checkout if there is one."""
    if diff:
        (folder / DIFF_FILE).write_text(diff, encoding="utf-8")
    with replaced_when_whole(folder / PROVENANCE_FILE) as unfinished:
        unfinished.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def read_provenance(folder: Path) -> dict[str, Any] | None:
    """Read the provenance of a run; None if its folder has none, as of versions before 0.3."""
    try:
        content = json.loads((folder / PROVENANCE_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return content if isinstance(content, dict) else None


def add_used(folder: Path, used: Mapping[str, float]) -> None:
    """Add time and memory to the provenance of a run that has ended."""
    content = read_provenance(folder)
    if content is not None:
        write_provenance(folder, content | {"used": dict(used)})


def differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> tuple[list[str], list[str]]:
    """Differences of two provenances: those that losses may depend on, and others.

    Args:
        before: Of the earlier run.
        now: Of the later one.

    Returns:
        Sentences without a full stop, such as `code.packages.torch was 2.11, is 2.12`.
    """
    counting: list[str] = []
    others: list[str] = []
    first, second = dict(_leaves(before)), dict(_leaves(now))
    for name in sorted(first.keys() | second.keys()):
        was, is_now = first.get(name), second.get(name)
        if was != is_now and not name.endswith((".path", ".files_read")):
            told = f"{name} was {_short(was)}, is {_short(is_now)}"
            (counting if _counts(name) else others).append(told)
    return counting, others


def _counts(name: str) -> bool:
    if name.startswith(OF_THE_MACHINE):
        return False
    prefix = "code.packages."
    return not name.startswith(prefix) or name.removeprefix(prefix) in PACKAGES_THAT_COUNT


def _leaves(node: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in node.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{above}{key}.")
        else:
            yield f"{above}{key}", value


def _short(value: object) -> str:
    text = "absent" if value is None else str(value)
    return f"{text[:12]}…" if len(text) == 64 else text
