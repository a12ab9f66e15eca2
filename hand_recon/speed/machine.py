"""Description of the machine that a benchmark ran on."""

import os
import platform
from pathlib import Path

import torch

from hand_recon import __version__


def describe() -> dict[str, str | int | float]:
    """Processor, cores, memory, accelerator, versions, and the load at this moment."""
    description: dict[str, str | int | float] = {
        "processor": _processor(),
        "cores": os.cpu_count() or 0,
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "torch": torch.__version__,
        "vector instructions": torch.backends.cpu.get_cpu_capability(),
        "hand_recon": __version__,
    }
    if torch.cuda.is_available():
        description["accelerator"] = torch.cuda.get_device_name()
    if hasattr(os, "getloadavg"):
        description["load"] = round(os.getloadavg()[0], 1)
    return description


def _processor() -> str:
    """Name of the processor's model; of its architecture where the system does not tell."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()
