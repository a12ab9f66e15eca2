"""Projected landmarks and their derivatives by all unknowns, in closed form (Sec. 3.1)."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.fitting.second_order.chain import (
    LEVEL_ORDER,
    Skeleton,
    chain_points,
    subtrees,
)
from hand_recon.fitting.second_order.unknowns import ANGLES, COUNT, PLACE, ROTATION, SHAPE, Unknowns
from hand_recon.hand.model import HandModel

NEAREST = 0.01
"""Depth to which points are clamped, metres, as `hand_recon.camera.project` has it."""


@dataclass(frozen=True)
class Projected:
    """Projections of the landmarks and what their derivatives are made of; hands are the last axis."""

    pixels: Float[Tensor, "2 landmark=21 hand"]
    """Projections, pixels."""
    slopes: Float[Tensor, "2 3 landmark=21 hand"]
    """Derivatives of a projection by the point, pixels per metre."""
    turned: Float[Tensor, "3 pair hand"]
    """For each pair of a landmark and a joint: the part of the landmark that the joint's rotation moves."""
    orientations: Float[Tensor, "3 3 joint=16 hand"]
    """World directions of the joints' anatomical axes."""
    axes: Float[Tensor, "3 axis=3 joint=16 hand"]
    """World axis of every angle."""
    translation: Float[Tensor, "hand 3"]
    """Position of the hand's origin, metres."""


class LandmarkProjection:
    """Projection of a hand model's landmarks with its Jacobian.

    Args:
        hand: Hand model, with all vertices or only those of its landmarks.
    """

    def __init__(self, hand: HandModel) -> None:
        self.skeleton = Skeleton(hand)
        points = chain_points(hand, hand.landmark_regressor)
        count = len(points.mean)
        below = subtrees()[list(LEVEL_ORDER)][:, list(LEVEL_ORDER)]
        used = (points.mean != 0).any(-1) | (points.shape_directions != 0).any(-1).any(-1)
        # Summands: pairs of landmark and joint, padded to the same number for every landmark.
        slots = int(used.sum(dim=1).max())
        joints = torch.stack(
            [row.int().argsort(descending=True, stable=True)[:slots] for row in used]
        )
        rows = torch.arange(count)[:, None]
        kept = used[rows, joints]
        self._summand_joint = joints.flatten()
        self._mean = (points.mean[rows, joints] * kept[..., None]).flatten(0, 1)
        directions = points.shape_directions[rows, joints] * kept[..., None, None]
        self._directions = directions.reshape(-1, 10)
        self._directions_by_landmark = directions.flatten(1, 2).mT.contiguous()
        self._slots = slots
        # Moved pairs: each landmark with the root, then with every joint that rotates part of it.
        moved = used.int() @ below.int().mT > 0
        moved[:, 0] = False
        landmark, joint = moved.nonzero().unbind(1)
        self._pair_landmark = torch.cat([torch.arange(count), landmark])
        self._pair_joint = torch.cat([torch.zeros(count, dtype=torch.long), joint])
        same = self._pair_landmark[:, None] == rows.expand(count, slots).flatten()
        inside = below[self._pair_joint][:, self._summand_joint]
        self._sum_over_subtree = (same & inside).to(hand.template)
        self._count = count
        self._entries = self._entry_index()

    def _entry_index(self) -> Tensor:
        """Positions of the derivatives by rotations in the flattened Jacobian, axis × coordinate × pair."""
        order = torch.tensor(LEVEL_ORDER)[self._pair_joint]
        first = torch.where(order == 0, ROTATION.start, ANGLES.start + 3 * (order - 1))
        column = first[None, None] + torch.arange(3)[:, None, None]
        row = torch.arange(2)[None, :, None] * self._count + self._pair_landmark
        return (row * COUNT + column).flatten()

    def __call__(
        self,
        unknowns: Unknowns,
        intrinsics: Float[Tensor, "hand 3 3"],
        inverse: Float[Tensor, "hand 3 3"],
    ) -> Projected:
        """Project the landmarks of hands.

        Args:
            unknowns: The hands.
            intrinsics: Camera matrices, pixels.
            inverse: Their inverses.
        """
        orientations, axes = self.skeleton(unknowns.joint_angles, unknowns.root_rotation)
        local = self._directions @ unknowns.shape.mT
        local = local.unflatten(0, (-1, 3)) + self._mean[..., None]
        # Each summand in the camera's axes.
        world = (orientations[:, :, self._summand_joint] * local.transpose(0, 1)).sum(dim=1)
        turned = self._sum_over_subtree @ world.transpose(0, 1).flatten(1)
        turned = turned.unflatten(1, (3, -1)).transpose(0, 1)
        translation = unknowns.translation(inverse)
        points = turned[:, : self._count] + translation.mT[:, None]
        pixels, slopes = _projected(points, intrinsics)
        return Projected(pixels, slopes, turned, orientations, axes, translation)

    def jacobian(
        self, at: Projected, inverse: Float[Tensor, "hand 3 3"]
    ) -> Float[Tensor, "hand coordinate=42 unknown=61"]:
        """Derivatives of the pixels by the unknowns: all u, then all v.

        Args:
            at: The hands, projected.
            inverse: Inverse camera matrices.
        """
        hands = len(at.translation)
        flat = at.pixels.new_zeros(2 * self._count * COUNT, hands)
        moved = _cross(at.turned[:, None], at.slopes[:, :, self._pair_landmark].transpose(0, 1))
        by_angle = (moved[:, None] * at.axes[:, :, None, self._pair_joint]).sum(dim=0)
        flat[self._entries] = by_angle.flatten(0, 2)
        whole = flat.view(2, self._count, COUNT, hands)
        whole[:, :, PLACE] = self._by_place(at, inverse)
        whole[:, :, SHAPE] = self._by_shape(at)
        return flat.mT.unflatten(1, (2 * self._count, COUNT)).contiguous()

    def _by_place(self, at: Projected, inverse: Tensor) -> Float[Tensor, "2 landmark=21 3 hand"]:
        """Derivatives by the projection of the origin and by the log depth."""
        depth = at.translation[:, 2, None]
        columns = torch.stack(
            [inverse[:, :, 0] * depth, inverse[:, :, 1] * depth, at.translation], dim=-1
        )
        return (at.slopes[:, :, :, None] * columns.permute(1, 2, 0)[None, :, None]).sum(dim=1)

    def _by_shape(self, at: Projected) -> Float[Tensor, "2 landmark=21 direction=10 hand"]:
        """Derivatives by the shape coefficients."""
        hands = len(at.translation)
        turn = at.orientations[:, :, self._summand_joint].unflatten(2, (self._count, self._slots))
        # Landmark × (slot × axis) × (coordinate × hand).
        pulled = (at.slopes[:, :, None, :, None] * turn[None]).sum(dim=1)
        pulled = pulled.permute(2, 3, 1, 0, 4).reshape(self._count, self._slots * 3, 2 * hands)
        found = self._directions_by_landmark @ pulled
        return found.unflatten(2, (2, hands)).permute(2, 0, 1, 3)


def _projected(
    points: Float[Tensor, "3 landmark=21 hand"], intrinsics: Float[Tensor, "hand 3 3"]
) -> tuple[Float[Tensor, "2 landmark=21 hand"], Float[Tensor, "2 3 landmark=21 hand"]]:
    """Project points, and differentiate the projections by the points."""
    matrix = intrinsics.permute(1, 2, 0)[:2, :, None]
    over_depth = 1 / points[2].clamp(min=NEAREST)
    on_plane = points[:2] * over_depth
    pixels = matrix[:, 0] * on_plane[0] + matrix[:, 1] * on_plane[1] + matrix[:, 2]
    linear = matrix[:, :2] * over_depth
    by_depth = -(linear * on_plane).sum(dim=1, keepdim=True)
    return pixels, torch.cat([linear, by_depth], dim=1)


def _cross(first: Tensor, second: Tensor) -> Tensor:
    """Cross product along the first axis."""
    a, b, c = first.unbind(0)
    d, e, f = second.unbind(0)
    return torch.stack([b * f - c * e, c * d - a * f, a * e - b * d])
