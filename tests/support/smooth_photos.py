"""Smooth images in two folders, with 2D landmarks of hands of both sides in files for training and test."""

import json
from pathlib import Path

import cv2
import numpy as np


def smooth(height: int, width: int, seed: int) -> np.ndarray:
    """An image like a photograph: smooth, without black."""
    rough = np.random.default_rng(seed).uniform(40, 220, (6, 6, 3)).astype(np.float32)
    large = cv2.resize(rough, (width, height), interpolation=cv2.INTER_CUBIC)
    return large.clip(1, 255).astype(np.uint8)


def hands_folder(root: Path, count: int = 6) -> Path:
    """Photographs of both sides in two folders, with their landmarks, in a file."""
    entries = []
    random = np.random.default_rng(3)
    for number in range(count):
        name = f"{('waves', 'fists')[number % 2]}/photo {number}.png"
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(root / name), smooth(90, 120, number))
        points = random.uniform((20, 10), (100, 80), (21, 2)).round(2)
        side = ("left", "right")[number % 3 == 0]
        entries.append({"image": name, "side": side, "landmarks": points.tolist()})
    for name, chosen in (("train.json", entries[2:]), ("test.json", entries[:2])):
        (root / name).write_text(json.dumps(chosen))
    return root
