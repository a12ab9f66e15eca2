"""DexYCB's eight cameras around a table, and their calibration files."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import yaml
from jaxtyping import Float

from hand_recon.data.dexycb.files import SERIALS, SIZE

EXTRINSICS: Final = "20200702_151821"
"""Name of the only arrangement of the cameras."""

_DUMPER: Final = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
"""Ten times as fast where libyaml is there."""


@dataclass(frozen=True)
class Cameras:
    """The eight cameras."""

    intrinsics: Float[np.ndarray, "camera=8 3 3"]
    poses: Float[np.ndarray, "camera=8 3 4"]
    """From the camera's frame to the world's."""


def write_cameras(folder: Path, random: np.random.Generator) -> Cameras:
    """Draw the cameras and write `calibration/intrinsics` and `calibration/extrinsics_…`.

    Args:
        folder: `calibration`.
        random: Source of focal lengths, principal points and heights.
    """
    height, width = SIZE
    intrinsics, poses = np.tile(np.eye(3), (8, 1, 1)), np.empty((8, 3, 4))
    for camera, serial in enumerate(SERIALS):
        focal = 615.0 + random.uniform(-5, 5, size=2)
        centre = np.array([width, height]) / 2 + random.uniform(-8, 8, size=2)
        intrinsics[camera, [0, 1], [0, 1]], intrinsics[camera, :2, 2] = focal, centre
        numbers = dict(zip(("fx", "fy", "ppx", "ppy"), [*focal, *centre], strict=True))
        numbers = {name: float(value) for name, value in numbers.items()}
        path = folder / "intrinsics" / f"{serial}_{width}x{height}.yml"
        write_yaml(path, {"color": numbers, "depth": numbers})
        poses[camera] = _looking_inwards(camera * 2 * np.pi / len(SERIALS), random.uniform(0.2, 1))
    extrinsics = {
        serial: pose.ravel().tolist() for serial, pose in zip(SERIALS, poses, strict=True)
    }
    extrinsics["apriltag"] = np.eye(3, 4).ravel().tolist()
    path = folder / f"extrinsics_{EXTRINSICS}" / "extrinsics.yml"
    write_yaml(path, {"extrinsics": extrinsics, "master": SERIALS[2]})
    return Cameras(intrinsics, poses)


def _looking_inwards(azimuth: float, elevation: float) -> Float[np.ndarray, "3 4"]:
    """The pose of a camera 0.8 m from the origin that looks at it, upright; the world's z is up."""
    level = np.cos(elevation)
    out = np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])
    right = np.cross(-out, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return np.column_stack([right, np.cross(-out, right), -out, 0.8 * out])


def write_yaml(path: Path, content: Mapping[str, object]) -> None:
    """Write one of the dataset's small files, and the folders that it needs."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(yaml.dump(dict(content), Dumper=_DUMPER), encoding="utf-8")
