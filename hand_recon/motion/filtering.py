"""Smoothing of a hand's motion while it is seen, with no frame but the present and past ones (Sec. 3.3).

The model is that of `hand_recon.motion.smoothing`: the pose of a frame is the last one of the smoothed motion
up to it, found by a Kalman filter. All coordinates share its gains, because they share their certainty.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from jaxtyping import Float

from hand_recon.motion.choice import Candidates, Paths, poses_at
from hand_recon.motion.estimates import ANGLES, PLACE, ROTATION, FrameEstimates
from hand_recon.motion.poses import Poses, axis_angle_between, rotated
from hand_recon.motion.smoothing import DEFAULT_SECONDS, LONGEST_SPAN, checked_seconds, within

_Coordinates = Float[np.ndarray, " coordinate=51"]


@dataclass(frozen=True)
class _Motion:
    """Distribution of position and velocity of the coordinates; rotations are a curve (`developed`)."""

    value: _Coordinates
    velocity: _Coordinates
    covariance: Float[np.ndarray, "2 2"]
    """Covariance of position and velocity, the same for each coordinate."""

    @classmethod
    def of_two(
        cls,
        before: _Coordinates,
        now: _Coordinates,
        seconds: float,
        noise: tuple[float, float, float],
    ) -> Self:
        """Motion after two measurements, about which nothing was known before.

        Args:
            before: The first measurement.
            now: The second one.
            seconds: Time between them.
            noise: Variances of the two measurements, and density of the acceleration.
        """
        first, second, density = noise
        of_velocity = (first + second) / seconds**2 + density * seconds / 3
        covariance = np.array([[second, second / seconds], [second / seconds, of_velocity]])
        return cls(now, (now - before) / seconds, covariance)

    def after(self, seconds: float, density: float) -> "_Motion":
        """Motion after some time without a measurement."""
        step = np.array([[1.0, seconds], [0.0, 1.0]])
        added = np.array([[seconds**3 / 3, seconds**2 / 2], [seconds**2 / 2, seconds]])
        covariance = step @ self.covariance @ step.T + density * added
        return _Motion(self.value + seconds * self.velocity, self.velocity, covariance)

    def given(self, measured: _Coordinates, variance: float) -> "_Motion":
        """Motion once a measurement is known."""
        gain = self.covariance[:, 0] / (self.covariance[0, 0] + variance)
        off = measured - self.value
        covariance = self.covariance - np.outer(gain, self.covariance[0])
        return _Motion(self.value + gain[0] * off, self.velocity + gain[1] * off, covariance)


@dataclass(frozen=True)
class _Past:
    """Frames until now."""

    paths: Paths
    """Paths through the minima of the frames."""
    pose: Poses
    """Pose of the last frame as it was measured."""
    measured: _Coordinates
    """Its coordinates, with its rotation on the curve of all frames."""
    least: Float[np.ndarray, " angle=45"]
    """Least joint angles that were measured, radians."""
    largest: Float[np.ndarray, " angle=45"]
    """Largest joint angles that were measured, radians."""
    motion: _Motion | None
    """Motion, which needs two frames."""


class LiveFilter:
    """Choice of the minimum and smoothing for one hand, frame by frame.

    Args:
        seconds: Strength τ as for `smoothed`; 0 only chooses minima.

    Raises:
        ValueError: The strength is none.
    """

    def __init__(self, seconds: float = DEFAULT_SECONDS) -> None:
        self._seconds = checked_seconds(seconds)
        self._past: _Past | None = None

    def update(self, estimates: FrameEstimates) -> Poses:
        """Pose of the hand in the next frame.

        The chosen minimum ends the path of least cost through all frames until now, as in `chosen_minima`.

        Args:
            estimates: Minima of one frame, at least one of them present.

        Returns:
            Pose of this frame.

        Raises:
            ValueError: There is more than one frame, no minimum, or a time that is not after the last one.
        """
        _check_frame(estimates)
        past = self._past
        at = Candidates.of(estimates, 0)
        if past is None:
            paths = Paths.first(at)
            pose = poses_at(estimates, np.array([paths.best]))
            angles = pose.joint_angles.reshape(45)
            measured = np.concatenate([angles, np.zeros(3), pose.place[0]])
            self._past = _Past(paths, pose, measured, angles, angles, None)
            return pose
        seconds = _time_between(past.pose, estimates)
        paths = past.paths.then(at, seconds)
        pose = poses_at(estimates, np.array([paths.best]))
        self._past = self._next(past, paths, pose, seconds)
        return self._result(self._past)

    @property
    def chosen(self) -> int:
        """Position of the minimum of the last frame that was chosen.

        Raises:
            ValueError: There was no frame.
        """
        if self._past is None:
            raise ValueError(
                "Found no frame; expected one to choose a minimum of. Call update first."
            )
        return self._past.paths.best

    def _next(self, past: _Past, paths: Paths, pose: Poses, seconds: float) -> _Past:
        """The frames until now, with a further one."""
        angles = pose.joint_angles.reshape(45)
        curve = past.measured[ROTATION]
        curve = curve + axis_angle_between(past.pose.root_rotation, pose.root_rotation)[0]
        measured = np.concatenate([angles, curve, pose.place[0]])
        motion = self._motion(past, measured, float(pose.certainty[0]), seconds)
        least, largest = np.minimum(past.least, angles), np.maximum(past.largest, angles)
        return _Past(paths, pose, measured, least, largest, motion)

    def _motion(
        self, past: _Past, measured: _Coordinates, certainty: float, seconds: float
    ) -> _Motion | None:
        """Motion with a further measurement."""
        if not self._seconds:
            return None
        density = self._seconds**-4
        span = min(seconds, LONGEST_SPAN)
        variance = 1 / (certainty * span)
        if past.motion is not None:
            return past.motion.after(seconds, density).given(measured, variance)
        noise = (1 / (float(past.pose.certainty[0]) * span), variance, density)
        return _Motion.of_two(past.measured, measured, seconds, noise)

    def _result(self, past: _Past) -> Poses:
        """Pose of the last frame."""
        pose, motion = past.pose, past.motion
        if motion is None:
            return pose
        hull = np.stack([past.least, past.largest])
        turned = (motion.value - past.measured)[ROTATION]
        return Poses(
            pose.frames,
            pose.times,
            within(motion.value[None, ANGLES], hull).reshape(1, 15, 3),
            rotated(pose.root_rotation, turned[None]),
            motion.value[None, PLACE],
            pose.certainty,
        )


def _check_frame(estimates: FrameEstimates) -> None:
    if len(estimates) != 1 or not np.isfinite(estimates.cost).any():
        count = int(np.isfinite(estimates.cost).sum())
        raise ValueError(
            f"Found {len(estimates)} frames with {count} finite minima; expected one frame with one or more. "
            "Pass frames one by one, and leave out those without a minimum."
        )


def _time_between(before: Poses, now: FrameEstimates) -> float:
    seconds = float(now.times[0] - before.times[0])
    if not seconds > 0:
        raise ValueError(
            f"Found a frame at {now.times[0]} s after one at {before.times[0]} s; expected increasing times. "
            "Begin a new LiveFilter for another clip."
        )
    return seconds
