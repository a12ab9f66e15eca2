"""MANO in its own parameters, as datasets store them: axis angles from its rest pose, about its wrist.

It gives what the labels of FreiHAND, DexYCB and HO3D mean (`mano_labels.py`), for right and left hands, and
says the same in this project's parameters. Its rotations, skinning and blend shapes are `HandModel`'s.
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
from hand_recon.hand.model import HandModel, moved
from hand_recon.hand.skeleton import ROOT_JOINT
from hand_recon.schema import HandGeometry, HandParameters


class ManoParameters(NamedTuple):
    """A placed hand in MANO's own terms: `layer(*parameters)` is the hand."""

    global_rotation: Float[Tensor, "*batch 3"]
    """Axis angle of the whole hand about its wrist, radians."""
    pose: Float[Tensor, "*batch angle=45"]
    """Axis angle of each of the 15 joints from the rest pose, radians: the mean pose is in it."""
    shape: Float[Tensor, "*batch direction=10"]
    """Standard deviations."""
    translation: Float[Tensor, "*batch 3"]
    """Metres. Not the wrist's position: the wrist of the rest pose is not at MANO's origin."""


class ManoLayer(nn.Module):
    """One hand of MANO, right or left, for any batch shape and precision."""

    hands_mean: Tensor
    hands_components: Tensor

    def __init__(
        self, file: ManoFile, landmarks: str = "mano", dtype: torch.dtype = torch.float32
    ) -> None:
        """Build the layer from a hand that was read; `load` reads one.

        Args:
            file: The hand. Its shape directions are used as they are.
            landmarks: `mano` (which is `freihand`), `dexycb`, `ho3d` or `smplx`.
            dtype: Precision of the arrays.

        Raises:
            ValueError: There is no such landmark set.
        """
        super().__init__()
        self.side = file.side
        self.hand = HandModel(asset_of(file, dtype), landmarks)
        for name in ("hands_mean", "hands_components"):
            array = torch.from_numpy(getattr(file.arrays, name)).to(dtype)
            self.register_buffer(name, array, persistent=False)

    @classmethod
    def load(
        cls,
        path: Path | str,
        side: Side = "right",
        landmarks: str = "mano",
        fix_left_shape: bool = True,
        *,
        dtype: torch.dtype = torch.float32,
    ) -> "ManoLayer":
        """Read a hand; `hand_recon.hand.mano.hand.load_mano` explains the arguments and errors.

        DexYCB's left hands are labelled with `fix_left_shape=False`.
        """
        file = with_left_shape(read_mano(path, side), path, fix_left_shape)
        return cls(file, landmarks, dtype)

    def from_pca(
        self, coefficients: Float[Tensor, "*batch component=45"]
    ) -> Float[Tensor, "*batch angle=45"]:
        """Absolute axis angles from coefficients of the pose components about the mean (DexYCB)."""
        return self.from_residual(coefficients @ self.hands_components)

    def from_residual(
        self, axis_angles: Float[Tensor, "*batch angle=45"]
    ) -> Float[Tensor, "*batch angle=45"]:
        """Absolute axis angles from axis angles relative to the mean pose (FreiHAND)."""
        return self.hands_mean + axis_angles

    def wrist(self, shape: Float[Tensor, "*batch direction=10"]) -> Float[Tensor, "*batch 3"]:
        """MANO's wrist at rest in the file's frame, metres: what the whole hand turns about."""
        return self._at_rest(shape, 0)

    def forward(
        self,
        global_rotation: Float[Tensor, "*batch 3"],
        pose: Float[Tensor, "*batch angle=45"],
        shape: Float[Tensor, "*batch direction=10"],
        translation: Float[Tensor, "*batch 3"],
    ) -> HandGeometry:
        """The hand in the frame of its parameters; `ManoParameters` says what they are."""
        own = self.hand.pose(_rotations(pose), shape)
        origin = self._origin(global_rotation, shape, translation)
        return moved(own, axis_angle_to_rotation(global_rotation), origin)

    def hand_parameters(
        self,
        global_rotation: Float[Tensor, "*batch 3"],
        pose: Float[Tensor, "*batch angle=45"],
        shape: Float[Tensor, "*batch direction=10"],
        translation: Float[Tensor, "*batch 3"],
    ) -> HandParameters:
        """The same right hand in this project's parameters: what `HandModel.to_camera` takes.

        Raises:
            ValueError: This is a left hand, which this project mirrors before it gives it parameters.
        """
        if self.side != "right":
            raise ValueError(
                "Parameters are those of right hands; this layer is MANO's left hand. Mirror the axis "
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
        """Where the origin of the hand's own frame, the middle MCP, comes to be."""
        wrist = self._at_rest(shape, 0)
        bone = self._at_rest(shape, ROOT_JOINT) - wrist
        turned = (axis_angle_to_rotation(global_rotation) @ bone[..., None])[..., 0]
        return turned + wrist + translation

    def _at_rest(
        self, shape: Float[Tensor, "*batch direction=10"], joint: int
    ) -> Float[Tensor, "*batch 3"]:
        """A rotation centre at rest in the file's frame."""
        directions = self.hand.joint_shape_directions[joint]
        return self.hand.joints_template[joint] + torch.einsum("xs,...s->...x", directions, shape)


def _rotations(pose: Float[Tensor, "*batch angle=45"]) -> Float[Tensor, "*batch joint=15 3 3"]:
    return axis_angle_to_rotation(pose.unflatten(-1, (15, 3)))
