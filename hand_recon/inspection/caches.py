"""Caches on the disk: their sizes, and crops whose dataset was changed or deleted."""

import json
from dataclasses import dataclass
from pathlib import Path

from hand_recon.inspection.finding import Finding


@dataclass(frozen=True)
class CropMap:
    """A cache entry of one dataset's decoded crops."""

    folder: Path
    """The entry's folder."""
    dataset: str
    """Name of the dataset and part."""
    root: str
    """The dataset's folder."""
    fingerprint: str
    """Fingerprint of the dataset when they were decoded."""
    count: int
    """Number of crops."""

    @property
    def size(self) -> int:
        """Size on the disk, bytes."""
        return sum(path.stat().st_size for path in self.folder.iterdir())


def crop_maps(cache: Path) -> list[CropMap]:
    """All decoded crops in a cache, one entry per dataset and version of it.

    Args:
        cache: `paths.cache`.
    """
    maps = []
    for manifest in sorted((cache / "pictures").glob("*/manifest.json")):
        content = json.loads(manifest.read_text())
        if {"dataset", "root", "fingerprint", "count"} <= content.keys():
            maps.append(
                CropMap(
                    manifest.parent,
                    content["dataset"],
                    content["root"],
                    content["fingerprint"],
                    content["count"],
                )
            )
    return maps


def stale_maps(cache: Path, dataset: str, root: Path, fingerprint: str) -> list[CropMap]:
    """Crops that were decoded before their dataset was changed, and that no run reads any more.

    Args:
        cache: `paths.cache`.
        dataset: Name of the dataset and part.
        root: Its folder.
        fingerprint: Its present fingerprint.
    """
    return [
        one
        for one in crop_maps(cache)
        if (one.dataset, one.root) == (dataset, str(root)) and one.fingerprint != fingerprint
    ]


def look_at_caches(cache: Path) -> list[Finding]:
    """Size of the cache, and crops in it whose dataset is gone."""
    if not cache.is_dir():
        return [Finding("Cache", "absent", f"none yet at {cache}; made when needed")]
    files = [path for path in cache.rglob("*") if path.is_file()]
    total = sum(path.stat().st_size for path in files)
    findings = [Finding("Cache", "good", f"{total / 1e9:.1f} GB in {cache}; delete it at any time")]
    findings += [
        Finding(
            f"Crops of {one.dataset}",
            "good",
            f"{one.count} from {one.root}, {one.size / 1e9:.1f} GB",
        )
        for one in crop_maps(cache)
        if Path(one.root).is_dir()
    ]
    findings += [
        Finding(
            f"Crops of {one.dataset}", "absent",
            f"{one.root} is gone; {one.size / 1e9:.1f} GB are unused", f"rm -r {one.folder}",
        )
        for one in crop_maps(cache)
        if not Path(one.root).is_dir()
    ]  # fmt: skip
    return findings
