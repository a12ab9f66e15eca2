"""Skinned, animated GLB of the hands of a clip, for viewers, game engines and Blender.

Every hand has a mesh with its shape, a skeleton of 16 joints that fits it, and a skin. One animation moves
all hands: the rotation of every joint and the wrist's translation, with a key at each frame of the hand, in
seconds from the clip's start. Units are metres; the camera is at the origin and looks along −z, y is up.

glTF has no animated visibility. A hand is hidden before its first frame, after its last, and in gaps that
were not bridged, by a scale of zero of its wrist, which reaches all of its joints; the specification (section
"Transformations") names it as the way to animate visibility. Skeletons rest in the pose in which the mesh
was modelled, at the hand's first place.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from hand_recon.formats.glb_document import GlbDocument
from hand_recon.formats.hand_colours import hand_colours
from hand_recon.formats.joint_motion import (
    SINGLE_FRAME,
    Rig,
    check_motions,
    motion_of,
    rig_of,
    to_quaternions,
)
from hand_recon.formats.new_file import write_new
from hand_recon.formats.skin import largest_difference, left_out_of, strongest
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import JOINTS, PARENTS
from hand_recon.motion.trajectory import Trajectory
from hand_recon.rendering.mesh import vertex_normals

logger = logging.getLogger(__name__)


def write_animated_glb(
    path: str | Path,
    trajectories: Sequence[Trajectory],
    hand: HandModel,
    duration: float | None = None,
    extras: Sequence[dict[str, Any]] | None = None,
) -> Path:
    """Write the file of `animated_glb`; folders are made.

    Args:
        path: File to write.
        trajectories: Hands of one clip.
        hand: Model of the right hand.
        duration: Time of the clip's end, seconds.
        extras: Further properties of each hand.

    Raises:
        FileExistsError: The file exists.
        ValueError: As `animated_glb`.
    """
    return write_new(path, animated_glb(trajectories, hand, duration, extras))


def animated_glb(
    trajectories: Sequence[Trajectory],
    hand: HandModel,
    duration: float | None = None,
    extras: Sequence[dict[str, Any]] | None = None,
) -> bytes:
    """Make a GLB file of the motion of hands.

    Left hands are mirrored in the arrays of the file; no node has a negative scale. What glTF cannot
    represent of a hand model (pose blend shapes, more than four influences of a vertex) is left out, and a
    note says by how much vertices differ.

    Args:
        trajectories: Hands of one clip.
        hand: Model of the right hand.
        duration: Time of the clip's end, seconds; by default, and at least, that of the last frame of a hand.
        extras: Further properties of each hand (`extras` of its node, in JSON's types).

    Raises:
        ValueError: There is no hand, a hand has no frame, numbers are not finite, a time is negative, or
            times are too close for single precision.
    """
    check_motions(trajectories)
    clip = _Clip.of(trajectories, duration)
    document, animation = GlbDocument(), _Animation()
    properties = [None] * len(trajectories) if extras is None else extras
    colours = hand_colours(trajectories)
    for trajectory, colour, own in zip(trajectories, colours, properties, strict=True):
        _add_hand(document, animation, _HandOfFile(trajectory, hand, colour, clip, own))
    if left_out := left_out_of(hand):
        logger.info(
            "The animated GLB is without the %s of the hand %r, which glTF cannot hold: vertices differ by "
            "up to %.2f mm.",
            left_out, hand.name, 1000 * largest_difference(trajectories, hand),
        )  # fmt: skip
    document.add(
        "animations",
        {"name": "motion", "channels": animation.channels, "samplers": animation.samplers},
    )
    return document.to_bytes()


@dataclass(frozen=True)
class _Clip:
    """End of a clip, and the time for which a frame is shown, seconds."""

    end: float
    frame_time: float

    @classmethod
    def of(cls, trajectories: Sequence[Trajectory], duration: float | None) -> "_Clip":
        last = max(float(trajectory.times[-1]) for trajectory in trajectories)
        steps = np.concatenate([np.diff(trajectory.times) for trajectory in trajectories])
        return cls(
            max(last, duration or 0.0), float(np.median(steps)) if len(steps) else SINGLE_FRAME
        )


@dataclass(frozen=True)
class _HandOfFile:
    """One hand and what the file says about it."""

    trajectory: Trajectory
    hand: HandModel
    colour: tuple[float, float, float]
    clip: _Clip
    extras: dict[str, Any] | None

    @property
    def name(self) -> str:
        return f"hand_{self.trajectory.hand}_{self.trajectory.side}"


@dataclass(frozen=True)
class _Animation:
    """Channels and samplers of the file's animation."""

    channels: list[dict[str, Any]] = field(default_factory=list)
    samplers: list[dict[str, Any]] = field(default_factory=list)

    def add(self, node: int, path: str, accessors: tuple[int, int], interpolation: str) -> None:
        """Add a channel from the accessors of its times and values."""
        times, values = accessors
        self.channels.append(
            {
                "sampler": len(self.samplers),
                "target": {"node": node, "path": path},
            }
        )
        self.samplers.append({"input": times, "output": values, "interpolation": interpolation})


def _add_hand(document: GlbDocument, animation: _Animation, entry: _HandOfFile) -> None:
    """Add the mesh, skeleton, skin and animation of a hand."""
    rig = rig_of(entry.trajectory, entry.hand)
    motion = motion_of(entry.trajectory, entry.hand)
    quaternions = to_quaternions(motion.rotations).astype(np.float32)
    wrist = motion.wrist.astype(np.float32)
    # Viewers that play no animation show the rest pose where the hand first is.
    first = {"translation": wrist[0].tolist(), "rotation": quaternions[0, 0].tolist()}
    joints = _add_joints(document, entry.name, rig, first)
    inverse = np.tile(np.eye(4), (len(JOINTS), 1, 1))
    inverse[:, :3, 3] = -rig.joints
    skin = document.add(
        "skins",
        {
            "name": entry.name,
            "skeleton": joints[0],
            "joints": joints,
            "inverseBindMatrices": document.accessor(inverse.astype(np.float32)),
        },
    )
    mesh = _add_mesh(document, entry, rig)
    own = {} if entry.extras is None else {"extras": entry.extras}
    node = document.add("nodes", {"name": entry.name, "mesh": mesh, "skin": skin, **own})
    document.add_to_scene(node, joints[0])
    times = document.accessor(_key_times(entry.trajectory), bounds=True)
    animation.add(joints[0], "translation", (times, document.accessor(wrist)), "LINEAR")
    for joint, node in enumerate(joints):
        values = document.accessor(quaternions[:, joint])
        animation.add(node, "rotation", (times, values), "LINEAR")
    _hide(document, animation, entry, joints[0])


def _add_joints(
    document: GlbDocument, name: str, rig: Rig, place: dict[str, list[float]]
) -> list[int]:
    """Add the nodes of a skeleton at rest, the wrist first and at the given place."""
    first = document.count("nodes")
    for joint, title in enumerate(JOINTS):
        node: dict[str, Any] = {"name": f"{name}_{title.replace(' ', '_')}"}
        children = [first + child for child, parent in enumerate(PARENTS) if parent == joint]
        if children:
            node["children"] = children
        bone = rig.joints[joint] - rig.joints[PARENTS[joint]]
        node |= {"translation": bone.astype(np.float32).tolist()} if joint else place
        document.add("nodes", node)
    return list(range(first, first + len(JOINTS)))


def _add_mesh(document: GlbDocument, entry: _HandOfFile, rig: Rig) -> int:
    """Add the surface at rest with its skin and material."""
    influences, weights = strongest(rig.weights)
    faces = rig.faces.ravel()
    narrow = np.uint16 if len(rig.vertices) < np.iinfo(np.uint16).max else np.uint32
    linear = [_to_linear(value / 255) for value in entry.colour]
    material = document.add(
        "materials",
        {
            "name": entry.name,
            "pbrMetallicRoughness": {
                "baseColorFactor": [*linear, 1.0],
                "metallicFactor": 0.0,
                "roughnessFactor": 0.7,
            },
            # The inside is visible through the open wrist.
            "doubleSided": True,
        },
    )
    normals = vertex_normals(rig.vertices, rig.faces).astype(np.float32)
    attributes = {
        "POSITION": document.accessor(
            rig.vertices.astype(np.float32), target="vertices", bounds=True
        ),
        "NORMAL": document.accessor(normals, target="vertices"),
        "JOINTS_0": document.accessor(influences, target="vertices"),
        "WEIGHTS_0": document.accessor(weights, target="vertices"),
    }
    primitive = {
        "attributes": attributes,
        "indices": document.accessor(faces.astype(narrow), target="triangles"),
        "material": material,
    }
    return document.add("meshes", {"name": entry.name, "primitives": [primitive]})


def _hide(document: GlbDocument, animation: _Animation, entry: _HandOfFile, wrist: int) -> None:
    """Hide a hand while it is not in the clip, also in gaps between its frames, by a scale of zero."""
    times = _key_times(entry.trajectory)
    end = np.float32(entry.clip.end)
    keys = [(times[0], 1.0)]
    if times[0] > 0:
        keys.insert(0, (np.float32(0), 0.0))
    for place in np.flatnonzero(np.diff(entry.trajectory.frames) > 1):
        gone = np.float32(times[place] + entry.clip.frame_time)
        if gone < times[place + 1]:
            keys += [(gone, 0.0), (times[place + 1], 1.0)]
    if times[-1] < end:
        keys.append((min(np.float32(times[-1] + entry.clip.frame_time), end), 0.0))
    if len(keys) == 1:
        return
    instants = np.array([instant for instant, _ in keys], dtype=np.float32)
    scales = np.array([[scale] * 3 for _, scale in keys], dtype=np.float32)
    accessors = document.accessor(instants, bounds=True), document.accessor(scales)
    animation.add(wrist, "scale", accessors, "STEP")


def _key_times(trajectory: Trajectory) -> Float[np.ndarray, " frame"]:
    times = trajectory.times.astype(np.float32)
    if (np.diff(times) <= 0).any():
        raise ValueError(
            f"Times of hand {trajectory.hand} are equal in single precision, which glTF's keys have; "
            "expected seconds from the clip's start. Subtract the time of the clip's first frame from all of "
            "them."
        )
    return times


def _to_linear(value: float) -> float:
    """Light of a component of an sRGB colour, 0 to 1 (IEC 61966-2-1): glTF's colours are linear."""
    return value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4
