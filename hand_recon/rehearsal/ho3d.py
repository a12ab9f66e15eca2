"""Synthetic hands written as HO3D lies on disk, so that its loader and its training can be tested.

Folders, file names, keys, shapes, axes (OpenGL's) and the order of joints are those of HO3D v2 and v3
(Hampali et al., CVPR 2020 and 2022; shreyashampali/ho3d). The hand is the open hand, so that there are no
numbers of MANO's: their entries are None. There is no depth, no calibration and no object.
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
"""Signs between this project's camera and HO3D's."""

HO3D_LIKE: Final[Level] = replace(
    DIFFICULTIES["medium"], name="ho3d", cone=180.0, roll=180.0, fill=(0.4, 0.6), held_object=0.8,
)  # fmt: skip
"""Hands from all sides, most of them holding something."""

SUFFIXES: Final = {"v3": ".jpg", "v2": ".png"}
"""Kind of picture of each version."""

OBJECT_KEYS: Final[dict[str, tuple[int, ...]]] = {
    "objTrans": (3,), "objRot": (3, 1), "objCorners3D": (8, 3), "objCorners3DRest": (8, 3),
}  # fmt: skip
CONTACT_KEYS: Final[dict[str, tuple[int, ...]]] = {
    "handVertContact": (778,), "handVertDist": (778,), "handVertIntersec": (778,),
    "handVertObjSurfProj": (778, 3),
}  # fmt: skip
"""Entries that are there in form, as zeros; those of contact in version 3 alone."""


@dataclass(frozen=True)
class Ho3dFolder:
    """What to write."""

    version: str = "v3"
    """`v3` or `v2`."""
    sequences: tuple[str, ...] = ("ABF10", "ABF11", "MC1", "ND2", "SM2")
    """Training sequences. Those that differ in the second of two digits are cameras of one recording."""
    frames: int = 4
    """Annotated frames of each."""
    evaluation_sequences: tuple[str, ...] = ("AP10", "SM1")
    """Evaluation sequences."""
    evaluation_frames: int = 4
    """Annotated frames of each."""
    unannotated: int = 1
    """Frames of each sequence that have pictures and no annotation, and are not in the lists."""
    with_truth: bool = True
    """Whether to write `evaluation_xyz.json`, which is a download of its own."""
    with_vertices: bool = True
    """Whether to write `evaluation_verts.json` beside it."""
    size: tuple[int, int] = field(default=(640, 480))
    """Width and height of the pictures, pixels."""
    seed: int = 0
    """Of the hands."""

    def recipe(self, split: str, place: int) -> Recipe:
        """What a sequence's hands are made from, in square pictures as high as those that are written.

        Args:
            split: `train` or `test`.
            place: Of the sequence: each has one camera.
        """
        focal, centre = 280.0 + 7.0 * place, 110.0 + 2.0 * place
        level = replace(
            HO3D_LIKE,
            focal=(focal, focal),
            principal_x=(centre, centre),
            principal_y=(centre, centre),
        )
        return Recipe(split, level, self.size[1], self.seed, "ho3d")


@dataclass(frozen=True)
class _Frame:
    """One picture and what is known of it."""

    name: str
    image: UInt8[np.ndarray, "height width 3"]
    intrinsics: Float[np.ndarray, "3 3"]
    joints: Float[np.ndarray, "joint=21 3"]
    vertices: Float[np.ndarray, "vertex 3"]
    annotated: bool


def write_ho3d_layout(root: Path, folder: Ho3dFolder) -> None:
    """Write the pictures and annotations.

    Args:
        root: Becomes what `HO3D_v3` or `HO3D_v2` is, with the published evaluation truth beside.
        folder: What to write.

    Raises:
        ValueError: There is no such version, or there would be no pictures.
        FileExistsError: The root already has training pictures.
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
        _sequence_frames(folder, "train", place, folder.frames)
        for place in range(len(folder.sequences))
    ]
    _write_part(root, "train", folder, train)
    evaluation = [
        _sequence_frames(folder, "test", place, folder.evaluation_frames)
        for place in range(len(folder.evaluation_sequences))
    ]
    listed = _write_part(root, "evaluation", folder, evaluation)
    if folder.with_truth:
        _write_json(root / "evaluation_xyz.json", [frame.joints for frame in listed])
        if folder.with_vertices:
            _write_json(root / "evaluation_verts.json", [frame.vertices for frame in listed])


def _sequence_frames(folder: Ho3dFolder, split: str, place: int, count: int) -> list[_Frame]:
    """Frames of one sequence, which has one camera."""
    names = folder.sequences if split == "train" else folder.evaluation_sequences
    recipe = folder.recipe(split, place)
    total = count + folder.unannotated
    frames = []
    for number in range(total):
        hand = synthetic_hand(recipe, place * total + number)
        frames.append(
            _frame(f"{names[place]}/{number:04d}", hand, folder.size[0], annotated=number < count)
        )
    return frames


def _frame(name: str, hand: SyntheticHand, width: int, *, annotated: bool) -> _Frame:
    """A square picture widened to both sides, its annotation in HO3D's axes and order."""
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
    """Write a part; returns the frames of its list in order: first all sequences' first ones."""
    listed = [
        frame for frames in zip(*sequences, strict=True) for frame in frames if frame.annotated
    ]
    for frame in (frame for frames in sequences for frame in frames):
        sequence, number = frame.name.split("/")
        place = root / name / sequence
        for kind in ("rgb", "meta"):
            (place / kind).mkdir(parents=True, exist_ok=True)
        picture = place / "rgb" / f"{number}{SUFFIXES[folder.version]}"
        cv2.imwrite(str(picture), frame.image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 95])
        # Protocol 2, as Python 2 wrote the originals.
        content = pickle.dumps(_meta(frame, name == "train", folder.version), protocol=2)
        (place / "meta" / f"{number}.pkl").write_bytes(content)
    (root / name).mkdir(parents=True, exist_ok=True)
    lines = "".join(f"{frame.name}\n" for frame in listed)
    (root / f"{name}.txt").write_text(lines, encoding="utf-8")
    return listed


def _meta(frame: _Frame, training: bool, version: str) -> dict[str, object]:
    """The dictionary of a frame, with every key that HO3D's have."""
    meta: dict[str, object] = {key: np.zeros(shape) for key, shape in OBJECT_KEYS.items()}
    meta |= {"objName": "none", "objLabel": 0, "camMat": frame.intrinsics, "camIDList": ["0"]}
    if training:
        meta |= {"handJoints3D": frame.joints.astype(float)}
        # The open hand has no numbers of MANO's.
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
    """Left, top, right and bottom of the surface's projection, whole pixels inside the picture."""
    points = frame.vertices.astype(float) * OPENGL
    pixels = project_array(points, frame.intrinsics)
    height, width = frame.image.shape[:2]
    low = np.floor(pixels.min(axis=0)).clip(0, (width - 2, height - 2))
    high = np.ceil(pixels.max(axis=0)).clip(low + 1, (width, height))
    return [int(value) for value in (*low, *high)]


def _write_json(path: Path, arrays: list[np.ndarray]) -> None:
    path.write_text(json.dumps([array.tolist() for array in arrays]), encoding="utf-8")
