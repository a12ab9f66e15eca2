"""Functions that read and edit folders in DexYCB's layout without the loader."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import yaml

from hand_recon.data.dexycb.files import SUBJECTS


def read_npz(path: Path) -> dict[str, np.ndarray]:
    """The arrays of a label file, by name."""
    with np.load(path, allow_pickle=False) as archive:
        return {name: archive[name] for name in archive.files}


def label_of(root: Path, source: str) -> dict[str, np.ndarray]:
    """The label that belongs to an image."""
    image = root / source
    return read_npz(image.with_name(image.stem.replace("color", "labels") + ".npz"))


def meta_of(root: Path, source: str) -> dict[str, list[str]]:
    """The `meta.yml` of an image's sequence."""
    meta: dict[str, list[str]] = yaml.safe_load(
        (root / source).parents[1].joinpath("meta.yml").read_text()
    )
    return meta


def camera_of(root: Path, source: str) -> np.ndarray:
    """The intrinsic matrix of an image's camera."""
    serial = Path(source).parent.name
    path = root / "calibration" / "intrinsics" / f"{serial}_640x480.yml"
    numbers = yaml.safe_load(path.read_text())["color"]
    return np.array([
        [numbers["fx"], 0, numbers["ppx"]], [0, numbers["fy"], numbers["ppy"]], [0, 0, 1],
    ])  # fmt: skip


def edit_labels(root: Path, change: Callable[[dict[str, np.ndarray]], None]) -> None:
    """Change every label in place."""
    for path in sorted(root.glob("2*/*/*/labels_*.npz")):
        label = read_npz(path)
        change(label)
        np.savez(path, **label)  # type: ignore[arg-type]  # the arrays are named


def first_sequence(root: Path, subject: int, every: int = 1) -> Path:
    """The folder of a subject's sequence number `every`."""
    return sorted((root / SUBJECTS[subject]).iterdir())[every]
