"""Eight cameras around a table as in DexYCB, and their calibration files."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import yaml
from jaxtyping import Float

from hand_recon.data.dexycb.files import SERIALS, SIZE

EXTRINSICS: Final = "20200702_151821"
"""Name of the extrinsic calibration that all sequences use."""

_DUMPER: Final = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
"""YAML dumper; libyaml's, if installed, is ten times as fast."""


@dataclass(frozen=True)
class Cameras:
    """Calibration of the eight cameras."""

    intrinsics: Float[np.ndarray, "camera=8 3 3"]
    """Camera matrices, pixels."""
    poses: Float[np.ndarray, "camera=8 3 4"]
    """Rotation and translation from the camera's frame to the world's, metres."""


def write_cameras(folder: Path, random: np.random.Generator) -> Cameras:
    """Draw the cameras and write `calibration/intrinsics` and `calibration/extrinsics_…`.

    Args:
        folder: The folder `calibration`.
        random: Source of randomness for focal lengths, principal points and heights.
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
    """Pose of an upright camera that looks at the origin from 0.8 m; the world's z axis points up."""
    level = np.cos(elevation)
    out = np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])
    right = np.cross(-out, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return np.column_stack([right, np.cross(-out, right), -out, 0.8 * out])


def write_yaml(path: Path, content: Mapping[str, object]) -> None:
    """Write a YAML file, and create its parent folders."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(yaml.dump(dict(content), Dumper=_DUMPER), encoding="utf-8")
