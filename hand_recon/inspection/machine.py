"""The machine: versions, processors, accelerators, room on the disks."""

import importlib.metadata
import os
import platform
import shutil
from pathlib import Path
from typing import Final

import torch

from hand_recon.inspection.finding import Finding

PACKAGES: Final = (
    "torch", "torchvision", "lightning", "torchmetrics", "hydra-core", "numpy", "opencv-python-headless",
    "trimesh",
)  # fmt: skip
"""Whose versions are told."""

REFUSED: Final = {"lightning": ("2.6.2", "2.6.3")}
"""Releases that were malware (GHSA-w37p-236h-pfx3)."""

ROOM: Final = 5e9
"""Bytes that should be free for caches: decoded FreiHAND at 96 pixels takes 3.6 GB."""


def look_at_versions() -> list[Finding]:
    """Python and the packages that matter."""
    findings = [Finding("Python", "good", f"{platform.python_version()} on {platform.system()}")]
    for package in PACKAGES:
        try:
            version = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            findings.append(Finding(package, "wrong", "not installed", "make env"))
            continue
        if version in REFUSED.get(package, ()):
            cure = "Remove it, change every secret that this machine knows, then `make env`."
            findings.append(Finding(package, "wrong", f"{version}: this release was malware", cure))
        else:
            findings.append(Finding(package, "good", version))
    return findings


def look_at_devices() -> list[Finding]:
    """What can compute."""
    usable = getattr(os, "sched_getaffinity", lambda _: range(os.cpu_count() or 1))
    findings = [Finding("CPU", "good", f"{len(usable(0))} cores usable")]
    for number in range(torch.cuda.device_count()):
        device = torch.cuda.get_device_properties(number)
        memory = device.total_memory / 2**30
        findings.append(Finding(f"GPU {number}", "good", f"{device.name}, {memory:.0f} GiB"))
    if torch.backends.mps.is_available():
        findings.append(Finding("GPU", "good", "Apple's, through MPS"))
    if len(findings) == 1:
        cure = "" if torch.version.cuda is None else "If there is one, look at its driver."
        findings.append(Finding("GPU", "absent", "none that PyTorch can use", cure))
    return findings


def look_at_disk(name: str, folder: Path) -> Finding:
    """Room where something will be written.

    Args:
        name: What will be written.
        folder: Where; it need not exist yet.
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
    """Whether torchvision's ImageNet weights of the paper's backbone are on this machine."""
    folder = Path(torch.hub.get_dir()) / "checkpoints"
    found = sorted(path.name for path in folder.glob("resnet50-*.pth"))
    if found:
        return Finding("ImageNet weights", "good", ", ".join(found))
    cure = (
        "Downloaded at the first run of model=resnet50; without network give model.encoder.weights=<file>, "
        "or model.encoder.weights=none to start from nothing."
    )
    return Finding("ImageNet weights", "absent", f"no resnet50 in {folder}", cure)
