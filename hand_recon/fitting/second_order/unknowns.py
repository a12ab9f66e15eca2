"""The unknowns of a fit and a step away from them (Sec. 3.1)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Final, Self

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.camera import project
from hand_recon.fitting.start import SHALLOWEST, Start
from hand_recon.hand.axis_angle import axis_angle_to_rotation
from hand_recon.schema import HandParameters

ANGLES: Final = slice(0, 45)
"""Joint angles among the unknowns, joint by joint: bend, splay, twist, radians."""
ROTATION: Final = slice(45, 48)
"""Axis angle of a root rotation that is applied last, in the camera's axes, radians."""
PLACE: Final = slice(48, 51)
"""Projection of the hand's origin, pixels, and log depth."""
SHAPE: Final = slice(51, 61)
"""Shape coefficients, standard deviations."""
COUNT: Final = 61
"""Unknowns of one hand."""


@dataclass(frozen=True)
class Unknowns:
    """Pose, shape and place of hands in coordinates in which a least-squares problem is nearly linear."""

    joint_angles: Float[Tensor, "hand joint=15 axis=3"]
    """Bend, splay and twist, radians."""
    root_rotation: Float[Tensor, "hand 3 3"]
    """Rotation from the hand's frame to the camera's."""
    place: Float[Tensor, "hand 3"]
    """Projection of the hand's origin, pixels, and the logarithm of its depth in metres."""
    shape: Float[Tensor, "hand direction=10"]
    """Shape coefficients, standard deviations."""

    @classmethod
    def of_start(cls, start: Start, intrinsics: Float[Tensor, "hand 3 3"]) -> Self:
        """Unknowns of starts, one per hand.

        Args:
            start: The starts.
            intrinsics: Camera matrices, pixels.
        """
        pixel = project(start.translation[:, None], intrinsics)[:, 0]
        log_depth = start.translation[:, 2].clamp(min=SHALLOWEST).log()
        place = torch.cat([pixel, log_depth[:, None]], dim=-1)
        return cls(start.joint_angles, start.root_rotation, place, start.shape)

    @classmethod
    def beside(cls, starts: Sequence[Self], hands: int) -> Self:
        """Join starts so that those of each hand are behind each other.

        Args:
            starts: Starts of all hands, any number for every hand.
            hands: Number of hands.
        """
        columns = [[getattr(start, field.name) for start in starts] for field in fields(cls)]
        each = [len(start) // max(hands, 1) for start in starts]
        return cls(
            *(
                torch.cat(
                    [value.unflatten(0, (hands, n)) for value, n in zip(column, each, strict=True)],
                    dim=1,
                ).flatten(0, 1)
                for column in columns
            )
        )

    def __len__(self) -> int:
        return len(self.shape)

    def __getitem__(self, hands: Tensor) -> Self:
        """The unknowns of some of the hands."""
        return type(self)(
            self.joint_angles[hands],
            self.root_rotation[hands],
            self.place[hands],
            self.shape[hands],
        )

    def joined(self, other: Self) -> Self:
        """These unknowns, then other ones.

        Args:
            other: The others.
        """
        return type(self)(
            torch.cat([self.joint_angles, other.joint_angles]),
            torch.cat([self.root_rotation, other.root_rotation]),
            torch.cat([self.place, other.place]),
            torch.cat([self.shape, other.shape]),
        )

    def moved(self, step: Float[Tensor, "hand unknown=61"]) -> Self:
        """The unknowns after a step; depths stay above `SHALLOWEST`."""
        place = self.place + step[:, PLACE]
        place = torch.cat([place[:, :2], place[:, 2:].clamp(min=math.log(SHALLOWEST))], dim=-1)
        return type(self)(
            self.joint_angles + step[:, ANGLES].unflatten(-1, (15, 3)),
            axis_angle_to_rotation(step[:, ROTATION]) @ self.root_rotation,
            place,
            self.shape + step[:, SHAPE],
        )

    def where(self, chosen: Tensor, other: Self) -> Self:
        """These unknowns where a mask of hands is true, the others' elsewhere."""
        return type(self)(
            torch.where(chosen[:, None, None], self.joint_angles, other.joint_angles),
            torch.where(chosen[:, None, None], self.root_rotation, other.root_rotation),
            torch.where(chosen[:, None], self.place, other.place),
            torch.where(chosen[:, None], self.shape, other.shape),
        )

    def put(self, hands: Tensor, some: Self) -> Self:
        """These unknowns with those of some hands replaced.

        Args:
            hands: Indices of those hands.
            some: Their unknowns.
        """
        return type(self)(
            self.joint_angles.index_put((hands,), some.joint_angles),
            self.root_rotation.index_put((hands,), some.root_rotation),
            self.place.index_put((hands,), some.place),
            self.shape.index_put((hands,), some.shape),
        )

    def translation(self, inverse: Float[Tensor, "hand 3 3"]) -> Float[Tensor, "hand 3"]:
        """Position of the hands' origins, metres.

        Args:
            inverse: Inverse camera matrices.
        """
        one = torch.ones_like(self.place[:, :1])
        rays = (inverse @ torch.cat([self.place[:, :2], one], dim=-1)[..., None])[..., 0]
        return rays * self.place[:, 2:].exp()

    def parameters(self, inverse: Float[Tensor, "hand 3 3"]) -> HandParameters:
        """The hands' parameters.

        Args:
            inverse: Inverse camera matrices.
        """
        return HandParameters(
            self.joint_angles, self.shape, self.root_rotation, self.translation(inverse)
        )
