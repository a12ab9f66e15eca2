"""Limits below which something is not taken for a hand, and the record of what is."""

from dataclasses import dataclass

from hand_recon.detection.detector import DetectedHand
from hand_recon.detection.hands import HandReading


@dataclass(frozen=True)
class Thresholds:
    """Limits below which something is not taken for a hand."""

    min_presence: float = 0.5
    """Least presence, 0 to 1; MediaPipe's own value."""
    min_side: float = 20.0
    """Least extent of a hand, pixels: the longer side of the box around its landmarks."""

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ValueError: A value is out of its range.
        """
        check_share("min_presence", self.min_presence)
        if self.min_side < 0:
            raise ValueError(
                f"Expected detector.min_side of at least 0 pixels, found {self.min_side}."
            )

    def objection(self, reading: HandReading) -> str | None:
        """The sentence about a reading that is below a limit; none if it is a hand."""
        x, y = reading.landmarks_2d.mean(axis=0)
        if reading.presence <= self.min_presence:
            return (
                f"a candidate at ({x:.0f}, {y:.0f}) has presence {reading.presence:.2f}, not above "
                f"detector.min_presence={self.min_presence:g}"
            )
        if reading.extent < self.min_side:
            return (
                f"a hand at ({x:.0f}, {y:.0f}) spans {reading.extent:.0f} px, below "
                f"detector.min_side={self.min_side:g}"
            )
        return None


def check_share(option: str, value: float) -> None:
    """Check a value between 0 and 1.

    Raises:
        ValueError: It is outside.
    """
    if not 0 <= value <= 1:
        raise ValueError(f"Expected detector.{option} between 0 and 1, found {value:g}.")


def to_hand(reading: HandReading, palm_score: float | None = None) -> DetectedHand:
    """The record of a reading.

    Args:
        reading: What the landmark network read.
        palm_score: Score of the palm network, if it found the hand.
    """
    return DetectedHand(
        landmarks_2d=reading.landmarks_2d,
        side=reading.side,
        score=reading.presence,
        side_score=reading.side_score,
        palm_score=palm_score,
        landmarks_3d=reading.landmarks_3d,
        sigma=reading.sigma,
    )
