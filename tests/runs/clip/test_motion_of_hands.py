"""Motion of a hand from its minima: which frames without a pose are bridged."""

import numpy as np
import pytest
import torch

from hand_recon.detection.tracking import TrackerState
from hand_recon.motion.estimates import FrameEstimates
from hand_recon.motion.identity import Track
from hand_recon.runs.clip.found_frames import FoundFrame
from hand_recon.runs.clip.motion_of_hands import motion_of
from hand_recon.runs.clip.options import MotionOptions


def estimates(cost: np.ndarray, times: np.ndarray) -> FrameEstimates:
    """One minimum per frame, of a hand at rest."""
    count = len(cost)
    return FrameEstimates(
        frames=np.arange(count),
        times=times,
        joint_angles=np.zeros((count, 1, 15, 3)),
        root_rotation=np.tile(np.eye(3), (count, 1, 1, 1)),
        place=np.tile(np.array([0.1, 0.2, np.log(0.5)]), (count, 1, 1)),
        certainty=np.ones((count, 1)),
        cost=cost[:, None],
    )


@pytest.mark.parametrize(("longest_gap", "bridged"), [(0.5, range(3, 6)), (0.15, ()), (0.0, ())])
def test_frames_without_a_fit_are_a_gap_like_any_other(
    longest_gap: float, bridged: range | tuple[int, ...]
) -> None:
    """Frames 3 to 5 have a hand with too few landmarks: 0.16 s from the fit before to the one after."""
    times = np.arange(10) / 25
    cost = np.zeros(10)
    cost[3:6] = np.inf
    track = Track(
        number=1, side="right", agreement=1.0, mean_score=0.9, frames=np.arange(10), times=times,
        detections=np.zeros(10, dtype=np.int64), gaps=(),
    )  # fmt: skip
    frames = [
        FoundFrame(number, float(time), (64, 48), (), TrackerState())
        for number, time in enumerate(times)
    ]
    options = MotionOptions(longest_gap=longest_gap)
    found = motion_of(track, torch.zeros(10), estimates(cost, times), frames, options).smooth
    assert found.frames[~found.observed].tolist() == list(bridged)
    assert len(found) == 7 + len(bridged)
    np.testing.assert_allclose(found.translation, np.tile([0.05, 0.1, 0.5], (len(found), 1)))
