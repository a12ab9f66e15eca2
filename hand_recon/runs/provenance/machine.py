"""Hardware of a run, and the time and memory that it took."""

import os
import platform
import sys
import time
from dataclasses import dataclass, field
from typing import Any

import torch

from hand_recon.command_line.precision import computes_in_bfloat16
from hand_recon.command_line.processor import processor_name, usable_cores

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]


def hardware() -> dict[str, Any]:
    """Processor, cores, memory, accelerators and compute threads."""
    return {
        "processor": processor_name(),
        "instructions": torch.backends.cpu.get_cpu_capability(),
        "bfloat16": computes_in_bfloat16(),
        "cores": os.cpu_count(),
        "usable_cores": usable_cores(),
        "memory_gib": _memory(),
        "gpus": [torch.cuda.get_device_name(i) for i in range(torch.cuda.device_count())],
        "cuda": torch.version.cuda,
        "system": platform.platform(),
        "host": platform.node(),
        "threads": torch.get_num_threads(),
    }


@dataclass
class Meter:
    """Wall time since it was made, and the most memory of this process since its start."""

    started: float = field(default_factory=time.monotonic)
    """Seconds of a clock that never goes back."""

    def used(self) -> dict[str, float]:
        """Wall time in seconds; peaks of memory in MiB, of children the largest one's."""
        found = {"wall_seconds": round(time.monotonic() - self.started, 1)}
        if resource is not None:
            # macOS counts bytes, other systems kilobytes.
            unit = 2**20 if sys.platform == "darwin" else 2**10
            own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            children = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
            found["peak_memory_mib"] = round(own / unit, 1)
            found["peak_memory_of_a_child_mib"] = round(children / unit, 1)
        if torch.cuda.is_available():
            found["peak_gpu_memory_mib"] = round(torch.cuda.max_memory_reserved() / 2**20, 1)
        return found


def _memory() -> float | None:
    try:
        return round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30, 1)
    except (AttributeError, ValueError, OSError):
        return None
