"""Projected landmarks and their derivatives by all unknowns, in closed form (Sec. 3.1)."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from hand_recon.fitting.second_order.chain import (
    Skeleton,
    chain_points,
    subtrees,
)
from hand_recon.fitting.second_order.unknowns import ANGLES, COUNT, ROTATION, Unknowns
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import LEVEL_ORDER

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

    @property
    def points(self) -> Float[Tensor, "3 landmark=21 hand"]:
        """Landmarks from the hand's origin, axes of the camera, metres."""
        return self.turned[:, : self.pixels.shape[1]]


class LandmarkProjection:
    """Projection of a hand model's landmarks with its Jacobian.

    Args:
        hand: Hand model, with all vertices or only those of its landmarks.
        free: Indices of the unknowns that the Jacobian is by, in ascending order; all for none. The
            last 16, which are not joint angles, must be among them.
    """

    def __init__(self, hand: HandModel, free: Int[Tensor, " unknown"] | None = None) -> None:
        self.free = torch.arange(COUNT) if free is None else free
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
        self._kept, self._entries = self._entry_index()

    def _entry_index(self, coordinates: int = 2) -> tuple[Tensor, Tensor]:
        """Positions of the derivatives by rotations: among all, and in the flattened Jacobian.

        The derivatives are axis × coordinate × pair.

        Args:
            coordinates: Coordinates of a landmark, 2 for pixels and 3 for points.
        """
        joint = torch.tensor(LEVEL_ORDER)[self._pair_joint]
        first = torch.where(joint == 0, ROTATION.start, ANGLES.start + 3 * (joint - 1))
        unknown = (first + torch.arange(3)[:, None])[:, None].expand(3, coordinates, -1)
        place = torch.full((COUNT,), -1)
        place[self.free] = torch.arange(len(self.free))
        column = place[unknown].flatten()
        row = torch.arange(coordinates)[:, None] * self._count + self._pair_landmark
        kept = (column >= 0).nonzero()[:, 0]
        return kept, (row.expand(3, coordinates, -1).flatten() * len(self.free) + column)[kept]

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
    ) -> Float[Tensor, "hand coordinate=42 unknown"]:
        """Derivatives of the pixels by the free unknowns: all u, then all v.

        Args:
            at: The hands, projected.
            inverse: Inverse camera matrices.
        """
        hands, columns = len(at.translation), len(self.free)
        flat = at.pixels.new_zeros(2 * self._count * columns, hands)
        slopes = at.slopes[:, :, self._pair_landmark]
        moved = torch.linalg.cross(at.turned[:, None], slopes.transpose(0, 1), dim=0)
        by_angle = (moved[:, None] * at.axes[:, :, None, self._pair_joint]).sum(dim=0)
        flat[self._entries] = by_angle.flatten(0, 2)[self._kept]
        whole = flat.view(2, self._count, columns, hands)
        whole[:, :, columns - 13 : columns - 10] = self._by_place(at, inverse)
        whole[:, :, columns - 10 :] = self._by_shape(at)
        return flat.mT.reshape(hands, 2 * self._count, columns)

    def point_jacobian(self, at: Projected) -> Float[Tensor, "hand coordinate=63 unknown"]:
        """Derivatives of `at.points` by the free unknowns: all x, all y, all z; zero by the place.

        Args:
            at: The hands, projected.
        """
        hands, columns = len(at.translation), len(self.free)
        flat = at.pixels.new_zeros(3 * self._count * columns, hands)
        axes = at.axes[:, :, self._pair_joint]
        by_angle = torch.linalg.cross(axes, at.turned[:, None].expand_as(axes), dim=0)
        kept, entries = self._entry_index(3)
        flat[entries] = by_angle.transpose(0, 1).flatten(0, 2)[kept]
        whole = flat.view(3, self._count, columns, hands)
        turn = at.orientations[:, :, self._summand_joint].unflatten(2, (self._count, self._slots))
        directions = self._directions.view(self._count, self._slots, 3, 10)
        whole[:, :, columns - 10 :] = torch.einsum("wamsh,msad->wmdh", turn, directions)
        return flat.mT.reshape(hands, 3 * self._count, columns)

    def _by_place(self, at: Projected, inverse: Tensor) -> Float[Tensor, "2 landmark=21 3 hand"]:
        """Derivatives by the projection of the origin and by the log depth."""
        depth = at.translation[:, 2, None]
        columns = torch.stack(
            [inverse[:, :, 0] * depth, inverse[:, :, 1] * depth, at.translation], dim=-1
        )
        return torch.einsum("cxmh,hxk->cmkh", at.slopes, columns)

    def _by_shape(self, at: Projected) -> Float[Tensor, "2 landmark=21 direction=10 hand"]:
        """Derivatives by the shape coefficients."""
        hands = len(at.translation)
        turn = at.orientations[:, :, self._summand_joint].unflatten(2, (self._count, self._slots))
        # Landmark × (slot × axis) × (coordinate × hand).
        pulled = (at.slopes[:, :, None, :, None] * turn[None]).sum(dim=1)
        pulled = pulled.permute(2, 3, 1, 0, 4).reshape(self._count, self._slots * 3, 2 * hands)
        found = torch.matmul(self._directions_by_landmark, pulled)
        return found.view(self._count, 10, 2, hands).permute(2, 0, 1, 3)


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
