"""Known hands before a known camera, with exact landmarks, for the tests of fits, lifters and losses."""

import torch

from hand_recon.camera import default_intrinsics, project
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import AXES
from hand_recon.knowledge.functional_anatomy import FunctionalAnatomy
from hand_recon.knowledge.ranges import RangeOfMotion, load_ranges
from hand_recon.schema import HandBatch, HandParameters


def possible_angles(ranges: RangeOfMotion, count: int) -> torch.Tensor:
    """Joint angles inside the ranges, from fists to open hands, that functional anatomy allows."""
    share = 0.15 + 0.5 * torch.rand(count, 15, 3)
    angles = ranges.lower + share * (ranges.upper - ranges.lower)
    angles[..., AXES.index("splay")] *= 0.2
    # The DIPs and PIPs of one finger bend together.
    curl = torch.rand(count, 5, 1, 1)
    angles.unflatten(1, (5, 3))[..., AXES.index("bend")] *= 0.3 + curl[..., 0]
    return FunctionalAnatomy().refine(ranges, angles).clamp(angles)


def known_hands(hand: HandModel, count: int) -> HandParameters:
    """Hands of random possible pose, shape and rotation, half a metre away."""
    ranges = load_ranges("literature", hand.rest_angles)
    rotation = torch.linalg.qr(torch.randn(count, 3, 3)).Q
    rotation = rotation * torch.linalg.det(rotation).sign()[:, None, None]
    translation = torch.tensor([0.0, 0.0, 0.5]) + 0.02 * torch.randn(count, 3)
    return HandParameters(
        possible_angles(ranges, count), 0.5 * torch.randn(count, 10), rotation, translation
    )


def views(hand: HandModel, parameters: HandParameters, *, focal: float = 500.0) -> HandBatch:
    """Batch of exact landmarks in crops of 224 pixels, with 3D ground truth and without images."""
    count = len(parameters.translation)
    with torch.no_grad():
        posed = hand.to_camera(parameters)
    intrinsics = default_intrinsics(224, posed.landmarks)
    intrinsics[0, 0] = intrinsics[1, 1] = focal
    intrinsics = intrinsics.expand(count, 3, 3)
    return HandBatch(
        image=torch.empty(count, 3, 0, 0, dtype=torch.uint8),
        landmarks_2d=project(posed.landmarks, intrinsics),
        labelled=torch.ones(count, 21, dtype=torch.bool),
        index=torch.arange(count),
        source=tuple(f"hand {number}" for number in range(count)),
        intrinsics=intrinsics,
        landmarks_3d=posed.landmarks,
        vertices=posed.vertices,
    )
