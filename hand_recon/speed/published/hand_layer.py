"""The hand layer of the literature: blend shapes, a chain of matrices, one per vertex (MANO, SMPL)."""

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import PARENTS, ROOT_JOINT


class PublishedLayer:
    """SMPL's forward pass (Loper et al., ACM TOG 2015, Eq. 2 to 10) over a hand model's arrays."""

    def __init__(self, hand: HandModel) -> None:
        """Take a hand's arrays.

        Args:
            hand: The hand model.
        """
        self.hand = hand

    def __call__(
        self,
        rotations: Float[Tensor, "hand joint=15 3 3"],
        shape: Float[Tensor, "hand direction=10"],
    ) -> tuple[Float[Tensor, "hand vertex 3"], Float[Tensor, "hand joint=16 3"]]:
        """Vertices and rotation centres in the hand's frame.

        Args:
            rotations: Rotation of each joint from the rest pose, relative to its parent.
            shape: Coefficients of the shape directions, standard deviations.
        """
        hand = self.hand
        vertices = hand.template + torch.einsum("bs,vxs->bvx", shape, hand.shape_directions)
        joints = hand.joints_template + torch.einsum(
            "bs,jxs->bjx", shape, hand.joint_shape_directions
        )
        if hand.pose_directions is not None:
            deviation = (rotations - torch.eye(3).to(rotations)).flatten(1)
            vertices = vertices + torch.einsum("br,vxr->bvx", deviation, hand.pose_directions)
        transforms = [
            self._transform(torch.eye(3).to(joints).expand(len(joints), 3, 3), joints[:, 0])
        ]
        for joint in range(1, len(PARENTS)):
            bone = joints[:, joint] - joints[:, PARENTS[joint]]
            local = self._transform(rotations[:, joint - 1], bone)
            transforms.append(transforms[PARENTS[joint]] @ local)
        world = torch.stack(transforms, dim=1)
        homogeneous = torch.cat([joints, torch.zeros_like(joints[..., :1])], dim=-1)[..., None]
        from_rest = world - torch.nn.functional.pad(world @ homogeneous, [3, 0])
        per_vertex = torch.einsum("vj,bjxy->bvxy", hand.skinning_weights, from_rest)
        ones = torch.ones_like(vertices[..., :1])
        skinned = (per_vertex @ torch.cat([vertices, ones], dim=-1)[..., None])[..., :3, 0]
        origin = joints[:, ROOT_JOINT, None]
        return skinned - origin, world[..., :3, 3] - origin

    @staticmethod
    def _transform(
        rotation: Float[Tensor, "hand 3 3"], translation: Float[Tensor, "hand 3"]
    ) -> Float[Tensor, "hand 4 4"]:
        upper = torch.cat([rotation, translation[..., None]], dim=-1)
        last = torch.tensor([0.0, 0.0, 0.0, 1.0]).to(upper).expand(len(upper), 1, 4)
        return torch.cat([upper, last], dim=1)
