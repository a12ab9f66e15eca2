"""MANO by the formulas of its paper, one vertex and one joint at a time, from the pickle's arrays."""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation


def posed_by_definition(
    mano: dict[str, np.ndarray],
    global_rotation: Float[np.ndarray, " 3"],
    pose: Float[np.ndarray, " 45"],
    shape: Float[np.ndarray, " 10"],
    translation: Float[np.ndarray, " 3"],
) -> tuple[Float[np.ndarray, "vertex 3"], Float[np.ndarray, "joint 3"]]:
    """Vertices and rotation centres: T(β, θ) = T̄ + B_S(β) + B_P(θ), skinned about J(β), plus t."""
    rotations = [
        Rotation.from_rotvec(rotation).as_matrix()
        for rotation in np.concatenate([global_rotation, pose]).reshape(16, 3)
    ]
    shaped = mano["v_template"] + sum(
        shape[k] * mano["shapedirs"][:, :, k] for k in range(len(shape))
    )
    joints = mano["J_regressor"] @ shaped
    surface = shaped.copy()
    entry = 0
    for rotation in rotations[1:]:
        for row in range(3):
            for column in range(3):
                amount = rotation[row, column] - (row == column)
                surface += amount * mano["posedirs"][:, :, entry]
                entry += 1
    world: list[np.ndarray] = []
    for joint, rotation in enumerate(rotations):
        about = np.eye(4)
        about[:3, :3] = rotation
        about[:3, 3] = joints[joint] - rotation @ joints[joint]
        parent = int(mano["kintree_table"][0, joint]) if joint else None
        world.append(about if parent is None else world[parent] @ about)
    posed = [
        sum(weight * matrix for weight, matrix in zip(weights, world, strict=True))
        @ np.append(vertex, 1)
        for vertex, weights in zip(surface, mano["weights"], strict=True)
    ]
    centres = [matrix @ np.append(joint, 1) for matrix, joint in zip(world, joints, strict=True)]
    return np.array(posed)[:, :3] + translation, np.array(centres)[:, :3] + translation
