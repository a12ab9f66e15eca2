"""Four photographs, a file of the landmarks in them, and what `predict` makes of them."""

import csv
import json
from importlib.resources import files
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from omegaconf import DictConfig, open_dict
from PIL import Image

from hand_recon.camera import project
from hand_recon.hand.model import HandModel
from tests.support.configurations import composed
from tests.support.views import known_hands, views

CAMERA = [[700.0, 0.0, 320.0], [0.0, 700.0, 240.0], [0.0, 0.0, 1.0]]
QUICK = ("descent.steps=20", "descent.starts=1")
SCHEMA = json.loads((files("hand_recon.fitting") / "hands.schema.json").read_text(encoding="utf-8"))


def asked(folder: Path, *overrides: str, detector: tuple[str, ...] = ()) -> DictConfig:
    """`conf/predict.yaml` composed for the photographs of a folder; by default with our landmarks."""
    landmarks = ("detector=landmarks", f"detector.landmarks='{folder}/found.json'")
    config = composed(
        f"input=['{folder}/photos']", *(detector or landmarks), f"camera='{folder}/K.json'",
        f"output='{folder}/out'", *QUICK, *overrides, name="predict",
    )  # fmt: skip
    with open_dict(config):
        del config["hydra"]
    return config


def photo_folder(hand: HandModel, tmp_path: Path) -> Path:
    """Four photographs: two hands, none, one left hand under an odd name, and a file that is cut off."""
    batch = views(hand, known_hands(hand, 3))
    assert batch.landmarks_3d is not None
    points = project(batch.landmarks_3d, torch.tensor(CAMERA).expand(3, 3, 3))
    points[2, :, 0] = 2 * CAMERA[0][2] - points[2, :, 0]  # The same hand in a mirror.
    (tmp_path / "photos").mkdir()
    names = ["1 two.png", "2 none.png", "3 hånd's, [left].png", "4 cut off.png"]
    for name in names:
        path = tmp_path / "photos" / name
        path.write_bytes(cv2.imencode(".png", np.full((480, 640, 3), 90, np.uint8))[1].tobytes())
    path.write_bytes(path.read_bytes()[:200])
    entries = [
        {"image": name, "side": side, "landmarks": given}
        for name, side, given in zip(
            (names[0], names[0], names[2]), ("right", "right", "left"), points.tolist(), strict=True
        )
    ]
    (tmp_path / "found.json").write_text(json.dumps(entries), encoding="utf-8")
    (tmp_path / "K.json").write_text(json.dumps(CAMERA))
    return tmp_path


def table(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def read(folder: Path) -> list[dict[str, Any]]:
    entries: list[dict[str, Any]] = json.loads((folder / "hands.json").read_text(encoding="utf-8"))
    return entries


def texture(folder: Path) -> Path:
    """Remove the photograph that is cut off, and give all others a texture, so that crops differ.

    Args:
        folder: A folder of `photos`, which is returned.
    """
    (folder / "photos" / "4 cut off.png").unlink()
    noise = np.random.default_rng(8).integers(0, 255, (24, 32, 3)).astype(np.uint8)
    for path in (folder / "photos").iterdir():
        Image.fromarray(noise).resize((640, 480), Image.Resampling.BICUBIC).save(path)
    return folder


def boxes_of(folder: Path, *, sides: bool = True) -> Path:
    """The boxes of the hands of `found.json` as a file of boxes."""
    entries = json.loads((folder / "found.json").read_text(encoding="utf-8"))
    boxes: list[dict[str, Any]] = []
    for entry in entries:
        points = np.array(entry["landmarks"])
        box = [*points.min(axis=0).tolist(), *points.max(axis=0).tolist()]
        boxes.append({"image": entry["image"], "box": box})
        if sides:
            boxes[-1]["side"] = entry["side"]
    (folder / "boxes.json").write_text(json.dumps(boxes), encoding="utf-8")
    return folder / "boxes.json"


def with_boxes(folder: Path, *, sides: bool = True) -> tuple[str, ...]:
    """Words for boxes in place of landmarks; MediaPipe's models are in no folder that there is."""
    boxes = boxes_of(folder, sides=sides)
    return "detector=boxes", f"detector.boxes='{boxes}'", f"detector.models='{folder}/no models'"
