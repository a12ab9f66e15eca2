"""The caches: how large they are, and which no run uses any more because what they were made from changed."""

import json
from dataclasses import dataclass
from pathlib import Path

from hand_recon.inspection.finding import Finding


@dataclass(frozen=True)
class CropMap:
    """Decoded crops on the disk."""

    folder: Path
    """Where they are."""
    dataset: str
    """Name of the dataset and part."""
    root: str
    """The dataset's folder."""
    fingerprint: str
    """Of the dataset when they were decoded."""
    count: int
    """Crops."""

    @property
    def size(self) -> int:
        """Bytes."""
        return sum(path.stat().st_size for path in self.folder.iterdir())


def crop_maps(cache: Path) -> list[CropMap]:
    """All maps of decoded crops in a cache.

    Args:
        cache: `paths.cache`.
    """
    maps = []
    for manifest in sorted((cache / "pictures").glob("*/manifest.json")):
        told = json.loads(manifest.read_text())
        if {"dataset", "root", "fingerprint", "count"} <= told.keys():
            maps.append(
                CropMap(
                    manifest.parent,
                    told["dataset"],
                    told["root"],
                    told["fingerprint"],
                    told["count"],
                )
            )
    return maps


def stale_maps(cache: Path, dataset: str, root: Path, fingerprint: str) -> list[CropMap]:
    """Maps of a dataset that was changed since: nothing reads them.

    Args:
        cache: `paths.cache`.
        dataset: Name of the dataset and part.
        root: Its folder.
        fingerprint: What it is now.
    """
    return [
        one
        for one in crop_maps(cache)
        if (one.dataset, one.root) == (dataset, str(root)) and one.fingerprint != fingerprint
    ]


def look_at_caches(cache: Path) -> list[Finding]:
    """How large the cache is, and what of it is of no use."""
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
            f"{one.root} is gone; {one.size / 1e9:.1f} GB lie unused", f"rm -r {one.folder}",
        )
        for one in crop_maps(cache)
        if not Path(one.root).is_dir()
    ]  # fmt: skip
    return findings
