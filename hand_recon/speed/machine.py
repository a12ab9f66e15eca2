"""Description of the machine that a benchmark ran on."""

import os
import platform

import torch

from hand_recon import __version__
from hand_recon.command_line.processor import processor_name


def describe() -> dict[str, str | int | float]:
    """Processor, cores, memory, accelerator, versions, and the load at this moment."""
    description: dict[str, str | int | float] = {
        "processor": processor_name(),
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
