"""Landmarks of known hands in a file, and `hand_recon.fit` composed for a folder of a test."""

import json
from pathlib import Path
from typing import Any

import torch
from omegaconf import DictConfig, open_dict

from hand_recon.camera import project
from hand_recon.hand.model import HandModel
from tests.support.configurations import composed
from tests.support.views import known_hands, views

CAMERA = [[700.0, 0.0, 320.0], [0.0, 700.0, 240.0], [0.0, 0.0, 1.0]]
SMALL = ("descent.steps=30", "results.meshes=1", "results.pictures=1", "threads=1")


def asked(output: Path, *overrides: str) -> DictConfig:
    """`conf/fit.yaml` composed for a folder of ours."""
    config = composed(*SMALL, *overrides, f"output={output}", name="fit")
    with open_dict(config):
        del config["hydra"]
    return config


def seen(hand: HandModel, count: int = 3) -> tuple[torch.Tensor, torch.Tensor]:
    """Landmarks of right hands before `CAMERA`, and where they are in 3D."""
    batch = views(hand, known_hands(hand, count))
    assert batch.landmarks_3d is not None
    camera = torch.tensor(CAMERA).expand(count, 3, 3)
    return project(batch.landmarks_3d, camera), batch.landmarks_3d


def write_landmarks(hand: HandModel, folder: Path) -> Path:
    """Write a whole hand, a left one with landmarks missing, one of too few landmarks, and their camera."""
    pixels, _ = seen(hand)
    pixels[1, :, 0] = 2 * CAMERA[0][2] - pixels[1, :, 0]  # The same hand in a mirror.
    points: list[list[list[float] | None]] = [
        [[*point, 0.9] for point in hand_points] for hand_points in pixels.tolist()
    ]
    points[1][3] = points[1][8] = None
    points[2][3:] = [None] * 18
    entries: list[dict[str, Any]] = [
        {"name": name, "side": side, "landmarks": given}
        for name, side, given in zip("abc", ("right", "left", "right"), points, strict=True)
    ]
    path = folder / "hands.json"
    path.write_text(json.dumps(entries))
    (folder / "K.json").write_text(json.dumps(CAMERA))
    return path


def entries_of(folder: Path) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads((folder / "hands.json").read_text())
    return found
