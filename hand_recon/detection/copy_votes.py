"""Side and presence of a hand as means over transformed copies of its crop (decision 70)."""

from dataclasses import replace

import numpy as np
from jaxtyping import UInt8

from hand_recon.detection.copies import ReadHand
from hand_recon.detection.hands import HandReading
from hand_recon.detection.landmark_noise import LandmarkNoise
from hand_recon.detection.regions import Region


class CopyVotes(LandmarkNoise):
    """`LandmarkNoise` whose side and presence are means over the first reading and the copies, too.

    A wrong side leaves no trace in the landmarks; where it is a guess, some copies have the other one.
    Without copies it is `LandmarkNoise` itself.
    """

    def __call__(
        self,
        read: ReadHand,
        image: UInt8[np.ndarray, "height width 3"],
        reading: HandReading,
    ) -> HandReading:
        """Return a reading with σ, and with landmarks, side and presence that are means.

        Args:
            read: Reads the copies.
            image: RGB, bytes.
            reading: The hand.
        """
        readings = [reading]

        def recorded(image: UInt8[np.ndarray, "height width 3"], region: Region) -> HandReading:
            copy = read(image, region)
            readings.append(copy)
            return copy

        found = super().__call__(recorded, image, reading)
        return replace(
            found,
            presence=float(np.mean([one.presence for one in readings])),
            right=float(np.mean([one.right for one in readings])),
        )
