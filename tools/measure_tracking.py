"""Compare hands that are followed over a clip with hands that are found anew in every frame.

    python -m tools.measure_tracking <clip> [--landmarks file.json] [--palms-every 1 10 30] [--copies 0 1]

One line for each way: processor time of a frame; frames by their number of hands; side and detections of each
identified hand; jitter of the first hand, which is the root mean square distance of its landmarks from the
mean of the frames before and after. With `--landmarks` (21 landmarks for each frame, pixels), also the mean
distance from these.
"""

import argparse
import json
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from hand_recon.detection.detector import Detections
from hand_recon.detection.mediapipe import MediaPipeDetector
from hand_recon.detection.tracking import HandTracker, TrackerState
from hand_recon.motion.identity import identify
from hand_recon.motion.identity_steps import FrameHands

Image = UInt8[np.ndarray, "height width 3"]


@dataclass
class Way:
    """One way to find the hands of a clip, and its results so far."""

    name: str
    find: Callable[[Image], Detections]
    frames: list[FrameHands] = field(default_factory=list)
    milliseconds: list[float] = field(default_factory=list)

    def add(self, number: int, seconds: float, image: Image) -> None:
        """Find the hands of the next frame."""
        started = time.process_time()
        hands = self.find(image).hands
        self.milliseconds.append(1e3 * (time.process_time() - started))
        self.frames.append(FrameHands(number, seconds, hands))

    def row(self, expected: Float[np.ndarray, "frame landmark=21 2"] | None) -> str:
        """The line of results."""
        counts = sorted(Counter(len(frame.hands) for frame in self.frames).items())
        identities = identify(self.frames)
        tracks = ", ".join(f"{one.side} {len(one.frames)}" for one in identities.tracks)
        # The first frame includes reading and compiling the models.
        line = (
            f"{self.name:24} {np.mean(self.milliseconds[1:]):6.1f} ms   "
            f"{', '.join(f'{hands} in {frames}' for hands, frames in counts)} frames   {tracks}   "
            f"{len(identities.dropped)} dropped   jitter {jitter(first_hands(self.frames)):.2f} px"
        )
        if expected is None:
            return line
        distances = np.linalg.norm(first_hands(self.frames) - expected[: len(self.frames)], axis=-1)
        return f"{line}   distance {np.nanmean(distances):.2f} px"


def first_hands(frames: list[FrameHands]) -> Float[np.ndarray, "frame landmark=21 2"]:
    """Landmarks of the first hand of each frame, pixels; NaN without one."""
    missing = np.full((21, 2), np.nan)
    return np.array([frame.hands[0].landmarks_2d if frame.hands else missing for frame in frames])


def jitter(landmarks: Float[np.ndarray, "frame landmark=21 2"]) -> float:
    """Root mean square distance from the mean of the frames before and after, pixels."""
    offsets = landmarks[1:-1] - (landmarks[:-2] + landmarks[2:]) / 2
    return float(np.sqrt(np.nanmean(np.square(offsets).sum(axis=-1))))


def follower(copies: int, palms_every: int) -> Callable[[Image], Detections]:
    """Function that finds the hands of a clip's frames in order by following them."""
    tracker = HandTracker(MediaPipeDetector(), palms_every, copies=copies)
    state = TrackerState()

    def find(image: Image) -> Detections:
        nonlocal state
        detections, state = tracker(image, state)
        return detections

    return find


def video(path: Path) -> Iterator[tuple[int, float, Image]]:
    """Number, time in seconds and RGB pixels of each frame.

    Raises:
        FileNotFoundError: There is no such video.
    """
    if not path.is_file():
        raise FileNotFoundError(f"No video at {path}.")
    capture, number = cv2.VideoCapture(str(path)), 0
    while (read := capture.read())[0]:
        seconds = capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3
        yield number, seconds, np.ascontiguousarray(read[1][..., ::-1], dtype=np.uint8)
        number += 1


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("clip", type=Path)
    parser.add_argument("--landmarks", type=Path)
    parser.add_argument("--palms-every", type=int, nargs="+", default=[1, 10, 30])
    parser.add_argument("--copies", type=int, nargs="+", default=[0, 1])
    chosen = parser.parse_args()
    expected = None
    if chosen.landmarks:
        expected = np.array(json.loads(chosen.landmarks.read_text()), dtype=np.float64)[..., :2]
    ways = [
        Way(f"each frame, {copies} copies", MediaPipeDetector(copies=copies))
        for copies in chosen.copies
    ]
    ways += [
        Way(f"palms every {every}, {copies} copies", follower(copies, every))
        for every in chosen.palms_every
        for copies in chosen.copies
    ]
    for number, seconds, image in video(chosen.clip):
        for way in ways:
            way.add(number, seconds, image)
    for way in ways:
        print(way.row(expected))


if __name__ == "__main__":
    main()
