"""Synthetic hands in HO3D's file layout, to test its loader and training without the dataset.

Folders, file names, keys, shapes, axes (OpenGL's) and the order of joints are those of HO3D v2 and v3
(Hampali et al., CVPR 2020 and 2022; shreyashampali/ho3d). The hand is the open hand, so entries for MANO's
parameters are None. There are no depth images, no calibration and no object.
"""

import json
import pickle
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import cv2
import numpy as np
import torch
from jaxtyping import Float, UInt8

from hand_recon.camera import project_array
from hand_recon.data.synthetic.levels import DIFFICULTIES, Level
from hand_recon.data.synthetic.recipe import Recipe
from hand_recon.data.synthetic.scene import SyntheticHand, synthetic_hand
from hand_recon.hand.open_hand import open_hand
from hand_recon.hand.skeleton import landmark_permutation
from hand_recon.schema import HandParameters

OPENGL: Final = np.array([1.0, -1.0, -1.0], dtype=np.float32)
"""Signs that convert points between this project's camera axes and HO3D's."""

HO3D_LIKE: Final[Level] = replace(
    DIFFICULTIES["medium"], name="ho3d", cone=180.0, roll=180.0, fill=(0.4, 0.6), held_object=0.8,
)  # fmt: skip
"""Level with hands from all sides, most of them holding an object."""

SUFFIXES: Final = {"v3": ".jpg", "v2": ".png"}
"""File name extension of the images of each version."""

OBJECT_KEYS: Final[dict[str, tuple[int, ...]]] = {
    "objTrans": (3,), "objRot": (3, 1), "objCorners3D": (8, 3), "objCorners3DRest": (8, 3),
}  # fmt: skip
CONTACT_KEYS: Final[dict[str, tuple[int, ...]]] = {
    "handVertContact": (778,), "handVertDist": (778,), "handVertIntersec": (778,),
    "handVertObjSurfProj": (778, 3),
}  # fmt: skip
"""Shapes of entries that are written as zeros; the contact entries exist in version 3 only."""


@dataclass(frozen=True)
class Ho3dFolder:
    """Contents of the folder to write."""

    version: str = "v3"
    """Version of the dataset, `v3` or `v2`."""
    sequences: tuple[str, ...] = ("ABF10", "ABF11", "MC1", "ND2", "SM2")
    """Training sequences; names that differ only in the second of two digits are cameras of one recording."""
    frames: int = 4
    """Annotated frames of each training sequence."""
    evaluation_sequences: tuple[str, ...] = ("AP10", "SM1")
    """Evaluation sequences."""
    evaluation_frames: int = 4
    """Annotated frames of each evaluation sequence."""
    unannotated: int = 1
    """Frames of each sequence with an image but no annotation, which are not in the lists."""
    with_ground_truth: bool = True
    """True writes `evaluation_xyz.json`, which HO3D publishes as a separate download."""
    with_vertices: bool = True
    """True writes `evaluation_verts.json` as well."""
    size: tuple[int, int] = field(default=(640, 480))
    """Width and height of the images, pixels."""
    seed: int = 0
    """Seed of the hands."""

    def recipe(self, split: str, sequence: int) -> Recipe:
        """Recipe of a sequence's hands, in square images of the same height.

        Args:
            split: `train` or `test`.
            sequence: Index of the sequence; each has a camera matrix of its own.
        """
        focal, centre = 280.0 + 7.0 * sequence, 110.0 + 2.0 * sequence
        level = replace(
            HO3D_LIKE,
            focal=(focal, focal),
            principal_x=(centre, centre),
            principal_y=(centre, centre),
        )
        return Recipe(split, level, self.size[1], self.seed, "ho3d")


@dataclass(frozen=True)
class _Frame:
    """One image with its annotation."""

    name: str
    image: UInt8[np.ndarray, "height width 3"]
    intrinsics: Float[np.ndarray, "3 3"]
    joints: Float[np.ndarray, "joint=21 3"]
    vertices: Float[np.ndarray, "vertex 3"]
    annotated: bool


def write_ho3d_layout(root: Path, folder: Ho3dFolder) -> None:
    """Write images and annotations.

    Args:
        root: Folder to create, which corresponds to `HO3D_v3` or `HO3D_v2` with the published ground truth
            of the evaluation set.
        folder: Contents to write.

    Raises:
        ValueError: The version is unknown, or there would be no images.
        FileExistsError: The folder already has training images.
    """
    if folder.version not in SUFFIXES:
        raise ValueError(f"Unknown HO3D version {folder.version!r}; choose one of {[*SUFFIXES]}.")
    if folder.frames < 1 or not folder.sequences or folder.size[0] < folder.size[1]:
        raise ValueError(
            f"Nothing to write: {folder.frames} frames of {len(folder.sequences)} sequences at "
            f"{folder.size[0]} × {folder.size[1]} pixels; ask for at least one, not higher than wide."
        )
    if (root / "train").exists():
        raise FileExistsError(f"{root / 'train'} exists already; choose another root.")
    train = [
        _sequence_frames(folder, "train", sequence, folder.frames)
        for sequence in range(len(folder.sequences))
    ]
    _write_part(root, "train", folder, train)
    evaluation = [
        _sequence_frames(folder, "test", sequence, folder.evaluation_frames)
        for sequence in range(len(folder.evaluation_sequences))
    ]
    listed = _write_part(root, "evaluation", folder, evaluation)
    if folder.with_ground_truth:
        _write_json(root / "evaluation_xyz.json", [frame.joints for frame in listed])
        if folder.with_vertices:
            _write_json(root / "evaluation_verts.json", [frame.vertices for frame in listed])


def _sequence_frames(folder: Ho3dFolder, split: str, sequence: int, count: int) -> list[_Frame]:
    """Frames of one sequence, which has one camera."""
    names = folder.sequences if split == "train" else folder.evaluation_sequences
    recipe = folder.recipe(split, sequence)
    total = count + folder.unannotated
    frames = []
    for number in range(total):
        hand = synthetic_hand(recipe, sequence * total + number)
        name = f"{names[sequence]}/{number:04d}"
        frames.append(_frame(name, hand, folder.size[0], annotated=number < count))
    return frames


def _frame(name: str, hand: SyntheticHand, width: int, *, annotated: bool) -> _Frame:
    """Widen a square image to both sides, and convert its annotation to HO3D's axes and joint order."""
    spare = width - hand.image.shape[1]
    left = spare // 3
    image = cv2.copyMakeBorder(hand.image, 0, 0, left, spare - left, cv2.BORDER_REFLECT)
    intrinsics = hand.intrinsics.copy()
    intrinsics[0, 2] += left
    order = list(landmark_permutation("freihand", "ho3d"))
    return _Frame(
        name,
        np.asarray(image, dtype=np.uint8),
        intrinsics,
        hand.landmarks_3d[order] * OPENGL,
        _vertices(hand) * OPENGL,
        annotated,
    )


def _vertices(hand: SyntheticHand) -> Float[np.ndarray, "vertex 3"]:
    parts = (hand.joint_angles, hand.shape, hand.root_rotation, hand.translation)
    parameters = HandParameters(*(torch.from_numpy(part).float() for part in parts))
    with torch.no_grad():
        return np.asarray(open_hand("ho3d").to_camera(parameters).vertices.numpy())


def _write_part(
    root: Path, name: str, folder: Ho3dFolder, sequences: list[list[_Frame]]
) -> list[_Frame]:
    """Write the training or evaluation set; returns its annotated frames, interleaved over the sequences."""
    listed = [
        frame for frames in zip(*sequences, strict=True) for frame in frames if frame.annotated
    ]
    for frame in (frame for frames in sequences for frame in frames):
        sequence, number = frame.name.split("/")
        sequence_folder = root / name / sequence
        for kind in ("rgb", "meta"):
            (sequence_folder / kind).mkdir(parents=True, exist_ok=True)
        path = sequence_folder / "rgb" / f"{number}{SUFFIXES[folder.version]}"
        cv2.imwrite(str(path), frame.image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 95])
        # The original files have protocol 2, written by Python 2.
        content = pickle.dumps(_meta(frame, name == "train", folder.version), protocol=2)
        (sequence_folder / "meta" / f"{number}.pkl").write_bytes(content)
    (root / name).mkdir(parents=True, exist_ok=True)
    lines = "".join(f"{frame.name}\n" for frame in listed)
    (root / f"{name}.txt").write_text(lines, encoding="utf-8")
    return listed


def _meta(frame: _Frame, training: bool, version: str) -> dict[str, object]:
    """Annotation of a frame, with all of HO3D's keys."""
    meta: dict[str, object] = {key: np.zeros(shape) for key, shape in OBJECT_KEYS.items()}
    meta |= {"objName": "none", "objLabel": 0, "camMat": frame.intrinsics, "camIDList": ["0"]}
    if training:
        meta |= {"handJoints3D": frame.joints.astype(float)}
        # The open hand has no MANO parameters.
        meta |= dict.fromkeys(("handPose", "handBeta", "handTrans"))
        if version == "v3":
            meta |= {key: np.zeros(shape) for key, shape in CONTACT_KEYS.items()}
    else:
        meta["handJoints3D"] = frame.joints[0].astype(float)
        meta["handBoundingBox"] = _box(frame)
    if frame.annotated:
        return meta
    kept = ("camMat", "camIDList")
    return {key: value if key in kept else None for key, value in meta.items()}


def _box(frame: _Frame) -> list[int]:
    """Left, top, right and bottom of the projected vertices, in integer pixels inside the image."""
    points = frame.vertices.astype(float) * OPENGL
    pixels = project_array(points, frame.intrinsics)
    height, width = frame.image.shape[:2]
    low = np.floor(pixels.min(axis=0)).clip(0, (width - 2, height - 2))
    high = np.ceil(pixels.max(axis=0)).clip(low + 1, (width, height))
    return [int(value) for value in (*low, *high)]


def _write_json(path: Path, arrays: list[np.ndarray]) -> None:
    path.write_text(json.dumps([array.tolist() for array in arrays]), encoding="utf-8")
