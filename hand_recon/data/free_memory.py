"""Memory of a device that is free."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import torch

_ROOT: Final = Path("/")


def free_memory(device: torch.device, root: Path = _ROOT) -> int | None:
    """Bytes that processes can still take; None where the system does not say.

    The limits of Linux' control groups, by which containers and schedulers hold a process, count as well as
    the machine's memory. Files that the system keeps in memory count as free, since it gives them up.

    Args:
        device: Main memory for `cpu`, else that of an NVIDIA GPU.
        root: Folder that has `proc` and `sys` in it.
    """
    if device.type == "cuda":
        return int(torch.cuda.mem_get_info(device)[0])
    if device.type != "cpu":
        return None
    known = [_of_machine(root), *(_of_group(*files) for files in _groups(root))]
    return min((value for value in known if value is not None), default=None)


def _of_machine(root: Path) -> int | None:
    try:
        lines = (root / "proc/meminfo").read_text().splitlines()
        values = dict(line.split(":", 1) for line in lines if ":" in line)
        return 1024 * int(values["MemAvailable"].split()[0])
    except (OSError, KeyError, ValueError, IndexError):
        return None


def _groups(root: Path) -> Iterator[tuple[Path, Path, Path]]:
    """Files of the limit, the use and its parts, of each control group around this process."""
    system = root / "sys/fs/cgroup"
    try:
        lines = (root / "proc/self/cgroup").read_text().splitlines()
    except OSError:
        lines = []
    # In a container, the group's name may be that of the machine outside: its root is the container's.
    first, second = {Path()}, {Path()}
    for line in lines:
        _, controllers, name = (*line.split(":", 2), "", "")[:3]
        found = {Path(name.lstrip("/")), *Path(name.lstrip("/")).parents}
        if controllers == "":
            second |= found
        elif "memory" in controllers.split(","):
            first |= found
    for path in sorted(second):
        folder = system / path
        yield folder / "memory.max", folder / "memory.current", folder / "memory.stat"
    for path in sorted(first):
        folder = system / "memory" / path
        yield (
            folder / "memory.limit_in_bytes",
            folder / "memory.usage_in_bytes",
            folder / "memory.stat",
        )


def _of_group(limit: Path, used: Path, parts: Path) -> int | None:
    try:
        most, taken = int(limit.read_text()), int(used.read_text())
        kinds = dict(line.split() for line in parts.read_text().splitlines())
        second = "file" in kinds
        files = kinds["file"] if second else kinds["total_cache"]
        # Files of file systems in memory cannot be given up.
        shared = kinds.get("shmem" if second else "total_shmem", "0")
        return most - taken + int(files) - int(shared)
    except (OSError, KeyError, ValueError):
        # "max" is no number: there is no limit.
        return None
