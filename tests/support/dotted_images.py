"""Images with a dot at each landmark of two hands, and every form in which landmarks can be written."""

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np

from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.data.landmarks.parsed import SIDES

WIDTH: Final = 200
HEIGHT: Final = 100


class Dotted:
    """Hands 2i (left, red dots) and 2i + 1 (right, green dots) share image i."""

    def __init__(self, root: Path, images: int = 3) -> None:
        """Draw the images."""
        self.root = root
        root.mkdir(parents=True, exist_ok=True)
        rng = np.random.default_rng(7)
        corner = np.array([[[12.0, 15.0]], [[115.0, 15.0]]])
        # Middles of pixels; the outermost landmarks fix the box to 70 × 60.
        self.points = np.floor(rng.uniform(0, (70, 60), (images, 2, 21, 2)))
        self.points[..., 0, :], self.points[..., 20, :] = (0, 0), (70, 60)
        self.points = (self.points + corner + 0.5).reshape(-1, 21, 2)
        self.names = [f"image{number // 2}.png" for number in range(2 * images)]
        self.sides = list(SIDES) * images
        for image in range(images):
            pixels = np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8)
            for place, colour in ((0, (0, 0, 255)), (1, (0, 255, 0))):
                for u, v in self.points[2 * image + place]:
                    cv2.circle(pixels, (int(u), int(v)), 1, colour, -1)
            cv2.imwrite(str(root / f"image{image}.png"), pixels)

    def boxes(self) -> np.ndarray:
        """Left, top, width and height of each hand's box, pixels."""
        low, high = self.points.min(axis=1), self.points.max(axis=1)
        return np.concatenate([low, high - low], axis=-1)

    def keypoints(self, hand: int, visibility: float = 2) -> list[float]:
        """u, v and visibility of 21 landmarks, in one list."""
        column = np.full((21, 1), visibility)
        numbers: list[float] = np.concatenate([self.points[hand], column], axis=1).ravel().tolist()
        return numbers

    def write(self, content: Any, name: str = "landmarks.json") -> Path:  # noqa: ANN401  # any JSON
        """Write JSON into the folder of the images; return its path."""
        (self.root / name).write_text(json.dumps(content))
        return self.root / name

    def objects(self) -> list[dict[str, Any]]:
        """One JSON object per hand."""
        return [
            {"landmarks": points.tolist(), "image": name, "side": side}
            for points, name, side in zip(self.points, self.names, self.sides, strict=True)
        ]

    def as_json(self) -> Path:
        """Write a JSON list with one object per hand."""
        return self.write(self.objects())

    def as_csv(self) -> Path:
        """Write a CSV table with one row per hand."""
        with (self.root / "landmarks.csv").open("w", newline="") as stream:
            writer = csv.writer(stream)
            columns = [f"{letter}{number}" for number in range(21) for letter in ("u", "v")]
            writer.writerow(["image", "side", *columns])
            for points, name, side in zip(self.points, self.names, self.sides, strict=True):
                writer.writerow([name, side, *points.ravel().tolist()])
        return self.root / "landmarks.csv"

    def _coco(self, annotations: list[dict[str, Any]]) -> Path:
        names = sorted(set(self.names))
        images = [{"id": number, "file_name": name} for number, name in enumerate(names)]
        categories = [{"id": number, "name": f"{side} hand"} for number, side in enumerate(SIDES)]
        return self.write({"images": images, "categories": categories, "annotations": annotations})

    def as_coco(self) -> Path:
        """Write mmpose's form: one hand per annotation, with its box."""
        return self._coco(
            [
                {
                    "id": hand, "image_id": hand // 2, "category_id": hand % 2,
                    "keypoints": self.keypoints(hand), "bbox": self.boxes()[hand].tolist(),
                }
                for hand in range(len(self.points))
            ]
        )  # fmt: skip

    def as_wholebody(self) -> Path:
        """Write COCO-WholeBody's form: two hands per annotation."""
        people = []
        for person in range(len(self.points) // 2):
            entry: dict[str, Any] = {"id": person, "image_id": person, "keypoints": [0] * 51}
            for place, side in enumerate(SIDES):
                hand = 2 * person + place
                entry[f"{side}hand_kpts"] = self.keypoints(hand)
                entry[f"{side}hand_box"] = self.boxes()[hand].tolist()
                entry[f"{side}hand_valid"] = True
            people.append(entry)
        return self._coco(people)

    def as_halpe(self) -> Path:
        """Write Halpe's form: the 136 keypoints of a body."""
        people = []
        for person in range(len(self.points) // 2):
            hands = self.keypoints(2 * person) + self.keypoints(2 * person + 1)
            people.append({"image_id": person, "keypoints": [0] * (94 * 3) + hands})
        return self._coco(people)

    def as_hint(self, folder: str = "pairs") -> Path:
        """Write HInt's form: an image and a JSON file for each hand."""
        target = self.root / folder
        target.mkdir(parents=True)
        for hand, (name, side) in enumerate(zip(self.names, self.sides, strict=True)):
            stem = f"{Path(name).stem}_{side[0]}"
            (target / f"{stem}.png").write_bytes((self.root / name).read_bytes())
            left, top, width, height = self.boxes()[hand].tolist()
            entry = {
                "bbox": [[left, top, left + width, top + height]],
                "keypoints": self.points[hand].tolist(),
                "occlusion": [int(number % 5 == 0) for number in range(21)],
            }
            (target / f"{stem}.json").write_text(json.dumps([entry]))
        return target


FORMS: Final[dict[str, Callable[[Dotted], Path]]] = {
    "json": Dotted.as_json, "csv": Dotted.as_csv, "coco": Dotted.as_coco,
    "wholebody": Dotted.as_wholebody, "halpe": Dotted.as_halpe, "hint": Dotted.as_hint,
}  # fmt: skip


def assert_same_points(landmarks: ImageLandmarks, dotted: Dotted) -> None:
    """Fail unless the landmarks and sides are those that were drawn."""
    np.testing.assert_allclose(landmarks.landmarks_2d.numpy(), dotted.points)
    assert landmarks.left.tolist() == [side == "left" for side in dotted.sides]
