"""Hands that are followed over frames, as far as identity needs them: place, velocity, size and side."""

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from jaxtyping import Float

from hand_recon.detection.detector import DetectedHand, Side
from hand_recon.motion.identity_settings import IdentitySettings

FEWEST_LANDMARKS: Final = 3
"""Landmarks that a detection needs, to have a size."""

ROUNDING: Final = 1e-6
"""Error of sums of times, seconds."""


@dataclass(frozen=True)
class SeenHand:
    """One hand as far as it was seen until now; a value that changes by making another."""

    number: int
    """Number of the hand, from 1, in the order of appearance."""
    time: float
    """Time at which it was last seen, seconds."""
    landmarks: Float[np.ndarray, "landmark=21 2"]
    """Landmarks at that time, pixels; NaN for missing ones."""
    last_side: Side
    """Side by the last detection alone."""
    velocity: Float[np.ndarray, "2"] = field(default_factory=lambda: np.zeros(2))
    """Velocity of the landmarks' mean, pixels per second."""
    side_votes: float = 0.0
    """Sum of the log odds of a right hand over all detections, each within ± `side_limit`."""
    seconds: float = 0.0
    """Time for which the hand was seen: the sum of the times since the frame before."""
    detections: int = 0
    """Number of detections."""
    score_sum: float = 0.0
    """Sum of the scores of those that have one."""
    scores: int = 0
    """Number of those."""

    @property
    def side(self) -> Side:
        """Side by all detections; by the last one where they are in balance."""
        if self.side_votes == 0:
            return self.last_side
        return "right" if self.side_votes > 0 else "left"

    @property
    def mean_score(self) -> float | None:
        """Mean score of the detections; none where they have no scores."""
        return self.score_sum / self.scores if self.scores else None

    def doubt(self, settings: IdentitySettings, clip_seconds: float = math.inf) -> str | None:
        """The reason why it may be no hand; none without one.

        Args:
            settings: Least time and least score.
            clip_seconds: Length of the clip, seconds: no hand can be seen for longer.
        """
        if self.seconds < min(settings.shortest_track, clip_seconds) - ROUNDING:
            return f"seen for {self.seconds:.2f} s, less than {settings.shortest_track:g} s"
        score = self.mean_score
        if score is not None and score < settings.least_score:
            return f"mean score {score:.2f}, below {settings.least_score:g}"
        return None

    def expected(
        self, time: float, settings: IdentitySettings
    ) -> Float[np.ndarray, "landmark=21 2"]:
        """Landmarks at a later time, pixels: the last ones, moved with a velocity that fades.

        Args:
            time: The time, seconds.
            settings: The time over which the velocity is kept.
        """
        moving = settings.horizon * -math.expm1(-(time - self.time) / settings.horizon)
        return self.landmarks + self.velocity * moving

    def seen_again(
        self, hand: DetectedHand, time: float, step: float, settings: IdentitySettings
    ) -> "SeenHand":
        """The hand after one more detection.

        Args:
            hand: The detection.
            time: Its time, seconds.
            step: Time since the frame before, seconds.
            settings: Times of averaging and limits.
        """
        has_score = hand.score is not None and math.isfinite(hand.score)
        return SeenHand(
            self.number,
            time,
            hand.landmarks_2d,
            hand.side,
            velocity=self._velocity(hand, time, settings),
            side_votes=self.side_votes + side_vote(hand, settings),
            seconds=self.seconds + step,
            detections=self.detections + 1,
            score_sum=self.score_sum + (hand.score or 0.0) * has_score,
            scores=self.scores + has_score,
        )

    def _velocity(
        self, hand: DetectedHand, time: float, settings: IdentitySettings
    ) -> Float[np.ndarray, "2"]:
        """Velocity with a detection after the last one, pixels per second."""
        elapsed = time - self.time
        moves = present(hand.landmarks_2d - self.landmarks)
        if elapsed <= 0 or not len(moves):
            return self.velocity
        moved = moves.mean(axis=0)
        weight = 1.0 if self.detections == 1 else -math.expm1(-elapsed / settings.velocity_time)
        return self.velocity + weight * (moved / elapsed - self.velocity)


def side_vote(hand: DetectedHand, settings: IdentitySettings) -> float:
    """Log odds of a right hand by one detection: 0 or more for a right one, 0 or less for a left one.

    Args:
        hand: The detection. A score below a half counts as one of a half.
        settings: The largest log odds.
    """
    share = min(max(hand.side_score, 0.5), 1 - 1e-9)
    vote = min(math.log(share / (1 - share)), settings.side_limit)
    return vote if hand.side == "right" else -vote


def hand_size(landmarks: Float[np.ndarray, "landmark=21 2"]) -> float:
    """Root mean square distance of landmarks from their mean, pixels; 0 with fewer than three landmarks."""
    points = present(landmarks)
    if len(points) < FEWEST_LANDMARKS:
        return 0.0
    return float(np.sqrt(np.square(points - points.mean(axis=0)).sum(axis=1).mean()))


def present(points: Float[np.ndarray, "landmark=21 2"]) -> Float[np.ndarray, "present 2"]:
    """The points that are not missing."""
    return points[np.isfinite(points).all(axis=1)]
