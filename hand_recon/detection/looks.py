"""Hands found so far in one look at an image, each once."""

from collections.abc import Callable
from dataclasses import dataclass, field

from hand_recon.detection.detector import Detections
from hand_recon.detection.hands import HandReading, is_false_twin, is_repeated
from hand_recon.detection.palms import Palm
from hand_recon.detection.thresholds import Thresholds, to_hand


@dataclass
class Look:
    """Hands found so far in one look at an image, and why others were dropped."""

    thresholds: Thresholds
    """Limits below which a reading is not taken for a hand."""
    readings: list[HandReading] = field(default_factory=list)
    """The hands, in the order in which they were found."""
    palms: list[Palm | None] = field(default_factory=list)
    """The palm of each hand; none for a hand that was followed from the image before."""
    dropped: list[str] = field(default_factory=list)
    """One sentence for each dropped candidate."""

    def add(self, reading: HandReading, palm: Palm | None = None) -> None:
        """Take a reading as a hand, or say why not.

        Args:
            reading: What the landmark network read.
            palm: The palm by which the square was placed; none for a hand that was followed.
        """
        objection = self.thresholds.objection(reading)
        if objection is None and is_repeated(reading, self.readings):
            place = reading.landmarks_2d if palm is None else palm.box.reshape(2, 2)
            x, y = place.mean(axis=0)
            subject = "a followed hand" if palm is None else "a palm"
            objection = f"{subject} at ({x:.0f}, {y:.0f}) is of a hand that was found already"
        if objection is None:
            self.readings.append(reading)
            self.palms.append(palm)
        else:
            self.dropped.append(objection)

    def drop_twins(self) -> None:
        """Drop second, worse readings of the same hand."""
        kept = []
        for index, reading in enumerate(self.readings):
            if any(is_false_twin(reading, other) for other in self.readings):
                x, y = reading.landmarks_2d.mean(axis=0)
                self.dropped.append(
                    f"a hand of presence {reading.presence:.2f} at ({x:.0f}, {y:.0f}) lies over one of "
                    "higher presence and is taken for the same"
                )
            else:
                kept.append(index)
        self._reorder(kept)

    def sort(self) -> None:
        """Put the hands into the order of their presence, the highest first."""
        self._reorder(
            sorted(range(len(self.readings)), key=lambda index: -self.readings[index].presence)
        )

    def detections(self, complete: Callable[[HandReading], HandReading]) -> Detections:
        """The hands, without second readings of the same hand.

        Args:
            complete: Function that adds σ to a reading.
        """
        self.drop_twins()
        hands = [
            to_hand(complete(reading), None if palm is None else palm.score)
            for reading, palm in zip(self.readings, self.palms, strict=True)
        ]
        return Detections(tuple(hands), tuple(self.dropped))

    def _reorder(self, order: list[int]) -> None:
        """Keep the hands of these indices, in this order."""
        self.readings = [self.readings[index] for index in order]
        self.palms = [self.palms[index] for index in order]
