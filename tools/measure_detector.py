"""Compare the detector with labels that MediaPipe itself made, and measure its time.

    python -m tools.measure_detector <folder> [--labels test.json] [--count 400] [--padding 1.7]

The folder holds images, `detections.json` (`{"image": {"hands": 1, "side": "left", "score": 0.99}, …}`) and
files of labels (`[{"image": …, "landmarks": [[u, v], …]}, …]`). Errors are in pixels of an image whose longer
side has 256.
"""

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from hand_recon.detection.detector import Detections
from hand_recon.detection.mediapipe import MediaPipeDetector

REFERENCE: Final = 256
"""Longer side of the image in whose pixels errors are given."""

LEAST_SIDE: Final = 256
"""Side to which the padded images were enlarged before they were labelled, pixels."""


@dataclass
class Comparison:
    """Counts, errors and times of the images so far."""

    images: int = 0
    same: int = 0
    fewer: int = 0
    more: int = 0
    other_side: int = 0
    errors: list[float] = field(default_factory=list)
    """Mean error of each hand, reference pixels."""
    milliseconds: dict[str, list[float]] = field(default_factory=dict)
    """Times of each stage."""

    def timed(self, stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """The same function, whose times are kept."""

        def measured(*arguments: object) -> object:
            started = time.perf_counter()
            result = function(*arguments)
            self.milliseconds.setdefault(stage, []).append(1e3 * (time.perf_counter() - started))
            return result

        return measured

    def add(
        self, found: Detections, expected: dict[str, Any], landmarks: list[list[float]] | None
    ) -> list[float] | None:
        """Count one image; returns the errors of its landmarks, pixels of the image, if it has a label."""
        self.images += 1
        self.fewer += len(found.hands) < expected["hands"]
        self.more += len(found.hands) > expected["hands"]
        if len(found.hands) != expected["hands"]:
            return None
        if len(found.hands) == 1 and found.hands[0].side != expected["side"]:
            self.other_side += 1
            return None
        self.same += 1
        if landmarks is None or not found.hands:
            return None
        distances = np.linalg.norm(found.hands[0].landmarks_2d - np.array(landmarks), axis=1)
        return [float(value) for value in distances]


def read(path: Path) -> UInt8[np.ndarray, "height width 3"]:
    """Read an RGB image.

    Raises:
        FileNotFoundError: There is no such image.
    """
    image = cv2.imread(str(path))
    if image is None:
        raise FileNotFoundError(f"{path} is missing or no image.")
    return np.asarray(image[..., ::-1], dtype=np.uint8)


def enlarged_copy(
    image: UInt8[np.ndarray, "height width 3"], padding: float
) -> tuple[UInt8[np.ndarray, "side side 3"], float, Float[np.ndarray, "2"]]:
    """The padded, enlarged copy of an image that was labelled.

    Returns:
        The copy, pixels of it per pixel of the image, and the image's corner in it before enlarging.
    """
    height, width = image.shape[:2]
    side = int(padding * max(height, width))
    left, top = (side - width) // 2, (side - height) // 2
    copy = cv2.copyMakeBorder(
        image, top, side - height - top, left, side - width - left, cv2.BORDER_REPLICATE
    )
    factor = max(1.0, LEAST_SIDE / side)
    if factor > 1:
        copy = cv2.resize(copy, (LEAST_SIDE, LEAST_SIDE), interpolation=cv2.INTER_CUBIC)
    return np.asarray(copy, dtype=np.uint8), factor, np.array([left, top], dtype=float)


def measure(options: argparse.Namespace) -> Comparison:
    """Run the detector over the images."""
    expected: dict[str, Any] = json.loads((options.folder / "detections.json").read_text())
    labels: dict[str, list[list[float]]] = {}
    for name in options.labels:
        rows = json.loads((options.folder / name).read_text())
        labels |= {row["image"]: row["landmarks"] for row in rows}
    names = sorted(expected if options.all else labels)
    count = min(options.count or len(names), len(names))
    names = [names[index * len(names) // count] for index in range(count)]
    padding = options.padding if options.padding == "auto" else float(options.padding)
    detector = MediaPipeDetector(
        max_hands=2,
        min_palm_score=options.min_palm_score,
        padding=1.0 if options.copies else padding,
        copies=options.looks - 1,
        threads=options.threads,
    )
    done = Comparison()
    vars(detector)["find_palms"] = done.timed("palms", detector.find_palms)
    vars(detector)["read_hand"] = done.timed("landmarks of a hand", detector.read_hand)
    whole = done.timed("image", detector)
    for name in names:
        image = read(options.folder / name)
        scale, corner = 1.0, np.zeros(2)
        if options.copies:
            image, scale, corner = enlarged_copy(image, float(options.padding))
        landmarks = labels.get(name)
        if landmarks is not None:
            landmarks = ((np.array(landmarks) + corner) * scale).tolist()
        errors = done.add(whole(image), expected[name], landmarks)
        if errors is not None:
            longer = max(image.shape[:2]) / (float(options.padding) if options.copies else 1)
            done.errors.append(float(np.mean(errors)) * REFERENCE / longer)
            if options.worst and done.errors[-1] > options.worst:
                print(f"{name}: {done.errors[-1]:.2f} px")
    return done


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--labels", nargs="+", default=["test.json"])
    parser.add_argument("--all", action="store_true", help="images without a label, too")
    parser.add_argument("--count", type=int, default=0, help="so many images, spread evenly")
    parser.add_argument("--padding", default="1.7")
    parser.add_argument(
        "--copies", action="store_true", help="pad and enlarge as the labels' makers did"
    )
    parser.add_argument(
        "--looks", type=int, default=1, help="readings of a hand that are averaged; MediaPipe's: 1"
    )
    parser.add_argument("--min-palm-score", type=float, default=0.4)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--worst", type=float, default=0, help="name hands with a larger error")
    done = measure(parser.parse_args())
    print(
        f"{done.images} images: {done.same} the same hands ({100 * done.same / done.images:.2f} %), "
        f"{done.fewer} fewer, {done.more} more, {done.other_side} on the other side"
    )
    if done.errors:
        mean, median, high = (
            np.mean(done.errors),
            np.median(done.errors),
            np.percentile(done.errors, 99),
        )
        print(
            f"{len(done.errors)} hands: error mean {mean:.3f}, median {median:.3f}, 99 % {high:.3f}, "
            f"largest {max(done.errors):.2f} px of {REFERENCE}"
        )
    for stage, times in done.milliseconds.items():
        print(f"{stage}: median {np.median(times):.1f} ms ({len(times)} calls)")


if __name__ == "__main__":
    main()
