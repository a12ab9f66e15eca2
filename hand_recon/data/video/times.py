"""Times of frames, which increase whatever the container says."""

import math


class Clock:
    """Times relative to the first frame, with missing and decreasing ones repaired.

    A time that is missing is one step after the last. One that is not later than the last becomes one step
    later, and all that follow keep their distances from it, as after the joint of two recordings.

    >>> clock = Clock(step=0.5)
    >>> [clock.time(raw) for raw in (7.0, 8.0, math.nan, 9.0, 1.0, 2.0)]
    [0.0, 1.0, 1.5, 2.0, 2.5, 3.5]
    >>> clock.repaired
    2
    """

    def __init__(self, step: float) -> None:
        self.repaired = 0
        """Number of times that were missing or not later than the one before."""
        self._step = step
        self._shift: float | None = None
        self._last = 0.0

    def time(self, raw: float) -> float:
        """Convert the next frame's time.

        Args:
            raw: Time by the container, seconds. After the first frame 0 stands for a missing one, as OpenCV
                has it; so does anything that is no finite number. A negative one counts as 0: OpenCV gives a
                first frame with the time 0 the time of its decoding, which is earlier.

        Returns:
            Seconds since the first frame.
        """
        known = math.isfinite(raw) and raw > 0
        if self._shift is None:
            self._shift = -raw if known else 0.0
            return self._last
        time = raw + self._shift if known else self._last + self._step
        if time <= self._last:
            self._shift += self._last + self._step - time
            time = self._last + self._step
            self.repaired += 1
        elif not known:
            self.repaired += 1
        self._last = time
        return time
