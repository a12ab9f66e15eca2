"""MANO's forward pass from its own parameters: axis angles from the rest pose, rotation about the wrist.

It decodes the labels of FreiHAND, DexYCB and HO3D (`labels.py`), for right and left hands, and converts them
to `HandParameters`. Kinematics, skinning and blend shapes are those of `HandModel`.
"""

from pathlib import Path
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn

from hand_recon.hand.anatomical_frame import joint_angles_of
from hand_recon.hand.axis_angle import axis_angle_to_rotation
from hand_recon.hand.mano.hand import asset_of, with_left_shape
from hand_recon.hand.mano.store import ManoFile, Side, read_mano
from hand_recon.hand.model import HandModel, transform
from hand_recon.hand.skeleton import ROOT_JOINT
from hand_recon.schema import HandGeometry, HandParameters


class ManoParameters(NamedTuple):
    """Arguments of `ManoLayer.forward`: MANO's own pose, shape and translation."""

    global_rotation: Float[Tensor, "*batch 3"]
    """Axis angle of the whole hand about its wrist, radians."""
    pose: Float[Tensor, "*batch angle=45"]
    """Axis angle of each of the 15 joints from the rest pose, mean pose included, radians."""
    shape: Float[Tensor, "*batch direction=10"]
    """Coefficients of the shape directions, standard deviations."""
    translation: Float[Tensor, "*batch 3"]
    """MANO's translation, metres; not the wrist's position, since the wrist at rest is not at the origin."""


class ManoLayer(nn.Module):
    """MANO's right or left hand in its own parameters, for any batch shape and precision."""

    hands_mean: Tensor
    hands_components: Tensor

    def __init__(
        self, file: ManoFile, landmark_set: str = "mano", dtype: torch.dtype = torch.float32
    ) -> None:
        """Build the layer from the contents of a file; `load` reads one.

        Args:
            file: The hand. Its shape directions are used unchanged.
            landmark_set: `mano` (the same as `freihand`), `dexycb`, `ho3d` or `smplx`.
            dtype: Precision of the arrays.

        Raises:
            ValueError: The landmark set is unknown.
        """
        super().__init__()
        self.side = file.side
        self.hand = HandModel(asset_of(file, dtype), landmark_set)
        for name in ("hands_mean", "hands_components"):
            array = torch.from_numpy(getattr(file.arrays, name)).to(dtype)
            self.register_buffer(name, array, persistent=False)

    @classmethod
    def load(
        cls,
        path: Path | str,
        side: Side = "right",
        landmark_set: str = "mano",
        fix_left_shape: bool = True,
        *,
        dtype: torch.dtype = torch.float32,
    ) -> "ManoLayer":
        """Read a file and build the layer; arguments and errors are those of `load_mano`.

        DexYCB's left hands need `fix_left_shape=False`.
        """
        file = with_left_shape(read_mano(path, side), path, fix_left_shape)
        return cls(file, landmark_set, dtype)

    def from_pca(
        self, coefficients: Float[Tensor, "*batch component=45"]
    ) -> Float[Tensor, "*batch angle=45"]:
        """Convert coefficients of the pose components about the mean pose to axis angles (DexYCB)."""
        return self.from_residual(coefficients @ self.hands_components)

    def from_residual(
        self, axis_angles: Float[Tensor, "*batch angle=45"]
    ) -> Float[Tensor, "*batch angle=45"]:
        """Convert axis angles relative to the mean pose to axis angles from the rest pose (FreiHAND)."""
        return self.hands_mean + axis_angles

    def wrist(self, shape: Float[Tensor, "*batch direction=10"]) -> Float[Tensor, "*batch 3"]:
        """Wrist at rest in the file's frame, the centre of the global rotation, metres."""
        return self._at_rest(shape, 0)

    def forward(
        self,
        global_rotation: Float[Tensor, "*batch 3"],
        pose: Float[Tensor, "*batch angle=45"],
        shape: Float[Tensor, "*batch direction=10"],
        translation: Float[Tensor, "*batch 3"],
    ) -> HandGeometry:
        """Pose the hand in the frame of its parameters; the arguments are `ManoParameters`."""
        own = self.hand.pose(_rotations(pose), shape)
        origin = self._origin(global_rotation, shape, translation)
        return transform(own, axis_angle_to_rotation(global_rotation), origin)

    def hand_parameters(
        self,
        global_rotation: Float[Tensor, "*batch 3"],
        pose: Float[Tensor, "*batch angle=45"],
        shape: Float[Tensor, "*batch direction=10"],
        translation: Float[Tensor, "*batch 3"],
    ) -> HandParameters:
        """Convert MANO's parameters of a right hand to those of `HandModel.to_camera`.

        Raises:
            ValueError: The layer is a left hand; `HandParameters` describe right hands only.
        """
        if self.side != "right":
            raise ValueError(
                "Hand parameters describe right hands; this layer is MANO's left hand. Mirror the axis "
                "angles (`mirror_axis_angle`) and use the right layer, or mirror the points."
            )
        return HandParameters(
            joint_angles=joint_angles_of(_rotations(pose), self.hand.frames, self.hand.rest_angles),
            shape=shape,
            root_rotation=axis_angle_to_rotation(global_rotation),
            translation=self._origin(global_rotation, shape, translation),
        )

    def _origin(
        self,
        global_rotation: Float[Tensor, "*batch 3"],
        shape: Float[Tensor, "*batch direction=10"],
        translation: Float[Tensor, "*batch 3"],
    ) -> Float[Tensor, "*batch 3"]:
        """Position of the middle MCP, the origin of the hand's frame, in the posed hand, metres."""
        wrist = self._at_rest(shape, 0)
        bone = self._at_rest(shape, ROOT_JOINT) - wrist
        rotated = (axis_angle_to_rotation(global_rotation) @ bone[..., None])[..., 0]
        return rotated + wrist + translation

    def _at_rest(
        self, shape: Float[Tensor, "*batch direction=10"], joint: int
    ) -> Float[Tensor, "*batch 3"]:
        """Rotation centre of a joint at rest in the file's frame, metres."""
        directions = self.hand.joint_shape_directions[joint]
        return self.hand.joints_template[joint] + torch.einsum("xs,...s->...x", directions, shape)


def _rotations(pose: Float[Tensor, "*batch angle=45"]) -> Float[Tensor, "*batch joint=15 3 3"]:
    return axis_angle_to_rotation(pose.unflatten(-1, (15, 3)))
