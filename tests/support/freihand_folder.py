"""A small folder in FreiHAND's layout: flat colours, one dot per landmark."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float

SIZE = 64


@dataclass(frozen=True)
class Folder:
    """A written folder with its landmarks, metres, and intrinsics."""

    root: Path
    landmarks: Float[np.ndarray, "hand landmark=21 3"]
    intrinsics: Float[np.ndarray, "hand 3 3"]

    def pixels(self) -> Float[np.ndarray, "hand landmark=21 2"]:
        """Projected landmarks, one hand and landmark at a time."""
        uv = np.empty((*self.landmarks.shape[:2], 2))
        for hand, (points, matrix) in enumerate(zip(self.landmarks, self.intrinsics, strict=True)):
            for landmark, point in enumerate(points):
                u, v, w = matrix @ point
                uv[hand, landmark] = u / w, v / w
        return uv


def write_folder(
    root: Path, hands: int = 20, versions: int = 4, part: str = "training", seed: int = 0
) -> Folder:
    """Write one part with every file but vertices; version v has 40 + 40 v of red."""
    rng = np.random.default_rng(seed)
    landmarks = rng.uniform(-0.06, 0.06, (hands, 21, 3))
    landmarks[:, 10] = landmarks[:, 9]
    landmarks[:, 10, 0] += 0.03
    landmarks[..., 2] += 0.6
    intrinsics = np.tile(np.diag([200.0, 210.0, 1.0]), (hands, 1, 1))
    intrinsics[:, :2, 2] = SIZE / 2 + rng.uniform(-5, 5, (hands, 2))
    folder = Folder(root, landmarks, intrinsics)
    rgb = root / part / "rgb"
    rgb.mkdir(parents=True)
    for version in range(versions):
        for hand, dots in enumerate(folder.pixels()):
            colour = (40 + 40 * version, hand * 10 % 256, 90)
            image = np.full((SIZE, SIZE, 3), colour, dtype=np.uint8)
            for u, v in dots:
                cv2.circle(image, (int(u), int(v)), 1, (255, 255, 255), -1)
            cv2.imwrite(str(rgb / f"{hand + hands * version:08d}.jpg"), image[..., ::-1])
    scale = np.linalg.norm(landmarks[:, 9] - landmarks[:, 10], axis=-1)
    write_json(root / f"{part}_xyz.json", landmarks)
    write_json(root / f"{part}_K.json", intrinsics)
    write_json(root / f"{part}_scale.json", scale)
    return folder


def write_json(path: Path, array: np.ndarray) -> None:
    """Write an array as a nested list, as FreiHAND does."""
    path.write_text(json.dumps(array.tolist()))


def edit_json(path: Path, change: Callable[[np.ndarray], object]) -> None:
    """Change a JSON array in place."""
    array = np.array(json.loads(path.read_text()))
    change(array)
    write_json(path, array)


def image_number(source: str) -> int:
    """The number in an image's file name."""
    return int(Path(source).stem)
