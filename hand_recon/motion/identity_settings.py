"""Settings by which detections of successive frames are taken for the same hand (decision 80)."""

from dataclasses import dataclass, fields


@dataclass(frozen=True)
class IdentitySettings:
    """Settings of identity.

    Lengths are in sizes of the hand in the image: the root mean square distance of its landmarks from their
    mean, some 5 cm at an open hand. Costs are negative logarithms of probabilities.

    Raises:
        ValueError: A setting is not positive (`longest_gap` may be zero), or `least_score` is no share.
    """

    longest_gap: float = 0.5
    """Longest time without a detection that is bridged, seconds: beyond it, a hand may have done anything. 0
    bridges nothing."""
    remember: float = 2.0
    """Time after which a hand that was not seen gets a new number, seconds: after so long, its place does not
    tell which of a person's two hands came back."""
    shortest_track: float = 0.2
    """Least time for which a hand is seen, seconds: false detections last for a few frames. Of a clip that is
    shorter, a hand must be seen in every frame."""
    least_score: float = 0.6
    """Least mean score of a hand, 0 to 1. A false detection hovers above the detector's threshold, 0.5; hands
    have 0.9 and more on average."""
    place_spread: float = 0.5
    """Standard deviation of the landmarks' distance from where they are expected at once, sizes: noise, and
    changes of pose and velocity from one frame to the next."""
    speed_spread: float = 8.0
    """Growth of that standard deviation, sizes per second, some 0.4 m/s: velocities change unseen."""
    horizon: float = 0.3
    """Time over which a hand that is not seen keeps its velocity, seconds; reaching takes twice as long."""
    velocity_time: float = 0.05
    """Time over which a velocity is averaged, seconds: between two frames, noise and bending fingers move the
    landmarks' mean."""
    size_spread: float = 0.4
    """Standard deviation of the logarithm of two sizes' ratio: hands open, close and rotate."""
    side_limit: float = 3.5
    """Largest log odds of the side by one detection: no detector is right in more than 97 of 100 frames."""
    largest_cost: float = 8.0
    """Cost above which a detection is of a new hand. A new one may be anywhere in an image of some thousand
    squares of a hand's size, which makes 7 to 8."""

    def __post_init__(self) -> None:
        """Check the values."""
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name == "least_score":
                if not 0 <= value <= 1:
                    raise ValueError(
                        f"Expected identity.least_score between 0 and 1, found {value:g}."
                    )
            elif not (value > 0 or (field.name == "longest_gap" and value == 0)):
                raise ValueError(f"Expected identity.{field.name} above 0, found {value:g}.")


DEFAULT = IdentitySettings()
"""The settings that decision 80 chooses."""
