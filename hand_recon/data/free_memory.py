"""Memory of a device that is free."""

from pathlib import Path
from typing import Final

import torch

_SYSTEM: Final = Path("/proc/meminfo")
_GROUP: Final = Path("/sys/fs/cgroup")


def free_memory(device: torch.device, system: Path = _SYSTEM, group: Path = _GROUP) -> int | None:
    """Bytes that a process can still take; None where the system does not say.

    A container's limit counts as well as the machine's memory. Files that the system keeps in memory count as
    free, since it gives them up.

    Args:
        device: Main memory for `cpu`, else that of an NVIDIA GPU.
        system: Linux' table of the machine's memory.
        group: Folder of the control group, which holds a container's limit.
    """
    if device.type == "cuda":
        return int(torch.cuda.mem_get_info(device)[0])
    if device.type != "cpu":
        return None
    known = [value for value in (_of_machine(system), _of_group(group)) if value is not None]
    return min(known, default=None)


def _of_machine(system: Path) -> int | None:
    try:
        lines = system.read_text().splitlines()
        values = dict(line.split(":", 1) for line in lines if ":" in line)
        return 1024 * int(values["MemAvailable"].split()[0])
    except (OSError, KeyError, ValueError, IndexError):
        return None


def _of_group(group: Path) -> int | None:
    try:
        limit = (group / "memory.max").read_text().strip()
        used = int((group / "memory.current").read_text())
        cached = dict(line.split() for line in (group / "memory.stat").read_text().splitlines())
        return int(limit) - used + int(cached["file"])
    except (OSError, KeyError, ValueError):
        # "max" is no number: there is no limit.
        return None
