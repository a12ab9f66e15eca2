"""Checks of the machine: package versions, processors, accelerators, free disk space.

PyTorch is imported only if there is an accelerator to ask it about: importing it takes longer than all
other checks together.
"""

import importlib.metadata
import importlib.util
import os
import platform
import re
import shutil
from pathlib import Path
from typing import Final

from hand_recon.command_line.processor import usable_cores
from hand_recon.inspection.finding import Finding

PACKAGES: Final = (
    "torch", "torchvision", "lightning", "torchmetrics", "hydra-core", "numpy", "opencv-python-headless",
    "trimesh",
)  # fmt: skip
"""Packages whose versions are reported."""

REFUSED: Final = {"lightning": ("2.6.2", "2.6.3")}
"""Releases that were malware (GHSA-w37p-236h-pfx3)."""

ROOM: Final = 5e9
"""Bytes that should be free for caches: decoded FreiHAND at 96 pixels takes 3.6 GB."""

GPU_FILES: Final = ("/proc/driver/nvidia", "/dev/nvidia*", "/dev/nvhost*", "/dev/dxg", "/dev/kfd")
"""Patterns of files that a driver makes: NVIDIA on Linux and Jetson, WSL 2, AMD."""


def look_at_versions() -> list[Finding]:
    """Versions of Python and of `PACKAGES`."""
    findings = [Finding("Python", "good", f"{platform.python_version()} on {platform.system()}")]
    for package in PACKAGES:
        try:
            version = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            findings.append(Finding(package, "wrong", "not installed", "make env"))
            continue
        if version in REFUSED.get(package, ()):
            cure = "Remove it, change every secret stored on this machine, then `make env`."
            findings.append(Finding(package, "wrong", f"{version}: this release was malware", cure))
        else:
            findings.append(Finding(package, "good", version))
    return findings


def look_at_devices() -> list[Finding]:
    """The processor and the accelerators that PyTorch can use."""
    findings = [Finding("CPU", "good", f"{usable_cores()} cores usable")]
    accelerators = _accelerators() if may_have_accelerator() else []
    if not accelerators:
        cure = "If there is one, check its driver." if cuda_of_torch() else ""
        accelerators = [Finding("GPU", "absent", "none that PyTorch can use", cure)]
    return findings + accelerators


def may_have_accelerator() -> bool:
    """False if this machine cannot have an accelerator, found without importing PyTorch.

    True is no promise: only PyTorch knows whether it can use what is there.
    """
    if platform.system() == "Darwin":
        return platform.machine() == "arm64"
    if os.environ.get("CUDA_VISIBLE_DEVICES", "all").strip() in ("", "-1"):
        return False
    root = Path("/")
    return shutil.which("nvidia-smi") is not None or any(
        True for pattern in GPU_FILES for _ in root.glob(pattern.lstrip("/"))
    )


def cuda_of_torch() -> str | None:
    """The CUDA version that the installed PyTorch was built for, read from its `version.py`.

    Returns:
        Such as `12.8`; None for a build without CUDA, and where PyTorch is not installed.
    """
    found = importlib.util.find_spec("torch")
    if found is None or found.origin is None:
        return None
    version = Path(found.origin).with_name("version.py")
    if not version.is_file():
        return None
    text = version.read_text(encoding="utf-8")
    match = re.search(r"^cuda\b[^=\n]*=\s*['\"]([^'\"]+)['\"]", text, flags=re.MULTILINE)
    return None if match is None else match[1]


def _accelerators() -> list[Finding]:
    """The accelerators that PyTorch reports."""
    if importlib.util.find_spec("torch") is None:
        return []
    # Takes seconds: only where a driver or a chip was found.
    import torch

    findings = []
    for number in range(torch.cuda.device_count()):
        device = torch.cuda.get_device_properties(number)
        memory = device.total_memory / 2**30
        findings.append(Finding(f"GPU {number}", "good", f"{device.name}, {memory:.0f} GiB"))
    if torch.backends.mps.is_available():
        findings.append(Finding("GPU", "good", "Apple's, through MPS"))
    return findings


def look_at_disk(name: str, folder: Path) -> Finding:
    """Free space on the disk of a folder.

    Args:
        name: What will be written there.
        folder: It need not exist yet.
    """
    existing = folder.absolute()
    while not existing.exists():
        existing = existing.parent
    free = shutil.disk_usage(existing).free
    found = f"{free / 1e9:.0f} GB free for {folder}"
    if free < ROOM:
        return Finding(
            name, "wrong", found, "Set paths.cache or HAND_RECON_CACHE to a larger disk."
        )
    return Finding(name, "good", found)


def look_at_backbone_weights() -> Finding:
    """ImageNet weights of the paper's backbone in torchvision's download folder."""
    folder = torch_hub_folder() / "checkpoints"
    found = sorted(path.name for path in folder.glob("resnet50-*.pth"))
    if found:
        return Finding("ImageNet weights", "good", ", ".join(found))
    cure = (
        "Downloaded by the first run of model=resnet50; without network give model.encoder.weights=<file>, "
        "or model.encoder.weights=none to train from random weights."
    )
    return Finding("ImageNet weights", "absent", f"no resnet50 in {folder}", cure)


def torch_hub_folder() -> Path:
    """The folder of PyTorch's downloads, as `torch.hub.get_dir()` gives it."""
    cache = os.environ.get("XDG_CACHE_HOME", "~/.cache")
    home = os.environ.get("TORCH_HOME", str(Path(cache) / "torch"))
    return Path(home).expanduser() / "hub"
