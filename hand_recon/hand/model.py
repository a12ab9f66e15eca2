"""Hand model from shape and joint angles to vertices, rotation centres and landmarks (Sec. 3.1)."""

import copy
from dataclasses import dataclass
from typing import Any, Final

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from hand_recon.hand.anatomical_frame import joint_rotations
from hand_recon.hand.kinematics import forward_kinematics
from hand_recon.hand.skeleton import ROOT_JOINT
from hand_recon.hand.skinning import LinearBlendSkinning
from hand_recon.schema import HandGeometry, HandParameters


@dataclass(frozen=True)
class HandAsset:
    """Arrays that define a hand model: mesh, blend shapes, skinning, anatomical axes and landmarks.

    All points are in the hand's frame at rest: fingers point −x, the palm faces −y, the thumb is at +z.
    """

    name: str
    """Name of the hand, for checkpoints and messages."""
    template: Float[Tensor, "vertex 3"]
    """Mean surface at rest, metres."""
    shape_directions: Float[Tensor, "vertex 3 direction=10"]
    """Displacement of the surface per standard deviation, metres."""
    joints: Float[Tensor, "joint=16 3"]
    """Mean rotation centres at rest, metres."""
    joint_shape_directions: Float[Tensor, "joint=16 3 direction=10"]
    """Displacement of the rotation centres per standard deviation, metres."""
    skinning_weights: Float[Tensor, "vertex joint=16"]
    """Weight of each joint's motion at each vertex; rows sum to one."""
    faces: Int[Tensor, "face 3"]
    """Triangles, counter-clockwise from outside, open at the wrist."""
    wrist_ring: Int[Tensor, " ring"]
    """Vertices of the open boundary, in the order in which the triangles of a cap go round it."""
    frames: Float[Tensor, "joint=15 3 3"]
    """Anatomical axes of each child segment at rest, one per column: twist, splay, bend."""
    rest_angles: Float[Tensor, "joint=15 axis=3"]
    """Joint angles of the rest pose from the anatomical neutral, radians."""
    landmark_regressors: dict[str, Float[Tensor, "landmark=21 point"]]
    """Weights over the vertices followed by the rotation centres, by name of the landmark set."""
    pose_directions: Float[Tensor, "vertex 3 rotation=135"] | None = None
    """MANO's pose blend shapes over the entries of R − I, metres; None for hands without."""


_ARRANGED: Final = ("template", "shape_directions", "pose_directions", "skinning_weights")
"""Arrays that skinning has in another order."""


class HandModel(nn.Module):
    """Hand model that maps joint angles and shape to a posed hand, for any batch shape and precision.

    It is linear blend skinning; forward kinematics takes one batched step per level of the skeleton.
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

    def __init__(self, asset: HandAsset, landmark_set: str = "knuckle") -> None:
        """Build the model.

        Args:
            asset: The hand.
            landmark_set: Name of the asset's landmark set that `forward` returns.

        Raises:
            ValueError: The asset has no such landmark set.
        """
        super().__init__()
        if landmark_set not in asset.landmark_regressors:
            raise ValueError(
                f"The hand {asset.name!r} has no landmark set {landmark_set!r}; "
                f"it has {sorted(asset.landmark_regressors)}. Choose one of these: landmark_set=<set> in fit "
                "and predict, data.landmark_set=<set> in training and beside data=<dataset>."
            )
        self.name = asset.name
        self.landmark_set = landmark_set
        # True for the copies of `of_shape`.
        self.one_shape = False
        for name in ("template", "shape_directions", "joint_shape_directions", "skinning_weights",
                     "faces", "wrist_ring", "frames", "rest_angles", "pose_directions"):  # fmt: skip
            self.register_buffer(name, getattr(asset, name), persistent=False)
        self.register_buffer("joints_template", asset.joints, persistent=False)
        self.register_buffer(
            "landmark_regressor", asset.landmark_regressors[landmark_set], persistent=False
        )
        self._arrange()

    def _arrange(self) -> None:
        """Rearrange the arrays of the surface for skinning; needed after any of them is replaced."""
        poses = [] if self.pose_directions is None else [self.pose_directions]
        self.skinning = LinearBlendSkinning(
            self.template, [self.shape_directions, *poses], self.skinning_weights
        )

    def with_arrays(self, **arrays: Tensor | None) -> "HandModel":
        """Copy of the model with some of its arrays replaced.

        Args:
            arrays: New values by name, such as `skinning_weights`.
        """
        other = copy.deepcopy(self)
        for name, array in arrays.items():
            other.register_buffer(name, array, persistent=False)
        other._arrange()
        return other

    def __setattr__(self, name: str, value: Any) -> None:  # noqa: ANN401  # any attribute
        """Set an attribute, but none of the arrays that skinning has in another order.

        Raises:
            AttributeError: It is one of these arrays.
        """
        if name in _ARRANGED and "skinning" in self._modules:
            raise AttributeError(
                f"{name} of a hand model cannot be set alone, since skinning has it in another order. Use "
                f"hand.with_arrays({name}=...), which gives a copy."
            )
        super().__setattr__(name, value)

    def rest(
        self, shape: Float[Tensor, "*batch direction=10"]
    ) -> tuple[Float[Tensor, "*batch vertex 3"], Float[Tensor, "*batch joint=16 3"]]:
        """Vertices and rotation centres at rest, with the middle finger's MCP centre at the origin."""
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
        """Pose the hand in its own frame, in which the palm is fixed.

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
        """Pose the hand in its own frame from rotation matrices, as MANO's parameters define them.

        Args:
            rotations: Rotation of each joint from the rest pose, relative to its parent, in the hand's axes.
            shape: Coefficients of the shape directions, standard deviations.
        """
        batch = shape.shape[:-1]
        shape, rotations = shape.reshape(-1, shape.shape[-1]), rotations.reshape(-1, 15, 3, 3)
        directions = self.joint_shape_directions.flatten(0, 1).mT
        joints = torch.addmm(self.joints_template.flatten(), shape, directions).unflatten(
            1, (-1, 3)
        )
        orientations, centres = forward_kinematics(rotations, joints - joints[:, ROOT_JOINT, None])
        translations = centres - (orientations @ joints[..., None])[..., 0]
        coefficients = shape
        if self.pose_directions is not None:
            deviation = rotations - torch.eye(3, dtype=rotations.dtype, device=rotations.device)
            coefficients = torch.cat([shape, deviation.flatten(1)], dim=1)
        vertices = self.skinning(coefficients, orientations, translations).mT
        landmarks = self.landmarks_of(vertices, centres)
        return HandGeometry(
            *(points.view(*batch, *points.shape[1:]) for points in (vertices, centres, landmarks))
        )

    def landmarks_of(
        self,
        vertices: Float[Tensor, "*batch vertex 3"],
        joints: Float[Tensor, "*batch joint=16 3"],
    ) -> Float[Tensor, "*batch landmark=21 3"]:
        """Landmarks of a posed hand, a linear map of its vertices and joints: the paper's H."""
        # The transposes undo the layout that skinning returns, so that one matrix product serves all hands.
        count = vertices.shape[-2]
        of_vertices = vertices.mT @ self.landmark_regressor[:, :count].mT
        return (of_vertices + joints.mT @ self.landmark_regressor[:, count:].mT).mT

    def to_camera(self, parameters: HandParameters) -> HandGeometry:
        """Pose the hand in the camera's frame, with R and t of Sec. 3.1."""
        hand = self(parameters.joint_angles, parameters.shape)
        return transform(hand, parameters.root_rotation, parameters.translation)

    def landmarks_only(self) -> "HandModel":
        """Copy of the model with only the vertices that its landmarks need, to make fits faster.

        The copy has no faces.
        """
        count = len(self.template)
        needed = self.landmark_regressor[:, :count].any(dim=0)
        wholes = {name: getattr(self, name) for name in _ARRANGED}
        kept = torch.cat([needed, torch.ones_like(needed[:1]).expand(len(self.joints_template))])
        return self.with_arrays(
            **{name: None if whole is None else whole[needed] for name, whole in wholes.items()},
            landmark_regressor=self.landmark_regressor[:, kept],
            faces=self.faces[:0],
            wrist_ring=self.wrist_ring[:0],
        )

    def of_shape(self, shape: Float[Tensor, " direction=10"]) -> "HandModel":
        """Copy of the model that has one shape whatever its coefficients are, such as one person's hand.

        Args:
            shape: Coefficients of the shape directions, standard deviations.
        """
        moved = shape.to(self.template)
        fixed = self.with_arrays(
            template=self.template + self.shape_directions @ moved,
            joints_template=self.joints_template + self.joint_shape_directions @ moved,
            shape_directions=torch.zeros_like(self.shape_directions),
            joint_shape_directions=torch.zeros_like(self.joint_shape_directions),
        )
        fixed.one_shape = True
        return fixed

    def neutral_angles(self) -> Float[Tensor, "joint=15 axis=3"]:
        """Joint angles of the anatomical neutral, all zero."""
        return torch.zeros_like(self.rest_angles)


def transform(
    hand: HandGeometry,
    rotation: Float[Tensor, "*batch 3 3"],
    translation: Float[Tensor, "*batch 3"],
) -> HandGeometry:
    """Transform a hand to another frame: x' = R x + t for all of its points.

    Args:
        hand: Points, metres.
        rotation: Rotation from the hand's frame to the new one.
        translation: Origin of the hand's frame in the new one, metres.
    """

    def transformed(points: Float[Tensor, "*batch point 3"]) -> Float[Tensor, "*batch point 3"]:
        return (rotation @ points.mT + translation[..., None]).mT

    return HandGeometry(
        transformed(hand.vertices), transformed(hand.joints), transformed(hand.landmarks)
    )
