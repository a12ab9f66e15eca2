"""Made-up poses of a moving hand for tests of motion."""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from hand_recon.motion.estimates import FrameEstimates
from hand_recon.motion.poses import Poses

RATE = 30.0


def moving_poses(frames: int, *, seed: int = 0, noise: float = 0.05, uneven: bool = False) -> Poses:
    """A hand that drifts and turns by more than a full turn, with noise.

    Args:
        frames: Number of frames.
        seed: Seed of the motion and the noise.
        noise: Standard deviation of every coordinate.
        uneven: True for uneven times and certainties.
    """
    random = np.random.default_rng(seed)
    steps = random.uniform(0.02, 0.15, frames) if uneven else np.full(frames, 1 / RATE)
    times = np.cumsum(steps) - steps[0]
    path = times[:, None] * random.normal(size=51) + noise * random.normal(size=(frames, 51))
    rotation = Rotation.from_rotvec(3 * times[:, None] * [0.6, 0.0, 0.8])
    shaken = Rotation.from_rotvec(noise * random.normal(size=(frames, 3)))
    start = Rotation.random(random_state=np.random.default_rng(seed))
    return Poses(
        np.arange(frames),
        times,
        path[:, :45].reshape(-1, 15, 3),
        (shaken * rotation * start).as_matrix(),
        path[:, 48:],
        random.uniform(0.3, 3.0, frames) if uneven else np.ones(frames),
    )


def only_minimum(poses: Poses) -> FrameEstimates:
    """Poses as estimates with one minimum per frame."""
    return FrameEstimates(
        poses.frames,
        poses.times,
        poses.joint_angles[:, None],
        poses.root_rotation[:, None],
        poses.place[:, None],
        poses.certainty[:, None],
        np.zeros((len(poses), 1)),
    )


def with_minima(
    poses: Poses,
    bends: Float[np.ndarray, "frame minimum"],
    cost: Float[np.ndarray, "frame minimum"],
) -> FrameEstimates:
    """Estimates whose minima differ from poses in one finger, which is bent more.

    Args:
        poses: Poses.
        bends: Bend that is added to all joints of the index finger at each minimum, radians.
        cost: Cost of each minimum.
    """
    count = bends.shape[1]
    angles = np.repeat(poses.joint_angles[:, None], count, axis=1)
    angles[:, :, :3, 0] += bends[..., None]
    return FrameEstimates(
        poses.frames,
        poses.times,
        angles,
        np.repeat(poses.root_rotation[:, None], count, axis=1),
        np.repeat(poses.place[:, None], count, axis=1),
        np.repeat(poses.certainty[:, None], count, axis=1),
        cost,
    )


def still_poses(frames: int) -> Poses:
    """A hand that does not move."""
    return Poses(
        np.arange(frames),
        np.arange(frames) / RATE,
        np.zeros((frames, 15, 3)),
        np.repeat(np.eye(3)[None], frames, axis=0),
        np.zeros((frames, 3)),
        np.ones(frames),
    )


def some_frames(poses: Poses, rows: np.ndarray) -> Poses:
    """Poses of some of the frames.

    Args:
        poses: Poses.
        rows: Mask or positions of the frames.
    """
    return Poses(
        poses.frames[rows],
        poses.times[rows],
        poses.joint_angles[rows],
        poses.root_rotation[rows],
        poses.place[rows],
        poses.certainty[rows],
    )


def assert_same_poses(one: Poses, other: Poses, tolerance: float = 1e-9) -> None:
    """Fail unless two motions agree in every number."""
    np.testing.assert_array_equal(one.frames, other.frames)
    for name in ("times", "joint_angles", "root_rotation", "place", "certainty"):
        np.testing.assert_allclose(
            getattr(one, name), getattr(other, name), rtol=0, atol=tolerance, err_msg=name
        )
