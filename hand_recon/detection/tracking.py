"""Hands of successive frames: each is looked for where it was, and palms only now and then (decision 80)."""

import json
from dataclasses import astuple, dataclass
from functools import partial
from typing import Final

import numpy as np
from jaxtyping import Float, UInt8

from hand_recon.detection.detector import Detections
from hand_recon.detection.landmark_noise import LandmarkNoise
from hand_recon.detection.looks import Look
from hand_recon.detection.mediapipe import MediaPipeDetector
from hand_recon.detection.palms import Palm, overlaps
from hand_recon.detection.regions import Region, region_of_landmarks

PALMS_EVERY: Final = 10
"""Frames from one search for palms to the next while hands are followed (decision 80)."""

AFTER_LOSS: Final = 15
"""Frames from the loss of a hand on, that frame included, in which palms are looked for unless one is found
(decision 80)."""

SAME_SQUARE: Final = 0.5
"""Intersection over union of unrotated squares above which a palm is a followed hand's; MediaPipe's."""


@dataclass(frozen=True)
class TrackerState:
    """Everything that one frame leaves to the next."""

    regions: tuple[Region, ...] = ()
    """Square of each hand in which the next frame's landmarks are read."""
    since_search: int = 0
    """Number of frames since palms were looked for, that frame included; 0 before the first."""
    after_loss: int = 0
    """Countdown of the frames in which palms are looked for because a hand was lost; 0 without a loss."""

    def to_json(self) -> str:
        """One line of JSON, from which `from_json` makes an equal state."""
        # Python writes floats with as many digits as make them the same when they are read.
        squares = [astuple(region)[:4] for region in self.regions]
        return json.dumps(
            {
                "squares": squares,
                "since_search": self.since_search,
                "after_loss": self.after_loss,
            },
            allow_nan=False,
        )

    @classmethod
    def from_json(cls, text: str) -> "TrackerState":
        """Read what `to_json` wrote.

        Args:
            text: One line of JSON: `squares`, each with x, y, side and rotation, `since_search` and
                `after_loss`.

        Raises:
            ValueError: It is no such line.
        """
        try:
            read = json.loads(text)
            regions = tuple(
                Region(float(x), float(y), float(side), float(rotation))
                for x, y, side, rotation in read["squares"]
            )
            return cls(regions, int(read["since_search"]), int(read["after_loss"]))
        except (KeyError, TypeError, ValueError, RecursionError, OverflowError) as error:
            raise ValueError(
                f"Expected the state of a tracker, such as {cls((), 1).to_json()}, found {text[:80]!r}. "
                "Start again from the first frame."
            ) from error


class HandTracker:
    """Hands of successive frames by MediaPipe's two networks.

    A hand is read in the square around its landmarks of the frame before. The palm network runs in every
    frame in which no hand is followed, for `AFTER_LOSS` frames from the loss of a hand on or until one is
    found, and otherwise once in `palms_every` frames; not while `detector.max_hands` hands are followed.
    """

    def __init__(
        self, detector: MediaPipeDetector, palms_every: int = PALMS_EVERY, *, copies: int = 0
    ) -> None:
        """Store the detector.

        Args:
            detector: Networks, thresholds and largest number of hands, as for photographs.
            palms_every: Frames from one search for palms to the next while hands are followed; 1 for a
                search in every frame, as MediaPipe does while fewer hands than `max_hands` are followed.
            copies: Number of transformed copies of a hand that are read for σ and averaged, 0 to 8, in place
                of the detector's own number, which is for photographs.

        Raises:
            ValueError: The number of frames is not positive, or there are not so many copies.
        """
        if palms_every < 1:
            raise ValueError(f"Expected palms_every of at least 1 frame, found {palms_every}.")
        self.detector = detector
        self.palms_every = palms_every
        self.noise = LandmarkNoise(copies)

    def __call__(
        self, image: UInt8[np.ndarray, "height width 3"], state: TrackerState | None = None
    ) -> tuple[Detections, TrackerState]:
        """Find the hands of a frame.

        The result depends on nothing but the arguments.

        Args:
            image: RGB, bytes.
            state: The state after the frame before; none for the first frame, or after a cut.

        Returns:
            The hands, those of the highest presence first, and the state for the next frame.

        Raises:
            ModuleNotFoundError: LiteRT is not installed.
            ModelsError: The models cannot be had.
        """
        state = TrackerState() if state is None else state
        look = Look(self.detector.thresholds)
        for region in state.regions:
            look.add(self.detector.read_hand(image, region))
        look.drop_twins()
        followed = len(look.readings)
        after_loss = AFTER_LOSS if followed < len(state.regions) else max(state.after_loss - 1, 0)
        is_due = followed == 0 or after_loss > 0 or state.since_search >= self.palms_every
        if is_due and not self._is_complete(followed):
            self._search(image, look)
            look.drop_twins()
            since_search = 1
        else:
            since_search = state.since_search + 1
        if len(look.readings) > followed:
            after_loss = 0
        look.sort()
        regions = tuple(region_of_landmarks(reading.landmarks_2d) for reading in look.readings)
        detections = look.detections(partial(self.noise, self.detector.read_hand, image))
        return detections, TrackerState(regions, since_search, after_loss)

    def _is_complete(self, followed: int) -> bool:
        """True if as many hands are followed as there may be."""
        return self.detector.max_hands is not None and followed >= self.detector.max_hands

    def _search(self, image: UInt8[np.ndarray, "height width 3"], look: Look) -> None:
        """Add the hands of palms that are not those of followed hands."""
        followed = [region_of_landmarks(reading.landmarks_2d) for reading in look.readings]
        for palm in self.detector.palms(image):
            if _is_followed(palm, followed):
                continue
            doubt = self.detector.doubt(palm, len(look.readings))
            if doubt is None:
                look.add(self.detector.read_hand(image, palm.region), palm)
            else:
                look.dropped.append(doubt)


def _is_followed(palm: Palm, followed: list[Region]) -> bool:
    """True if a palm's square lies over that of a hand that is followed, both taken as upright."""
    if not followed:
        return False
    squares = np.stack([_upright_box(region) for region in followed])
    return bool((overlaps(_upright_box(palm.region), squares) > SAME_SQUARE).any())


def _upright_box(region: Region) -> Float[np.ndarray, "4"]:
    """Left, top, right and bottom of a square without its rotation, pixels."""
    half = region.side / 2
    return np.array([region.x - half, region.y - half, region.x + half, region.y + half])
