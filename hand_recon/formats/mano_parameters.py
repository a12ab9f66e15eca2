"""MANO's own parameters of one hand, for smplx, manopth and programs built on them; needs `hand=mano`.

The arrays of the file, for the model of the hand's own side (`MANO_LEFT` for a left hand):

    global_orient   frame × 3, axis angle of the hand about its wrist, radians, camera's axes
    hand_pose       frame × 45, axis angles of the 15 joints in MANO's order, radians
    betas           10, shape coefficients
    transl          frame × 3, metres; the wrist is at `transl` plus its place at rest
    flat_hand_mean  true: the pose counts from the flat hand, MANO's zero; for a model that adds its mean pose
                    (`flat_hand_mean=False`), subtract `hands_mean` of the MANO file from `hand_pose`
    is_right        true for a right hand
    time, frame     seconds from the clip's start, and number, of each frame with the hand
    seen            false where a gap of the clip was bridged

The frame is the camera's: x right, y down, z forward. A left hand's `betas` are for shape directions that
mirror the right hand's. The released MANO_LEFT has them unmirrored in x (smplx issue 48), which users of
smplx correct with `shapedirs[:, 0, :] *= -1`.
"""

import io
from pathlib import Path

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from hand_recon.formats.exported_hands import ExportedHand
from hand_recon.formats.joint_motion import check_motions, local_rotations
from hand_recon.formats.new_file import write_new
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import ROOT_JOINT
from hand_recon.motion.trajectory import mirror_of


def write_mano_parameters(path: str | Path, hand: ExportedHand, model: HandModel) -> Path:
    """Write the parameters of a hand as a NumPy archive; folders are made.

    Args:
        path: File to write.
        hand: The hand.
        model: MANO's right hand.

    Raises:
        FileExistsError: The file exists.
        ValueError: The hand has no frame, numbers are not finite, or a time is negative.
    """
    check_motions([hand.trajectory])
    motion = hand.trajectory
    mirror = mirror_of(motion.side)
    angles = torch.as_tensor(motion.joint_angles).to(model.template)
    fingers = local_rotations(angles, model) * np.outer(mirror, mirror)
    shape = torch.as_tensor(motion.shape).to(model.template)
    rest = model.joints_template + model.joint_shape_directions @ shape
    wrist, origin = rest[[0, ROOT_JOINT]].double().numpy() * mirror
    # MANO rotates the hand about its wrist, which is not at the origin of its file.
    translation = motion.translation - wrist - motion.root_rotation @ (origin - wrist)
    pose = Rotation.from_matrix(fingers.reshape(-1, 3, 3)).as_rotvec().reshape(-1, 45)
    stream = io.BytesIO()
    np.savez_compressed(
        stream, global_orient=Rotation.from_matrix(motion.root_rotation).as_rotvec(), hand_pose=pose,
        betas=motion.shape, transl=translation, flat_hand_mean=True, is_right=motion.side == "right",
        time=motion.times, frame=motion.frames, seen=motion.observed,
    )  # fmt: skip
    return write_new(path, stream.getvalue())
