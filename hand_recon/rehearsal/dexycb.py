"""Synthetic hands in DexYCB's file layout, to test its loader and training without the dataset.

Folders, file names, keys, shapes and units are those of DexYCB (Chao et al., CVPR 2021): ten subjects, a
hundred sequences each, eight cameras around a hand. Depth images, objects and their models are left out.
Hands are drawn by painting their triangles from back to front, which takes milliseconds.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import torch
from jaxtyping import Float, Int, UInt8

from hand_recon.camera import project_array
from hand_recon.data.dexycb.files import SEQUENCES, SERIALS, SIZE, SUBJECTS, label_path
from hand_recon.data.dexycb.surfaces import ManoPair
from hand_recon.data.synthetic.gestures import sample_pose
from hand_recon.hand.anatomical_frame import joint_rotations
from hand_recon.hand.axis_angle import mirror_axis_angle, rotation_to_axis_angle
from hand_recon.hand.open_hand import open_hand
from hand_recon.rehearsal.dexycb_cameras import (
    EXTRINSICS,
    Cameras,
    write_cameras,
    write_yaml,
)

HAND: Final = 255
"""Value of the hand in `seg`."""

BACKGROUND: Final = (70, 90, 110)
"""Colour of the background, RGB; the hand's red channel is always larger."""

_MIRROR: Final = np.array([-1.0, 1.0, 1.0])

_LIGHT: Final = np.array([0.3, -0.5, -0.81])


@dataclass(frozen=True)
class DexYcbFolder:
    """Contents of the folder to write."""

    subjects: tuple[int, ...] = tuple(range(len(SUBJECTS)))
    """Subjects, as indices into `SUBJECTS`."""
    frames: int = 1
    """Frames per camera in sequences that have frames."""
    every: int = 1
    """Every n-th sequence has frames, the others have none, so that the official splits stay unchanged. 19
    gives 480 images in all, with some in every part of every setup."""
    unlabelled: int = 7
    """Every n-th image shows no hand and has no labels; 0 for none."""
    mano: ManoPair | None = None
    """MANO hands with parameters `pose_m` and `betas`. Without them the open hand is drawn, and `pose_m`
    holds its rotation, zeros for the pose and the wrist's position, which are no MANO parameters."""
    seed: int = 0
    """Seed of the hands."""

    def __post_init__(self) -> None:
        if min(self.frames, self.every) < 1 or not self.subjects or self.unlabelled == 1:
            raise ValueError(
                f"Nothing to write: {self}; ask for at least one subject, and for frames that show a hand."
            )


@dataclass(frozen=True)
class _Hand:
    """Hand in the world's frame or in a camera's."""

    vertices: Float[np.ndarray, "vertex 3"]
    faces: Int[np.ndarray, "face 3"]
    landmarks: Float[np.ndarray, "landmark=21 3"]
    pose_m: Float[np.ndarray, " number=51"]
    wrist: Float[np.ndarray, " 3"]
    """Centre of the rotation in `pose_m`, relative to its translation, metres."""

    def to_camera(self, camera: Float[np.ndarray, "3 4"]) -> "_Hand":
        """Transform the hand to the frame of a camera, whose pose in the hand's frame is given."""
        rotation, position = camera[:, :3].T, camera[:, 3]
        pose_m = self.pose_m.copy()
        pose_m[:3] = cv2.Rodrigues(rotation @ cv2.Rodrigues(pose_m[:3])[0])[0].ravel()
        pose_m[48:] = rotation @ (self.wrist + pose_m[48:] - position) - self.wrist
        points = ((points - position) @ rotation.T for points in (self.vertices, self.landmarks))
        vertices, landmarks = points
        return _Hand(vertices, self.faces, landmarks, pose_m, self.wrist)


def write_dexycb_layout(root: Path, folder: DexYcbFolder) -> None:
    """Write images, labels and calibration.

    Args:
        root: Folder to create, which corresponds to `DEX_YCB_DIR`.
        folder: Contents to write.

    Raises:
        FileExistsError: The folder is not empty.
    """
    if root.exists() and any(root.iterdir()):
        raise FileExistsError(f"{root} is not empty; choose another root.")
    random = np.random.default_rng(folder.seed)
    cameras = write_cameras(root / "calibration", random)
    for subject in folder.subjects:
        name = SUBJECTS[subject]
        betas = {side: random.normal(scale=0.7, size=10) for side in ("right", "left")}
        ids = {side: f"{name[:8]}_140000_{name[9:]}_{side}" for side in betas}
        for side, numbers in betas.items():
            path = root / "calibration" / f"mano_{ids[side]}" / "mano.yml"
            write_yaml(path, {"betas": numbers.tolist()})
        for number in range(SEQUENCES):
            # The side is random, so that tests catch a loader that infers it from the sequence's index.
            side = str(random.choice(["right", "left"]))
            frames = folder.frames if number % folder.every == 0 else 0
            sequence = root / name / f"{name[:8]}_{10 + number // 60}{number % 60:02d}00"
            _write_meta(sequence, frames, side, ids[side])
            if frames:
                drawn = np.random.default_rng([folder.seed, subject, number])
                hands = [_make_hand(drawn, side, betas[side], folder.mano) for _ in range(frames)]
                _write_sequence(sequence, hands, cameras, number + 1, folder.unlabelled)


def _make_hand(
    random: np.random.Generator,
    side: str,
    betas: Float[np.ndarray, " direction=10"],
    mano: ManoPair | None,
) -> _Hand:
    """Draw a hand near the world's origin in a random rotation."""
    axis = random.normal(size=3)
    rotation = axis / np.linalg.norm(axis) * random.uniform(0, np.pi)
    translation = random.uniform(-0.05, 0.05, size=3)
    if mano is None:
        return _make_open_hand(random, side, rotation, translation)
    layer = mano.layer(side == "left")
    pose_m = np.concatenate([rotation, _natural_coefficients(random, mano, side), translation])
    label, shape = torch.from_numpy(pose_m).float(), torch.from_numpy(betas).float()
    with torch.no_grad():
        hand = layer(*mano.parameters(label, shape, side == "left"))
        wrist = layer.wrist(shape).numpy()
    faces = layer.hand.faces.numpy()
    parts = (points.numpy().astype(float) for points in (hand.vertices, hand.landmarks))
    vertices, landmarks = parts
    return _Hand(vertices, faces, landmarks, pose_m, wrist.astype(float))


def _natural_coefficients(
    random: np.random.Generator, mano: ManoPair, side: str
) -> Float[np.ndarray, " component=45"]:
    """Draw a gesture and convert it to DexYCB's coefficients of MANO's components about its mean pose."""
    right = mano.right.hand
    angles = torch.from_numpy(sample_pose(random)).to(right.frames)
    axis_angles = rotation_to_axis_angle(joint_rotations(angles, right.frames, right.rest_angles))
    if side == "left":
        axis_angles = mirror_axis_angle(axis_angles)
    layer = mano.layer(side == "left")
    residual = (axis_angles.flatten() - layer.hands_mean).double()
    # The 45 components are a full basis, so every pose has exact coefficients.
    coefficients = torch.linalg.solve(layer.hands_components.double().mT, residual)
    return np.asarray(coefficients.numpy())


def _make_open_hand(
    random: np.random.Generator,
    side: str,
    rotation: Float[np.ndarray, " 3"],
    translation: Float[np.ndarray, " 3"],
) -> _Hand:
    model = open_hand("dexycb")
    angles, shape = sample_pose(random), np.clip(random.normal(size=10), -2, 2)
    with torch.no_grad():
        hand = model(torch.from_numpy(angles).float(), torch.from_numpy(shape).float())
    matrix = cv2.Rodrigues(rotation)[0]
    mirror = _MIRROR if side == "left" else np.ones(3)
    wrist = matrix @ (hand.landmarks[0].numpy() * mirror) + translation
    vertices, landmarks = (
        (points.numpy() * mirror) @ matrix.T + translation
        for points in (hand.vertices, hand.landmarks)
    )
    pose_m = np.concatenate([rotation, np.zeros(45), wrist])
    return _Hand(vertices, model.faces.numpy(), landmarks, pose_m, np.zeros(3))


def _write_meta(folder: Path, frames: int, side: str, calibration: str) -> None:
    meta = {
        "serials": list(SERIALS),
        "num_frames": frames,
        "extrinsics": EXTRINSICS,
        "ycb_ids": [1],
        "ycb_grasp_ind": 0,
        "mano_sides": [side],
        "mano_calib": [calibration],
    }
    write_yaml(folder / "meta.yml", meta)


def _write_sequence(
    folder: Path, hands: list[_Hand], cameras: Cameras, first: int, unlabelled: int
) -> None:
    """Write all images of a sequence.

    Args:
        folder: Folder of the sequence.
        hands: One hand per frame.
        cameras: The eight cameras.
        first: Start of the count of images; it differs between sequences, so that every camera has some
            images without a hand.
        unlabelled: Every n-th image shows no hand; 0 for none.
    """
    objects = np.tile(np.array([0.0, 0, 0, 1, 0, 0, 0]), (len(hands), 1, 1))
    poses = np.stack([hand.pose_m for hand in hands])[:, None].astype(np.float32)
    np.savez(folder / "pose.npz", pose_m=poses, pose_y=objects.astype(np.float32))
    for camera, serial in enumerate(SERIALS):
        (folder / serial).mkdir()
        for frame, hand in enumerate(hands):
            hidden = unlabelled and (first + camera * len(hands) + frame) % unlabelled == 0
            shown = None if hidden else hand.to_camera(cameras.poses[camera])
            _write_frame(folder / serial, frame, shown, cameras.intrinsics[camera])


def _write_frame(
    folder: Path, frame: int, hand: _Hand | None, intrinsics: Float[np.ndarray, "3 3"]
) -> None:
    image, seg = _background(), np.zeros(SIZE, np.uint8)
    label = {
        "pose_m": np.zeros((1, 51)),
        "joint_3d": np.full((1, 21, 3), -1.0),
        "joint_2d": np.full((1, 21, 2), -1.0),
    }
    if hand is not None:
        _paint(image, seg, hand, intrinsics)
        pixels = project_array(hand.landmarks, intrinsics)
        label = {
            "pose_m": hand.pose_m[None],
            "joint_3d": hand.landmarks[None],
            "joint_2d": pixels[None],
        }
    object_pose = np.eye(3, 4, dtype=np.float32)[None]
    numbers: dict[str, Any] = {name: values.astype(np.float32) for name, values in label.items()}
    np.savez_compressed(label_path(folder, frame), seg=seg, pose_y=object_pose, **numbers)
    path = folder / f"color_{frame:06d}.jpg"
    cv2.imwrite(str(path), image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 90])


def _background() -> UInt8[np.ndarray, "height width 3"]:
    return np.tile(np.array(BACKGROUND, np.uint8), (*SIZE, 1))


def _paint(
    image: UInt8[np.ndarray, "height width 3"],
    seg: UInt8[np.ndarray, "height width"],
    hand: _Hand,
    intrinsics: Float[np.ndarray, "3 3"],
) -> None:
    """Paint the hand's triangles from back to front, lit from above."""
    corners = hand.vertices[hand.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True) + 1e-12
    shade = 0.45 + 0.55 * np.abs(normals @ _LIGHT)
    colours = (shade[:, None] * [225, 170, 140]).astype(int).tolist()
    # OpenCV takes sixteenths of a pixel, measured from pixel centres.
    pixels = np.round((project_array(hand.vertices, intrinsics) - 0.5) * 16).astype(np.int32)
    corners_2d = pixels[hand.faces]
    for face in np.argsort(-corners[..., 2].mean(axis=1)).tolist():
        triangle = corners_2d[face]
        cv2.fillConvexPoly(image, triangle, colours[face], shift=4)
    seg[image[..., 0] != BACKGROUND[0]] = HAND
