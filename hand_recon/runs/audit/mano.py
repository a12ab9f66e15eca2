"""MANO's pose and shape of other systems' files as joint angles, with the user's own MANO (`hand=mano`)."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor

from hand_recon.hand.mano.layer import ManoLayer
from hand_recon.hand.model import HandModel
from hand_recon.plausibility.given_hands import GivenHands, of_points, rows_by
from hand_recon.plausibility.mano_rotations import ManoPose, to_parameters, to_rotations
from hand_recon.schema import HandParameters


class ManoReader:
    """Conversion of MANO's parameters with the user's MANO.

    Args:
        hand: MANO's right hand.
        path: Folder of its files.
    """

    def __init__(self, hand: HandModel, path: Path) -> None:
        self._hand, self._path = hand, path

    def hands(
        self,
        pose: ManoPose,
        file: str,
        sides: Sequence[str],
        names: Sequence[str],
        tracks: Sequence[int] | None = None,
    ) -> GivenHands:
        """Hands of a file.

        Args:
            pose: Their pose and shape.
            file: The file.
            sides: Sides that the file names, `left`, `right` or empty.
            names: Names of the hands.
            tracks: Numbers of their tracks, each of one hand; one track by default. HaWoR's first is of left
                hands and its second of right ones, and no array says so.
        """
        count = len(pose.shape)
        parameters = HandParameters(
            torch.full((count, 15, 3), torch.nan), pose.shape.clone(), pose.global_rotation.clone(),
            torch.zeros(count, 3),
        )  # fmt: skip
        notes = []
        unnamed = [0] * count if tracks is None else tracks
        keys = [side or f"track {track}" for side, track in zip(sides, unnamed, strict=True)]
        for key, rows in rows_by(keys).items():
            own = ManoPose(pose.rotations[rows], pose.shape[rows], pose.global_rotation[rows])
            found, turned = to_parameters(own, self._hand)
            parameters.joint_angles[rows] = found.joint_angles
            parameters.root_rotation[rows] = found.root_rotation
            parameters.translation[rows] = found.translation
            if bool(turned):
                whose = f"{key} hands" if sides[rows[0]] else "all hands" if tracks is None else key
                notes.append(
                    f"{file}: the rotations of {whose} are those of left hands; they were mirrored."
                )
        points = torch.full((count, 21, 3), torch.nan)
        left = [side == "left" for side in sides]
        given = of_points(points, file, names=names, left=left, sides=sides)
        given = replace(given, parameters=parameters, hand_models=("mano",) * count)
        return given.with_notes(*notes)

    def from_mean(self, axis_angles: Tensor) -> Tensor:
        """Axis angles from the flat rest pose, out of those from MANO's mean pose (FreiHAND).

        Args:
            axis_angles: Hand × 45, radians.
        """
        return ManoLayer.load(self._path).from_residual(axis_angles)


def mano_pose(
    pose: Tensor, shape: Tensor | None = None, global_rotation: Tensor | None = None
) -> ManoPose:
    """Pose of hands, out of rotations in any of their forms.

    Args:
        pose: Rotations of 15 joints, or of 16 with the whole hand's first.
        shape: Coefficients of the shape directions; the mean hand without them.
        global_rotation: Rotation of the whole hand, matrices or axis angles.

    Raises:
        ValueError: There are neither 15 nor 16 joints.
    """
    rotations = to_rotations(pose.float())
    count, joints = rotations.shape[:2]
    if joints not in (15, 16):
        raise ValueError(
            f"A pose of {joints} rotations was found; expected MANO's 15 joints, or 16 with the whole hand. "
            "Coefficients of pose components have to be converted to axis angles first."
        )
    whole = torch.eye(3).repeat(count, 1, 1)
    if joints == 16:
        whole, rotations = rotations[:, 0], rotations[:, 1:]
    elif global_rotation is not None:
        whole = to_rotations(
            global_rotation.float().reshape(count, -1).unflatten(1, _form(global_rotation, count))
        )[:, 0]
    if shape is None:
        shape = torch.zeros(count, 10)
    return ManoPose(rotations, shape.float().reshape(count, -1)[:, :10], whole)


def _form(rotation: Tensor, count: int) -> tuple[int, ...]:
    """Shape of the rotation of one whole hand: a matrix or an axis angle."""
    return (1, 3, 3) if rotation.numel() == 9 * count else (1, 3)
