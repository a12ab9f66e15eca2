"""Hands of a motion posed in the camera's frame."""

import numpy as np
import torch
from jaxtyping import Float, Int

from hand_recon.hand.model import HandModel
from hand_recon.motion.trajectory import Trajectory, mirror_of
from hand_recon.schema import HandParameters


def right_hands(motion: Trajectory, rows: Int[np.ndarray, " row"]) -> HandParameters:
    """Parameters of some frames of a motion; those of a left hand are of the right one that it mirrors.

    Args:
        motion: The motion.
        rows: Positions of the frames.
    """
    mirror = mirror_of(motion.side)
    rotation = mirror[:, None] * motion.root_rotation[rows] * mirror
    translation = motion.translation[rows] * mirror
    shape = np.tile(motion.shape, (len(rows), 1))
    columns = (motion.joint_angles[rows], shape, rotation, translation)
    return HandParameters(*(torch.from_numpy(np.ascontiguousarray(one)).float() for one in columns))


@torch.no_grad()
def landmarks_of(motion: Trajectory, hand: HandModel) -> Float[np.ndarray, "frame landmark=21 3"]:
    """Landmarks of a motion, camera frame, metres; left hands are left hands.

    Args:
        motion: The motion.
        hand: The hand model, of right hands.
    """
    found = hand.to_camera(right_hands(motion, np.arange(len(motion)))).landmarks
    return np.asarray(found.double().numpy() * mirror_of(motion.side))
