"""The ground truth of HO3D's evaluation frames, which is public since November 2024.

`evaluation_xyz.json` and `evaluation_verts.json` have one entry per line of `evaluation.txt`: HO3D's order,
OpenGL's axes, metres (shreyashampali/ho3d, README and eval.py).
"""

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from hand_recon.data.ho3d.annotations import OPENGL, TO_FREIHAND, Annotations
from hand_recon.data.ho3d.files import Ho3dPart
from hand_recon.data.json_arrays import load_json_array

logger = logging.getLogger(__name__)

LANDMARKS_FILE: Final = "evaluation_xyz.json"
VERTICES_FILE: Final = "evaluation_verts.json"

HOW_TO_GET: Final = (
    f"{LANDMARKS_FILE} and {VERTICES_FILE} are a download of their own (its link is in the README of "
    "github.com/shreyashampali/ho3d): put them into data.root, or name their folder as data.eval_root"
)

FAR: Final = 0.02
"""Largest median distance of the wrists from those of the metas, metres; more means other frames."""


@dataclass(frozen=True)
class EvaluationGroundTruth:
    """Ground truth of the evaluation frames, in the order of their list."""

    landmarks: Float[np.ndarray, "frame landmark=21 3"]
    """FreiHAND's order, camera frame, metres."""
    raw_vertices: Float[np.ndarray, "frame vertex 3"] | None
    """Vertices as in the file, OpenGL's axes, metres; memory-mapped."""

    def surface(self, row: int) -> Float[np.ndarray, "vertex 3"] | None:
        """Vertices of a frame, camera frame, metres."""
        return None if self.raw_vertices is None else self.raw_vertices[row] * OPENGL


def find_ground_truth(root: Path, eval_root: Path | str | None) -> Path | None:
    """Folder of the ground truth; None if it is missing.

    Args:
        root: The dataset's folder.
        eval_root: Folder of the ground truth, if the user named one.
    """
    folders = (root,) if eval_root is None else (Path(eval_root).expanduser(), root)
    return next((folder for folder in folders if (folder / LANDMARKS_FILE).is_file()), None)


def load_ground_truth(
    folder: Path, part: Ho3dPart, annotations: Annotations, cache_dir: Path | None
) -> EvaluationGroundTruth:
    """Read the ground truth and compare it with the frames.

    Args:
        folder: Folder of the files.
        part: The evaluation part.
        annotations: Annotations of the part, which have the wrists.
        cache_dir: Folder of parsed lists; None parses them every time.

    Raises:
        ValueError: The ground truth belongs to other frames.
    """
    landmarks = _load(folder / LANDMARKS_FILE, part, (21, 3), cache_dir)
    vertices = None
    if (folder / VERTICES_FILE).is_file():
        vertices = _load(folder / VERTICES_FILE, part, (None, 3), cache_dir)
    _check_wrists(folder / LANDMARKS_FILE, landmarks, annotations)
    return EvaluationGroundTruth(landmarks[:, TO_FREIHAND] * OPENGL, vertices)


def _load(
    path: Path, part: Ho3dPart, shape: tuple[int | None, int], cache_dir: Path | None
) -> Float[np.ndarray, "frame point 3"]:
    array = load_json_array(path, cache_dir)
    wanted = (len(part), shape[0] or (array.shape[1] if array.ndim > 1 else 0), shape[1])
    if array.shape != wanted:
        raise ValueError(
            f"{path} holds an array of {' × '.join(map(str, array.shape))}, expected "
            f"{' × '.join(map(str, wanted))}: one entry per line of {part.list_file}. Are both of the same "
            "version of HO3D?"
        )
    return array


def _check_wrists(
    path: Path, landmarks: Float[np.ndarray, "frame joint=21 3"], annotations: Annotations
) -> None:
    """Compare the wrists with those of the metas, to detect another order of frames or other axes."""
    known = annotations.annotated
    wrists, ground_truth = annotations.joints[known, 0], landmarks[known, 0]
    distance = _median_distance(wrists, ground_truth)
    if distance <= FAR:
        return
    if _median_distance(wrists, ground_truth * OPENGL) <= FAR:
        raise ValueError(
            f"{path} has OpenCV's axes (z > 0), expected HO3D's own: multiply y and z by −1."
        )
    raise ValueError(
        f"{path} puts the wrists {distance:.3f} m from where the frames' own annotations have them, in the "
        "median: it is the ground truth of other frames, or of this list in another order, or not in metres. "
        f"{HOW_TO_GET}."
    )


def _median_distance(
    first: Float[np.ndarray, "frame 3"], second: Float[np.ndarray, "frame 3"]
) -> float:
    return float(np.median(np.linalg.norm(first - second, axis=-1)))
