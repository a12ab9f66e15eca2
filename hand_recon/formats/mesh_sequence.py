"""Meshes of each frame as OBJ or PLY files, in the camera's frame (x right, y down, z forward), metres."""

from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float

from hand_recon.formats.exported_hands import Scene
from hand_recon.formats.hand_colours import hand_colours
from hand_recon.formats.joint_motion import check_motions
from hand_recon.formats.new_file import refuse_existing
from hand_recon.hand.model import HandModel
from hand_recon.motion.posing import right_hands
from hand_recon.motion.trajectory import Trajectory, mirror_of
from hand_recon.rendering.mesh_files import NamedMesh, write_meshes


def write_mesh_sequence(folder: Path, scene: Scene, hand: HandModel, suffix: str) -> list[Path]:
    """Write a mesh file for each frame that has a hand, numbered as the frames, or one of a single moment.

    Args:
        folder: Folder to write to.
        scene: The hands.
        hand: Model of the right hand.
        suffix: `.obj` or `.ply`.

    Raises:
        FileExistsError: A file exists.
        ValueError: There is no hand, a hand has no frame, numbers are not finite, or a time is negative.
    """
    check_motions(scene.trajectories)
    stem = folder / scene.name
    paths = {
        frame: stem.with_name(f"{scene.name}{suffix}")
        if scene.is_still
        else folder / f"{scene.name}_{suffix[1:]}" / f"{frame:06d}{suffix}"
        for frame in scene.frames
    }
    refuse_existing(paths.values())
    colours = hand_colours(scene.trajectories)
    for frame, path in paths.items():
        meshes = [
            NamedMesh(
                one.name, vertices_at(one.trajectory, frame, hand), hand.faces.numpy(), colour
            )
            for one, colour in zip(scene.hands, colours, strict=True)
            if frame in one.trajectory.frames
        ]
        write_meshes(path, meshes)
    return list(paths.values())


@torch.no_grad()
def vertices_at(motion: Trajectory, frame: int, hand: HandModel) -> Float[np.ndarray, "vertex 3"]:
    """Vertices of a hand in a frame, camera frame, metres; left hands are left hands.

    Args:
        motion: Its motion.
        frame: Number of a frame in which it is.
        hand: Model of the right hand.
    """
    posed = hand.to_camera(right_hands(motion, np.flatnonzero(motion.frames == frame)))
    return np.asarray(posed.vertices[0].double().numpy() * mirror_of(motion.side))
