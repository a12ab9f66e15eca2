"""Made-up files of hands for tests of the formats: a clip with a gap, and photographs."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float

from hand_recon.fitting.hand_records import HandRecords, joined_records
from hand_recon.fitting.origin import Moment
from hand_recon.formats.exported_hands import ExportedHands, exported_hands
from hand_recon.hand.model import HandModel
from hand_recon.motion.posing import landmarks_of, right_hands
from hand_recon.motion.trajectory import Trajectory, mirror_of
from tests.support.trajectories import Clip, moving_hand, still_hand, without_frames

GAP = range(3, 6)
"""Frames in which the left hand of the clip is missing."""


def records_of(
    trajectory: Trajectory, hand: HandModel, *, image: str | None = None, of_clip: bool = True
) -> HandRecords:
    """Records of a motion as a file of hands has them, with a covariance of its own at each landmark."""
    count = len(trajectory)
    rng = np.random.default_rng(trajectory.hand)
    spread = 0.002 * rng.normal(size=(count, 21, 3, 3))
    moments = [
        Moment(trajectory.hand, frame, time, seen)
        for frame, time, seen in zip(
            trajectory.frames.tolist(),
            trajectory.times.tolist(),
            trajectory.observed.tolist(),
            strict=True,
        )
    ]
    return HandRecords(
        names=(image or "given",) * count,
        images=(image,) * count,
        sides=(trajectory.side,) * count,
        verdicts=("plausible",) * count,
        reasons=((),) * count,
        score=np.full(count, 0.9),
        landmarks_3d=landmarks_of(trajectory, hand),
        landmarks_2d=np.zeros((count, 21, 2)),
        observed_2d=np.zeros((count, 21, 2)),
        sigma_2d=np.ones((count, 21, 2)),
        covariance_3d=spread @ spread.swapaxes(-1, -2),
        joint_angles_degrees=np.degrees(trajectory.joint_angles),
        shape=np.tile(trajectory.shape, (count, 1)),
        root_rotation=trajectory.root_rotation,
        translation=trajectory.translation,
        intrinsics=np.tile(np.eye(3), (count, 1, 1)),
        cameras=("given",) * count,
        image_sizes=((640, 480),) * count,
        residual=np.zeros(count),
        loss={"data": np.zeros(count)},
        sources=("mediapipe, fit",) * count,
        hand_models=(hand.name,) * count,
        versions=("0",) * count,
        moments=tuple(moments) if of_clip else (None,) * count,
    )


def clip_hands() -> list[Trajectory]:
    """A left hand that is missing in `GAP`, and a right one that comes later, in ten frames."""
    left = without_frames(moving_hand(1, "left", Clip(frames=10)), *GAP)
    return [left, moving_hand(2, "right", Clip(frames=6, start=4, seed=1))]


def clip(hand: HandModel) -> ExportedHands:
    """The hands of `clip_hands`."""
    return exported_hands(joined_records([records_of(one, hand) for one in clip_hands()]), hand)


def photographs(hand: HandModel) -> ExportedHands:
    """Two hands of one photograph, and one of another in a folder."""
    angles = np.radians(np.random.default_rng(5).uniform(0, 40, (15, 3)) * [1.0, 0.2, 0.05])
    right = still_hand(angles)
    left = replace(still_hand(angles[::-1], "left"), translation=np.array([[0.1, 0.05, 0.7]]))
    far = replace(right, translation=np.array([[-0.2, 0.0, 1.2]]))
    parts = [
        records_of(one, hand, image=image, of_clip=False)
        for one, image in ((right, "two hands.jpg"), (left, "two hands.jpg"), (far, "b/far.png"))
    ]
    return exported_hands(joined_records(parts), hand)


def expected_joints(
    motion: Trajectory, hand: HandModel, rows: Sequence[int] | None = None
) -> Float[np.ndarray, "frame joint=16 3"]:
    """Rotation centres in some frames of a motion, camera frame, metres."""
    chosen = np.arange(len(motion)) if rows is None else np.array(rows)
    with torch.no_grad():
        posed = hand.to_camera(right_hands(motion, chosen)).joints.double().numpy()
    return np.asarray(posed * mirror_of(motion.side))
