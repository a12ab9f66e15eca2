"""Landmark sets that differ from another set by an offset of each landmark, fixed to one of the hand's bones.

Detectors and annotators put a landmark where they see it: on the skin of a knuckle, at a crease, in the
middle of the wrist. The rotation centres of the hand model are elsewhere. A landmark set is a weighted sum
of points of the hand, so an offset is more weights: of a few vertices that move with the bone, adding up to
zero.
"""

from typing import Final

import torch
from jaxtyping import Float, Int
from torch import Tensor

from hand_recon.hand.model import HandAsset
from hand_recon.hand.skeleton import FINGERS, JOINTS, LANDMARKS

RIGID: Final = 0.99
"""Least skinning weight of a vertex that moves with one bone."""

VERTICES: Final = 6
"""Vertices whose weights make an offset."""


def carrying_joints() -> tuple[int, ...]:
    """Joint whose bone carries each landmark: the bone on the wrist's side of it.

    Wrist, thumb CMC and the fingers' MCPs are fixed to the wrist's segment, a PIP to the proximal phalanx.
    """
    carriers = []
    for landmark in LANDMARKS:
        finger = landmark.split()[0]
        if finger not in FINGERS:
            carriers.append(0)
            continue
        chain = [name for name in LANDMARKS if name.startswith(finger)]
        before = chain[: chain.index(landmark)]
        carriers.append(JOINTS.index(before[-1]) if before else 0)
    return tuple(carriers)


def with_offsets(
    asset: HandAsset,
    regressor: Float[Tensor, "landmark=21 point"],
    offsets: Float[Tensor, "landmark=21 3"],
) -> Float[Tensor, "landmark=21 point"]:
    """Move landmarks by offsets that are fixed to the bones.

    Args:
        asset: The hand.
        regressor: Weights of a landmark set over the vertices and rotation centres.
        offsets: Offset of each landmark at the mean shape, metres, in the axes of its bone's joint (twist,
            splay, bend; for the wrist's segment the hand's own axes).

    Returns:
        Weights of the moved landmarks.
    """
    moved = regressor.clone()
    for landmark, joint in enumerate(carrying_joints()):
        axes = torch.eye(3) if joint == 0 else asset.frames[joint - 1]
        chosen = _spread(asset, joint)
        points = asset.template[chosen].double()
        # The smallest weights that add up to zero and move the landmark by the offset.
        rows = torch.cat([points.mT, torch.ones(1, len(chosen), dtype=torch.float64)])
        wanted = torch.cat([axes.double() @ offsets[landmark].double(), torch.zeros(1).double()])
        moved[landmark, chosen] += (torch.linalg.pinv(rows) @ wanted).to(moved)
    return moved


def _spread(asset: HandAsset, joint: int) -> Int[Tensor, " vertex"]:
    """Vertices of a bone far from each other, the same ones on every run."""
    weights = asset.skinning_weights[:, joint]
    rigid = (weights >= min(RIGID, float(weights.sort().values[-VERTICES]))).nonzero()[:, 0]
    points = asset.template[rigid].double()
    chosen = [int((points - points.mean(dim=0)).norm(dim=1).argmax())]
    while len(chosen) < VERTICES:
        away = torch.cdist(points, points[chosen]).amin(dim=1)
        chosen.append(int(away.argmax()))
    return rigid[chosen]
