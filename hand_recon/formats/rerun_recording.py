"""Hands as a recording for the Rerun viewer (.rrd); needs the extra `rerun`.

Entities, in the camera's frame (x right, y down, z forward), metres:

    hands/<hand>/mesh        surface
    hands/<hand>/landmarks   the 21 landmarks, with the lines between them
    hands/<hand>/covariance  an ellipsoid of one standard deviation at each landmark with an estimate

Timelines are `frame` (number) and `time` (seconds). A hand is cleared where it is not in the clip.
"""

from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from hand_recon.formats.exported_hands import ExportedHand, Scene
from hand_recon.formats.hand_colours import hand_colours
from hand_recon.formats.joint_motion import check_motions
from hand_recon.formats.mesh_sequence import vertices_at
from hand_recon.formats.new_file import free_place
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import LANDMARK_PARENTS, LANDMARKS
from hand_recon.rendering.mesh import vertex_normals
from hand_recon.rendering.mesh_files import outward

ROOT: Final = "hands"
"""Entity above all hands."""

_POINT: Final = 0.002
"""Radius of a landmark's point, metres."""


def write_rerun(path: str | Path, scene: Scene, hand: HandModel) -> Path:
    """Write the hands of a scene; folders are made.

    Args:
        path: File to write.
        scene: The hands.
        hand: Model of the right hand.

    Raises:
        FileExistsError: The file exists.
        ValueError: There is no hand, a hand has no frame, numbers are not finite, or a time is negative.
    """
    import rerun

    check_motions(scene.trajectories)
    path = free_place(path)
    recording = rerun.RecordingStream("hand_recon")
    recording.save(path)
    recording.log(ROOT, rerun.ViewCoordinates.RIGHT_HAND_Y_DOWN, static=True)
    recording.log(ROOT, rerun.AnnotationContext([_skeleton()]), static=True)
    faces = hand.faces.cpu().numpy()
    for frame, time in scene.frames.items():
        recording.set_time("frame", sequence=frame)
        recording.set_time("time", duration=time)
        for one, colour in zip(scene.hands, hand_colours(scene.trajectories), strict=True):
            if frame in one.trajectory.frames:
                vertices = vertices_at(one.trajectory, frame, hand)
                _log_mesh(recording, one, vertices, outward(vertices, faces), colour)
                _log_landmarks(recording, one, frame, colour)
            else:
                recording.log(f"{ROOT}/{one.name}", rerun.Clear(recursive=True))
    recording.flush()
    recording.disconnect()
    return path


def _skeleton() -> Any:  # noqa: ANN401  # rerun is imported late
    """Names of the landmarks, and the lines between them."""
    import rerun

    return rerun.ClassDescription(
        info=rerun.AnnotationInfo(id=0, label="hand"),
        keypoint_annotations=[
            rerun.AnnotationInfo(id=number, label=name) for number, name in enumerate(LANDMARKS)
        ],
        keypoint_connections=[
            (parent, number) for number, parent in enumerate(LANDMARK_PARENTS) if parent >= 0
        ],
    )


def _log_mesh(
    recording: Any,  # noqa: ANN401
    one: ExportedHand,
    vertices: Float[np.ndarray, "vertex 3"],
    faces: np.ndarray,
    colour: tuple[float, float, float],
) -> None:
    import rerun

    mesh = rerun.Mesh3D(
        vertex_positions=vertices.astype(np.float32),
        triangle_indices=faces.astype(np.uint32),
        vertex_normals=vertex_normals(vertices, faces).astype(np.float32),
        albedo_factor=[*(round(value) for value in colour), 255],
    )
    recording.log(f"{ROOT}/{one.name}/mesh", mesh)


def _log_landmarks(
    recording: Any,  # noqa: ANN401
    one: ExportedHand,
    frame: int,
    colour: tuple[float, float, float],
) -> None:
    """Log the landmarks, and their covariance where there is an estimate."""
    import rerun

    (row,) = np.flatnonzero(one.trajectory.frames == frame)
    points = one.landmarks[row].astype(np.float32)
    shade = [round(0.7 * value) for value in colour]
    recording.log(
        f"{ROOT}/{one.name}/landmarks",
        rerun.Points3D(
            points, radii=_POINT, colors=shade, class_ids=0, keypoint_ids=range(len(points))
        ),
    )
    if np.isfinite(one.covariance[row]).all():
        half_sizes, quaternions = ellipsoids(one.covariance[row])
        shape = rerun.Ellipsoids3D(
            centers=points, half_sizes=half_sizes, quaternions=quaternions, colors=shade
        )
        recording.log(f"{ROOT}/{one.name}/covariance", shape)


def ellipsoids(
    covariance: Float[np.ndarray, "point 3 3"],
) -> tuple[Float[np.ndarray, "point 3"], Float[np.ndarray, "point quaternion=4"]]:
    """Half axes of the ellipsoids of one standard deviation, and the rotations (x, y, z, w) of their axes.

    Args:
        covariance: Covariances.
    """
    variances, axes = np.linalg.eigh(covariance)
    # Axes have either sign; of three, one is chosen so that they are right-handed.
    axes[..., 0] *= np.sign(np.linalg.det(axes))[:, None]
    return np.sqrt(np.maximum(variances, 0.0)), Rotation.from_matrix(axes).as_quat()
