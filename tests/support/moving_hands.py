"""Made-up hands of a clip, and networks that find them, for tests of what follows hands."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hand_recon.detection.detector import DetectedHand, Side
from hand_recon.detection.hands import HandReading
from hand_recon.detection.palms import Palm
from hand_recon.detection.regions import Region

FRAME = np.zeros((800, 800, 3), dtype=np.uint8)

FINGERS = ((-30, 10), (-16, 40), (0, 44), (13, 40), (26, 32))
"""Place of each finger's base, pixels right of and above the wrist; a hand is about 100 px long."""


def open_hand(size: float = 1.0, side: Side = "right") -> Float[np.ndarray, "landmark=21 2"]:
    """Landmarks of an open hand, fingers up, the back to the camera's right hand, pixels from the wrist.

    Args:
        size: Factor on its 100 px.
        side: A left hand is the mirror image.
    """
    points = [(0.0, 0.0)]
    for x, y in FINGERS:
        points += [((1 + 0.2 * joint) * x, -(y + 17 * joint)) for joint in range(4)]
    mirror = np.array([-1.0 if side == "left" else 1.0, 1.0])
    return size * mirror * np.array(points)


@dataclass(frozen=True)
class MovingHand:
    """A hand in one frame."""

    x: float
    """Place of the wrist, pixels."""
    y: float
    """The same, down."""
    presence: float = 0.95
    side: Side = "right"

    @property
    def landmarks(self) -> Float[np.ndarray, "landmark=21 2"]:
        return open_hand(side=self.side) + np.array([self.x, self.y])

    @property
    def palm(self) -> Palm:
        """A palm from the wrist to the MCPs, of score 0.9."""
        points = self.landmarks[[0, 5, 9, 13, 17, 1, 2]]
        x, y = points[[0, 2]].mean(axis=0)
        return Palm(np.array([x - 25, y - 25, x + 25, y + 25]), points, 0.9)


class MovingPalms:
    """The palm network of one frame; counts its calls."""

    def __init__(self, hands: Sequence[MovingHand]) -> None:
        self.hands, self.calls = hands, 0

    def __call__(self, image: np.ndarray, least: float, padding: float = 1.0) -> list[Palm]:
        self.calls += 1
        return [hand.palm for hand in self.hands]


class ReadsMovingHands:
    """The landmark network of one frame: the hand nearest to a square's centre, if most of it is inside."""

    def __init__(self, hands: Sequence[MovingHand]) -> None:
        self.hands, self.calls = hands, 0

    def __call__(self, image: np.ndarray, region: Region) -> HandReading:
        self.calls += 1
        centre = np.array([region.x, region.y])
        nearest = min(
            self.hands,
            key=lambda hand: float(np.linalg.norm(hand.landmarks.mean(axis=0) - centre)),
            default=None,
        )
        if nearest is not None:
            inside = np.abs(nearest.landmarks - centre).max(axis=1) < region.side / 2
            if inside.mean() > 0.6:
                right = 0.95 if nearest.side == "right" else 0.05
                return HandReading(nearest.landmarks, np.zeros((21, 3)), nearest.presence, right)
        return HandReading(open_hand() + centre, np.zeros((21, 3)), 0.1, 0.5)


def detected(
    landmarks: Float[np.ndarray, "landmark=21 2"],
    side: Side = "right",
    side_score: float = 0.95,
    score: float | None = 0.95,
) -> DetectedHand:
    """A detection of a hand."""
    return DetectedHand(landmarks, side, score, side_score)


@dataclass(frozen=True)
class Crossing:
    """Two hands that cross from left to right and from right to left, for tests of identity."""

    frames: int = 60
    """Number of frames at 25 per second, in which each hand goes 600 px."""
    offset: float = 25.0
    """Height of one path above the other, pixels; a hand is 100 px long."""
    sides: tuple[Side, Side] = ("left", "right")
    """Sides of the hand that starts on the left and of the other."""
    hidden: int = 1
    """The hand that is not detected while it is nearer to the other than `reach`."""
    reach: float = 60.0
    """That distance, pixels."""
    noise: float = 2.0
    """Standard deviation of a landmark's coordinates, pixels."""
    wrong_sides: float = 0.0
    """Share of detections with the wrong side, at a score of 0.8."""
    seed: int = 0

    def clip(self) -> list[list[tuple[int, DetectedHand]]]:
        """The true number (0 or 1) and the detection of each hand that is detected, frame by frame."""
        rng = np.random.default_rng(self.seed)
        return [self._frame(share, rng) for share in np.linspace(0, 1, self.frames)]

    def _frame(self, share: float, rng: np.random.Generator) -> list[tuple[int, DetectedHand]]:
        places = np.array([[100 + 600 * share, 300], [700 - 600 * share, 300 + self.offset]])
        is_near = float(np.linalg.norm(places[1] - places[0])) < self.reach
        found = []
        for hand in (0, 1):
            landmarks = open_hand(side=self.sides[hand]) + places[hand]
            landmarks = landmarks + rng.normal(scale=self.noise, size=(21, 2))
            side: Side = self.sides[hand]
            is_wrong = rng.random() < self.wrong_sides
            if is_wrong:
                side = "right" if side == "left" else "left"
            if not (is_near and hand == self.hidden):
                found.append((hand, detected(landmarks, side, 0.8 if is_wrong else 0.95)))
        return found
