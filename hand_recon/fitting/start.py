"""Closed-form starts of a fit: the two poses of the palm that one view cannot tell apart.

The wrist and the bases of the fingers move little against each other and lie nearly in a plane. Two poses of
a plane look alike from far away: tilted towards the camera, and tilted away from it by the same angle.
Descent from a random start often ends in neither (decision 34), so the fit starts from both.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Self

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import AXES, LANDMARKS
from hand_recon.schema import HandParameters

PALM_LANDMARKS: Final = tuple(
    LANDMARKS.index(name)
    for name in ("wrist", "thumb CMC", "index MCP", "middle MCP", "ring MCP", "little MCP")
)
"""Landmarks of the palm, which hardly move against each other."""

ELSEWHERE: Final = 0.02
"""Weight of the landmarks outside the palm, whose own weight is 1; they decide where the palm is hidden."""

BENDS: Final = (0.3, 0.9)
"""Bend of all joints in the starts, radians: an open hand, then a half-closed hand."""

SHALLOWEST: Final = 0.05
"""Least depth of a hand, metres."""


@dataclass(frozen=True)
class Start:
    """Hand parameters that a fit starts from."""

    joint_angles: Float[Tensor, "*batch joint=15 axis=3"]
    """Bend, splay and twist, radians."""
    root_rotation: Float[Tensor, "*batch 3 3"]
    """Rotation from the hand's frame to the camera's."""
    translation: Float[Tensor, "*batch 3"]
    """Position of the hand's origin in the camera's frame, metres."""
    shape: Float[Tensor, "*batch direction=10"]
    """Shape coefficients, standard deviations."""

    @classmethod
    def of(cls, found: HandParameters) -> Self:
        """Hands with these parameters.

        Args:
            found: Parameters with any axes in front.
        """
        return cls(found.joint_angles, found.root_rotation, found.translation, found.shape)

    @classmethod
    def one_each(cls, found: HandParameters) -> Self:
        """One start per hand, batch × 1.

        Args:
            found: Parameters of a batch of hands.
        """
        return cls(
            found.joint_angles[:, None],
            found.root_rotation[:, None],
            found.translation[:, None],
            found.shape[:, None],
        )

    @classmethod
    def beside(cls, starts: Sequence[Self]) -> Self:
        """Join starts of the same hands, batch × start each, along their second axis."""
        return cls(
            torch.cat([start.joint_angles for start in starts], dim=1),
            torch.cat([start.root_rotation for start in starts], dim=1),
            torch.cat([start.translation for start in starts], dim=1),
            torch.cat([start.shape for start in starts], dim=1),
        )

    def flat(self) -> Self:
        """Starts of a batch × start along one axis, those of each hand behind each other."""
        return type(self)(
            self.joint_angles.flatten(0, 1),
            self.root_rotation.flatten(0, 1),
            self.translation.flatten(0, 1),
            self.shape.flatten(0, 1),
        )


def closed_form_starts(
    hand: HandModel,
    landmarks_2d: Float[Tensor, "batch landmark=21 2"],
    labelled: Bool[Tensor, "batch landmark=21"],
    intrinsics: Float[Tensor, "batch 3 3"],
    count: int = 4,
) -> Start:
    """Compute starts of hands: both palm poses of an open hand, then both of a half-closed hand.

    Args:
        hand: Hand model.
        landmarks_2d: Landmarks, pixels; ignored where not labelled.
        labelled: Mask of the given landmarks, at least three of each hand.
        intrinsics: Camera matrices, same pixels.
        count: Starts per hand, 1 to 4: the first ones of the four.

    Returns:
        Starts, batch × count.

    Raises:
        ValueError: `count` is not 1, 2, 3 or 4.
    """
    most = 2 * len(BENDS)
    if not 1 <= count <= most:
        raise ValueError(
            f"Expected 1 to {most} starts, found {count}. Set descent.starts to one of them."
        )
    angles, placements = [], []
    for bend in BENDS[: (count + 1) // 2]:
        pose = torch.zeros_like(hand.rest_angles)
        pose[:, AXES.index("bend")] = bend
        points = hand(pose, hand.template.new_zeros(10)).landmarks.to(landmarks_2d)
        placements += _palm_placements(points, landmarks_2d, labelled, intrinsics)
        angles += [pose.to(landmarks_2d)] * 2
    rotation = torch.stack([rotation for rotation, _ in placements[:count]], dim=1)
    translation = torch.stack([translation for _, translation in placements[:count]], dim=1)
    pose = torch.stack(angles[:count]).expand(len(landmarks_2d), -1, -1, -1)
    return Start(pose, rotation, translation, shape=rotation.new_zeros(*rotation.shape[:2], 10))


def _palm_placements(
    points: Float[Tensor, "landmark=21 3"],
    landmarks_2d: Float[Tensor, "batch landmark=21 2"],
    labelled: Bool[Tensor, "batch landmark=21"],
    intrinsics: Float[Tensor, "batch 3 3"],
) -> list[tuple[Tensor, Tensor]]:
    """The two rotations and translations of the palm that fit the landmarks."""
    weights = points.new_full((21,), ELSEWHERE)
    weights[list(PALM_LANDMARKS)] = 1.0
    weights = weights * labelled
    basis, centre = _plane(points[list(PALM_LANDMARKS)])
    on_plane = (points - centre) @ basis[:, :2]
    # Points of the rays at unit depth.
    seen = torch.cat([landmarks_2d, torch.ones_like(landmarks_2d[..., :1])], dim=-1)
    seen = seen.masked_fill(~labelled[..., None], 0.0)
    rays = torch.linalg.solve(intrinsics, seen.mT).mT[..., :2]
    linear, offset = _affine(on_plane, rays, weights)
    rotations = _two_rotations(linear)
    size = torch.linalg.matrix_norm(linear, ord=2).clamp(min=1e-6)
    depth = (1 / size).clamp(min=SHALLOWEST)
    middle = torch.cat([offset, torch.ones_like(depth)[:, None]], dim=-1) * depth[:, None]
    found = []
    for rotation in rotations:
        root_rotation = rotation @ basis.mT
        # The fit gives the position of the palm's centre; subtract its offset from the hand's origin.
        found.append((root_rotation, middle - (root_rotation @ centre)))
    return found


def _plane(points: Float[Tensor, "point 3"]) -> tuple[Tensor, Tensor]:
    """Fit a plane: an orthonormal basis in columns, the first two in the plane, and the points' mean."""
    centre = points.mean(dim=0)
    _, _, rows = torch.linalg.svd(points - centre)
    basis = rows.mT.clone()
    basis[:, 2] = torch.linalg.cross(basis[:, 0], basis[:, 1])
    return basis, centre


def _affine(
    points: Float[Tensor, "landmark 2"],
    rays: Float[Tensor, "batch landmark 2"],
    weights: Float[Tensor, "batch landmark"],
) -> tuple[Float[Tensor, "batch 2 2"], Float[Tensor, "batch 2"]]:
    """Fit an affine map from the plane to the image by weighted least squares."""
    ones = torch.ones_like(points[:, :1])
    design = torch.cat([points, ones], dim=-1)
    weighted = design.mT * weights[:, None]
    # Regularization, because three landmarks in a line leave one direction undetermined.
    damping = torch.diag(points.new_tensor([1e-8, 1e-8, 1e-12]))
    solution = torch.linalg.solve(weighted @ design + damping, weighted @ rays)
    return solution[:, :2].mT, solution[:, 2]


def _two_rotations(linear: Float[Tensor, "batch 2 2"]) -> tuple[Tensor, Tensor]:
    """Solve for the two rotations whose first two columns project orthographically to the map's columns.

    The columns (m₁, a)/s and (m₂, b)/s have unit length and are orthogonal: s is the larger singular value of
    (m₁ m₂), and the depths a and b are determined up to their common sign.
    """
    first, second = linear[..., 0], linear[..., 1]
    size = torch.linalg.matrix_norm(linear, ord=2).clamp(min=1e-6)
    first, second = first / size[:, None], second / size[:, None]
    a = (1 - first.square().sum(dim=-1)).clamp(min=0).sqrt()
    b = (1 - second.square().sum(dim=-1)).clamp(min=0).sqrt()
    b = torch.where((first * second).sum(dim=-1) > 0, -b, b)
    found = []
    for sign in (1.0, -1.0):
        x = torch.cat([first, sign * a[:, None]], dim=-1)
        y = torch.cat([second, sign * b[:, None]], dim=-1)
        x = torch.nn.functional.normalize(x, dim=-1)
        y = torch.nn.functional.normalize(y - (x * y).sum(dim=-1, keepdim=True) * x, dim=-1)
        found.append(torch.stack([x, y, torch.linalg.cross(x, y)], dim=-1))
    return found[0], found[1]
