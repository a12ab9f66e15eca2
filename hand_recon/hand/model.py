"""The hand model: shape and joint angles → vertices, rotation centres and landmarks (Sec. 3.1)."""

import copy
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from hand_recon.hand.anatomical_frame import joint_rotations
from hand_recon.hand.skeleton import JOINT_LEVELS, PARENTS, ROOT_JOINT
from hand_recon.schema import HandGeometry, HandParameters


@dataclass(frozen=True)
class HandAsset:
    """Everything that tells one hand from another: the contents of a hand file.

    All points are in the hand's frame at rest: fingers point −x, the palm faces −y, the thumb is at +z.
    """

    name: str
    """Which hand this is, for checkpoints and messages."""
    template: Float[Tensor, "vertex 3"]
    """Mean surface at rest, metres."""
    shape_directions: Float[Tensor, "vertex 3 direction=10"]
    """Displacement of the surface per standard deviation, metres."""
    joints: Float[Tensor, "joint=16 3"]
    """Mean rotation centres at rest, metres."""
    joint_shape_directions: Float[Tensor, "joint=16 3 direction=10"]
    """Displacement of the rotation centres per standard deviation, metres."""
    skinning_weights: Float[Tensor, "vertex joint=16"]
    """How much each joint carries each vertex; rows sum to one."""
    faces: Int[Tensor, "face 3"]
    """Triangles, counter-clockwise from outside, open at the wrist."""
    wrist_ring: Int[Tensor, " ring"]
    """Vertices of the open boundary in the order in which a cap's triangles traverse it."""
    frames: Float[Tensor, "joint=15 3 3"]
    """Anatomical axes of each child segment at rest, one per column: twist, splay, bend."""
    rest_angles: Float[Tensor, "joint=15 axis=3"]
    """Joint angles of the rest pose from the anatomical neutral, radians."""
    landmark_regressors: dict[str, Float[Tensor, "landmark=21 point"]]
    """Weights over the vertices followed by the rotation centres, by name of the landmark set."""
    pose_directions: Float[Tensor, "vertex 3 rotation=135"] | None = None
    """MANO's pose blend shapes over the entries of R − I; absent for hands without."""


class HandModel(nn.Module):
    """A posed hand from joint angles and shape, for any batch shape and precision.

    Linear blend skinning in three batched steps, one per level of the skeleton.
    """

    template: Tensor
    shape_directions: Tensor
    joints_template: Tensor
    joint_shape_directions: Tensor
    skinning_weights: Tensor
    faces: Tensor
    wrist_ring: Tensor
    frames: Tensor
    rest_angles: Tensor
    landmark_regressor: Tensor
    pose_directions: Tensor | None

    def __init__(self, asset: HandAsset, landmarks: str = "knuckle") -> None:
        """Build the model.

        Args:
            asset: The hand.
            landmarks: Which of the asset's landmark sets `forward` returns.

        Raises:
            ValueError: The asset has no such landmark set.
        """
        super().__init__()
        if landmarks not in asset.landmark_regressors:
            raise ValueError(
                f"The hand {asset.name!r} has no landmark set {landmarks!r}; "
                f"it has {sorted(asset.landmark_regressors)}. Choose one of these: data.landmarks=<set>."
            )
        self.name = asset.name
        self.landmarks = landmarks
        for name in ("template", "shape_directions", "joint_shape_directions", "skinning_weights",
                     "faces", "wrist_ring", "frames", "rest_angles", "pose_directions"):  # fmt: skip
            self.register_buffer(name, getattr(asset, name), persistent=False)
        self.register_buffer("joints_template", asset.joints, persistent=False)
        self.register_buffer(
            "landmark_regressor", asset.landmark_regressors[landmarks], persistent=False
        )

    def rest(
        self, shape: Float[Tensor, "*batch direction=10"]
    ) -> tuple[Float[Tensor, "*batch vertex 3"], Float[Tensor, "*batch joint=16 3"]]:
        """Surface and rotation centres at rest, with the middle finger's MCP centre at the origin."""
        vertices = self.template + torch.einsum("vxs,...s->...vx", self.shape_directions, shape)
        joints = self.joints_template + torch.einsum(
            "jxs,...s->...jx", self.joint_shape_directions, shape
        )
        origin = joints[..., ROOT_JOINT, None, :]
        return vertices - origin, joints - origin

    def forward(
        self,
        joint_angles: Float[Tensor, "*batch joint=15 axis=3"],
        shape: Float[Tensor, "*batch direction=10"],
    ) -> HandGeometry:
        """Pose the hand in its own frame: the palm does not move, the fingers do.

        Args:
            joint_angles: Bend, splay and twist from the anatomical neutral, radians.
            shape: Coefficients of the shape directions, standard deviations.
        """
        return self.pose(joint_rotations(joint_angles, self.frames, self.rest_angles), shape)

    def pose(
        self,
        rotations: Float[Tensor, "*batch joint=15 3 3"],
        shape: Float[Tensor, "*batch direction=10"],
    ) -> HandGeometry:
        """Pose the hand in its own frame by rotation matrices, as MANO's own parameters give them.

        Args:
            rotations: Of each joint from the rest pose, relative to its parent, in the hand's own axes.
            shape: Coefficients of the shape directions, standard deviations.
        """
        vertices, joints = self.rest(shape)
        if self.pose_directions is not None:
            deviation = rotations - torch.eye(3, dtype=rotations.dtype, device=rotations.device)
            vertices = vertices + torch.einsum(
                "vxr,...r->...vx", self.pose_directions, deviation.flatten(-3)
            )
        turns, centres = _forward_kinematics(rotations, joints)
        shifts = centres - (turns @ joints[..., None])[..., 0]
        vertices = self._skin(vertices, turns, shifts)
        return HandGeometry(vertices, centres, self.landmarks_of(vertices, centres))

    def _skin(
        self,
        vertices: Float[Tensor, "*batch vertex 3"],
        turns: Float[Tensor, "*batch joint=16 3 3"],
        shifts: Float[Tensor, "*batch joint=16 3"],
    ) -> Float[Tensor, "*batch vertex 3"]:
        """Linear blend skinning: every vertex moved by its own mixture of the joints' rigid motions."""
        motions = torch.cat([turns, shifts[..., None]], dim=-1)
        # With the vertices last, a matrix times a vector at every vertex is three sums of long rows: half
        # the time of as many products of small matrices.
        blended = torch.einsum("vj,...jxy->...xyv", self.skinning_weights, motions)
        turned = (blended[..., :3, :] * vertices.mT[..., None, :, :]).sum(dim=-2)
        return (turned + blended[..., 3, :]).mT

    def landmarks_of(
        self,
        vertices: Float[Tensor, "*batch vertex 3"],
        joints: Float[Tensor, "*batch joint=16 3"],
    ) -> Float[Tensor, "*batch landmark=21 3"]:
        """The landmark set on any posed hand: a linear map of its points, the paper's H."""
        # The points last, as `_skin` leaves them: one product for all hands, not one for each.
        return (torch.cat([vertices.mT, joints.mT], dim=-1) @ self.landmark_regressor.mT).mT

    def to_camera(self, parameters: HandParameters) -> HandGeometry:
        """Pose the hand and put it into the camera's frame (the R and t of Sec. 3.1)."""
        hand = self(parameters.joint_angles, parameters.shape)
        return moved(hand, parameters.root_rotation, parameters.translation)

    def of_landmarks(self) -> "HandModel":
        """The same hand with those vertices alone that its landmarks need: for fits, which is faster.

        It has no faces.
        """
        count = len(self.template)
        needed = self.landmark_regressor[:, :count].any(dim=0)
        light = copy.deepcopy(self)
        for name in ("template", "shape_directions", "skinning_weights", "pose_directions"):
            whole = getattr(self, name)
            setattr(light, name, None if whole is None else whole[needed])
        of_joints = self.landmark_regressor[:, count:]
        light.landmark_regressor = torch.cat(
            [self.landmark_regressor[:, :count][:, needed], of_joints], dim=1
        )
        light.faces, light.wrist_ring = self.faces[:0], self.wrist_ring[:0]
        return light

    def neutral_angles(self) -> Float[Tensor, "joint=15 axis=3"]:
        """The joint angles of the anatomical neutral: all zero."""
        return torch.zeros_like(self.rest_angles)


def moved(
    hand: HandGeometry,
    rotation: Float[Tensor, "*batch 3 3"],
    translation: Float[Tensor, "*batch 3"],
) -> HandGeometry:
    """A hand turned about its origin, then shifted.

    Args:
        hand: Metres.
        rotation: From the hand's frame to the new one.
        translation: Where the origin comes to be, metres.
    """

    def placed(points: Float[Tensor, "*batch point 3"]) -> Float[Tensor, "*batch point 3"]:
        return (rotation @ points.mT + translation[..., None]).mT

    return HandGeometry(placed(hand.vertices), placed(hand.joints), placed(hand.landmarks))


def _forward_kinematics(
    rotations: Float[Tensor, "*batch joint=15 3 3"], joints: Float[Tensor, "*batch joint=16 3"]
) -> tuple[Float[Tensor, "*batch joint=16 3 3"], Float[Tensor, "*batch joint=16 3"]]:
    """Orientation and centre of every joint, from each joint's rotation and the centres at rest."""
    *batch, _, _ = joints.shape
    eye = torch.eye(3, dtype=joints.dtype, device=joints.device)
    turns = {0: eye.expand(*batch, 3, 3)}
    centres = {0: joints[..., 0, :]}
    for level in JOINT_LEVELS:
        parents = [PARENTS[joint] for joint in level]
        parent_turns = torch.stack([turns[parent] for parent in parents], dim=-3)
        parent_centres = torch.stack([centres[parent] for parent in parents], dim=-2)
        bones = joints[..., list(level), :] - joints[..., parents, :]
        level_turns = parent_turns @ rotations[..., [joint - 1 for joint in level], :, :]
        level_centres = parent_centres + (parent_turns @ bones[..., None])[..., 0]
        for position, joint in enumerate(level):
            turns[joint] = level_turns[..., position, :, :]
            centres[joint] = level_centres[..., position, :]
    order = range(len(PARENTS))
    return (
        torch.stack([turns[joint] for joint in order], dim=-3),
        torch.stack([centres[joint] for joint in order], dim=-2),
    )
