"""Choice among the minima of each frame by its neighbours, so that depth does not flip (Sec. 3.3).

The path of least cost through the minima of all frames is found by Viterbi's algorithm. It costs what its
minima cost in their frames, and for every step the change of pose (`change_costs`).
"""

from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from jaxtyping import Float, Int

from hand_recon.motion.estimates import FrameEstimates
from hand_recon.motion.poses import Poses

ERRORS: Final = np.array([*5 * [np.deg2rad(10)], np.deg2rad(5), 0.005, 0.02])
"""Size of the change of an estimate while the hand is still: angles of each finger and rotation of the hand
in radians, x / z and y / z, log depth. About the 90th percentiles of two clips (decision 78)."""

SPEEDS: Final = np.array([*5 * [np.deg2rad(300)], np.deg2rad(250), 0.5, 0.4])
"""Speed of a quick hand per second, in the same order: about the 90th percentiles of two clips of living
hands (decision 78)."""

WEIGHT: Final = 2.0
"""Factor of the logarithms. A change of `ERRORS` costs 1.4, a finger that flips by 90° between frames 7.5."""


@dataclass(frozen=True)
class Candidates:
    """Minima of one frame."""

    joint_angles: Float[np.ndarray, "minimum joint=15 axis=3"]
    """Bend, splay and twist, radians."""
    root_rotation: Float[np.ndarray, "minimum 3 3"]
    """Rotation from the hand's frame to the camera's."""
    place: Float[np.ndarray, "minimum 3"]
    """Origin of the hand's frame: x / z, y / z, and the logarithm of z in metres."""
    cost: Float[np.ndarray, " minimum"]
    """Negative logarithm of each minimum's probability; infinite for an absent one."""

    @classmethod
    def of(cls, estimates: FrameEstimates, frame: int) -> Self:
        """Minima of a frame.

        Args:
            estimates: Minima of all frames.
            frame: Position of the frame among them.
        """
        cost = np.where(np.isfinite(estimates.cost[frame]), estimates.cost[frame], np.inf)
        return cls(
            estimates.joint_angles[frame],
            estimates.root_rotation[frame],
            estimates.place[frame],
            cost,
        )


def change_costs(
    before: Candidates, after: Candidates, seconds: float
) -> Float[np.ndarray, "before after"]:
    """Cost of the change from each minimum of a frame to each minimum of a later one.

    The sum over the five fingers, the rotation, the direction and the depth of 2 log(1 + (change / scale)²),
    as for a distribution with heavy tails: quick motion is possible, and a part of the hand that moves
    costs little beyond some scales. The scale is √(error² + (speed × time)²).

    Args:
        before: Minima of the earlier frame.
        after: Minima of the later frame.
        seconds: Time between the frames.
    """
    first, second = len(before.cost), len(after.cost)
    angles = (after.joint_angles - before.joint_angles[:, None]).reshape(first, second, 5, 9)
    chord = np.linalg.norm(after.root_rotation - before.root_rotation[:, None], axis=(-2, -1))
    place = after.place - before.place[:, None]
    changes = np.concatenate(
        [
            np.linalg.norm(angles, axis=-1),
            2 * np.arcsin(np.minimum(chord / np.sqrt(8), 1.0))[..., None],
            np.linalg.norm(place[..., :2], axis=-1, keepdims=True),
            np.abs(place[..., 2:]),
        ],
        axis=-1,
    )
    squares = ERRORS**2 + (SPEEDS * seconds) ** 2
    return WEIGHT * np.log1p(changes**2 / squares).sum(axis=-1)


@dataclass(frozen=True)
class Paths:
    """Paths of least cost to each minimum of a frame."""

    at: Candidates
    """Minima of the frame."""
    total: Float[np.ndarray, " minimum"]
    """Cost of the path to each minimum; the least is zero."""
    before: Int[np.ndarray, " minimum"]
    """Minimum of the frame before on the path to each minimum."""

    @classmethod
    def first(cls, at: Candidates) -> Self:
        """Paths that begin in a frame.

        Args:
            at: Minima of the frame, at least one of them present.
        """
        return cls(at, at.cost - at.cost.min(), np.zeros(len(at.cost), dtype=np.int64))

    def then(self, at: Candidates, seconds: float) -> "Paths":
        """Paths that go on to a later frame.

        Args:
            at: Minima of the later frame, at least one of them present.
            seconds: Time between the frames.
        """
        with np.errstate(invalid="ignore"):
            totals = self.total[:, None] + change_costs(self.at, at, seconds)
        # Minima that are absent may have no numbers.
        totals = np.where(np.isfinite(totals), totals, np.inf)
        before = totals.argmin(axis=0)
        total = totals.min(axis=0) + at.cost
        return Paths(at, total - total.min(), before)

    @property
    def best(self) -> int:
        """Minimum at the end of the path of least cost."""
        return int(self.total.argmin())


def chosen_minima(estimates: FrameEstimates) -> Int[np.ndarray, " frame"]:
    """Minimum of each frame on the path of least cost.

    Args:
        estimates: Minima of one frame or more, at least one present in each.
    """
    paths = Paths.first(Candidates.of(estimates, 0))
    steps = []
    for frame, seconds in enumerate(np.diff(estimates.times), start=1):
        paths = paths.then(Candidates.of(estimates, frame), float(seconds))
        steps.append(paths.before)
    found = [paths.best]
    for before in reversed(steps):
        found.append(int(before[found[-1]]))
    return np.array(found[::-1])


def chosen_poses(estimates: FrameEstimates) -> Poses:
    """Pose of each frame on the path of least cost; frames without any minimum are left out.

    Args:
        estimates: Minima of the frames.

    Raises:
        ValueError: There is no minimum in any frame.
    """
    present = np.isfinite(estimates.cost).any(axis=1)
    if not present.any():
        raise ValueError(
            f"Found {len(estimates)} frames of a hand without a finite minimum; expected one frame or more "
            "with one. Leave the hand out, or look at its landmarks."
        )
    kept = select_frames(estimates, np.flatnonzero(present))
    return poses_at(kept, chosen_minima(kept))


def select_frames(estimates: FrameEstimates, rows: Int[np.ndarray, " kept"]) -> FrameEstimates:
    """Estimates of some of the frames.

    Args:
        estimates: Minima of all frames.
        rows: Positions of the frames among them.
    """
    return FrameEstimates(
        estimates.frames[rows],
        estimates.times[rows],
        estimates.joint_angles[rows],
        estimates.root_rotation[rows],
        estimates.place[rows],
        estimates.certainty[rows],
        estimates.cost[rows],
    )


def poses_at(estimates: FrameEstimates, minimum: Int[np.ndarray, " frame"]) -> Poses:
    """Poses of one minimum of each frame.

    Args:
        estimates: Minima of the frames.
        minimum: Position of the minimum in each frame.
    """
    row = np.arange(len(estimates))
    return Poses(
        estimates.frames,
        estimates.times,
        estimates.joint_angles[row, minimum],
        estimates.root_rotation[row, minimum],
        estimates.place[row, minimum],
        estimates.certainty[row, minimum],
    )
