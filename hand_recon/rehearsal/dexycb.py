"""Synthetic hands written as DexYCB lies on disk, so that its loader and its training can be tested.

Folders, file names, keys, shapes and units are those of DexYCB (Chao et al., CVPR 2021): ten subjects, a
hundred sequences each, eight cameras around a hand. Depth, things and their models are left out. Hands are
drawn by painting their triangles from back to front, which takes milliseconds.
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
"""What marks the hand in `seg`."""

BACKGROUND: Final = (70, 90, 110)
"""Colour behind the hand, whose red is always more."""

_MIRROR: Final = np.array([-1.0, 1.0, 1.0])

_LIGHT: Final = np.array([0.3, -0.5, -0.81])


@dataclass(frozen=True)
class DexYcbFolder:
    """What to write."""

    subjects: tuple[int, ...] = tuple(range(len(SUBJECTS)))
    """Which subjects, by their place in `SUBJECTS`."""
    frames: int = 1
    """Frames of each camera in a sequence that has any."""
    every: int = 1
    """Every n-th sequence has frames and the others have none, so that all splits stay as they are: 19
    leaves some in every part of every setup, and 480 pictures in all."""
    unlabelled: int = 7
    """Every n-th picture shows no hand and has no labels; zero for none."""
    mano: ManoPair | None = None
    """Makes hands, so that `pose_m` and `betas` are theirs. Without it, hands are the open hand; their
    `pose_m` has a rotation and the wrist's place, but zeros for the pose: there are no MANO parameters."""
    seed: int = 0
    """Of the hands."""

    def __post_init__(self) -> None:
        if min(self.frames, self.every) < 1 or not self.subjects or self.unlabelled == 1:
            raise ValueError(
                f"Nothing to write: {self}; ask for a subject, and for frames that show a hand."
            )


@dataclass(frozen=True)
class _Hand:
    """A hand in some frame."""

    vertices: Float[np.ndarray, "vertex 3"]
    faces: Int[np.ndarray, "face 3"]
    landmarks: Float[np.ndarray, "landmark=21 3"]
    pose_m: Float[np.ndarray, " number=51"]
    wrist: Float[np.ndarray, " 3"]
    """What `pose_m` turns about, relative to its translation."""

    def seen_from(self, camera: Float[np.ndarray, "3 4"]) -> "_Hand":
        """The hand in the frame of a camera, whose pose in this frame is given."""
        turn, place = camera[:, :3].T, camera[:, 3]
        pose_m = self.pose_m.copy()
        pose_m[:3] = cv2.Rodrigues(turn @ cv2.Rodrigues(pose_m[:3])[0])[0].ravel()
        pose_m[48:] = turn @ (self.wrist + pose_m[48:] - place) - self.wrist
        points = ((points - place) @ turn.T for points in (self.vertices, self.landmarks))
        vertices, landmarks = points
        return _Hand(vertices, self.faces, landmarks, pose_m, self.wrist)


def write_dexycb_layout(root: Path, folder: DexYcbFolder) -> None:
    """Write pictures, labels and calibration.

    Args:
        root: Becomes what `DEX_YCB_DIR` is.
        folder: What to write.

    Raises:
        FileExistsError: The root holds something already.
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
        for place in range(SEQUENCES):
            # At random: a loader that takes the side from the place is caught.
            side = str(random.choice(["right", "left"]))
            frames = folder.frames if place % folder.every == 0 else 0
            sequence = root / name / f"{name[:8]}_{10 + place // 60}{place % 60:02d}00"
            _write_meta(sequence, frames, side, ids[side])
            if frames:
                drawn = np.random.default_rng([folder.seed, subject, place])
                hands = [_make_hand(drawn, side, betas[side], folder.mano) for _ in range(frames)]
                _write_sequence(sequence, hands, cameras, place + 1, folder.unlabelled)


def _make_hand(
    random: np.random.Generator,
    side: str,
    betas: Float[np.ndarray, " direction=10"],
    mano: ManoPair | None,
) -> _Hand:
    """A hand near the world's origin, turned anyhow."""
    axis = random.normal(size=3)
    rotation = axis / np.linalg.norm(axis) * random.uniform(0, np.pi)
    place = random.uniform(-0.05, 0.05, size=3)
    if mano is None:
        return _make_open_hand(random, side, rotation, place)
    layer = mano.layer(side == "left")
    pose_m = np.concatenate([rotation, _natural_coefficients(random, mano, side), place])
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
    """A gesture as DexYCB writes a pose: coefficients of MANO's components about its mean."""
    right = mano.right.hand
    angles = torch.from_numpy(sample_pose(random)).to(right.frames)
    turns = rotation_to_axis_angle(joint_rotations(angles, right.frames, right.rest_angles))
    if side == "left":
        turns = mirror_axis_angle(turns)
    layer = mano.layer(side == "left")
    residual = (turns.flatten() - layer.hands_mean).double()
    # The components are a full basis, so that every pose has its coefficients.
    coefficients = torch.linalg.solve(layer.hands_components.double().mT, residual)
    return np.asarray(coefficients.numpy())


def _make_open_hand(
    random: np.random.Generator,
    side: str,
    rotation: Float[np.ndarray, " 3"],
    place: Float[np.ndarray, " 3"],
) -> _Hand:
    model = open_hand("dexycb")
    angles, shape = sample_pose(random), np.clip(random.normal(size=10), -2, 2)
    with torch.no_grad():
        hand = model(torch.from_numpy(angles).float(), torch.from_numpy(shape).float())
    turn = cv2.Rodrigues(rotation)[0]
    mirror = _MIRROR if side == "left" else np.ones(3)
    wrist = turn @ (hand.landmarks[0].numpy() * mirror) + place
    vertices, landmarks = (
        (points.numpy() * mirror) @ turn.T + place for points in (hand.vertices, hand.landmarks)
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
    """All pictures of a sequence.

    Args:
        folder: Of the sequence.
        hands: One per frame.
        cameras: All of them.
        first: Where the count of pictures starts: at its own number, so that all cameras have some without
            a hand.
        unlabelled: Every n-th picture has none.
    """
    things = np.tile(np.array([0.0, 0, 0, 1, 0, 0, 0]), (len(hands), 1, 1))
    poses = np.stack([hand.pose_m for hand in hands])[:, None]
    np.savez(folder / "pose.npz", pose_m=poses.astype(np.float32), pose_y=things.astype(np.float32))
    for camera, serial in enumerate(SERIALS):
        (folder / serial).mkdir()
        for frame, hand in enumerate(hands):
            hidden = unlabelled and (first + camera * len(hands) + frame) % unlabelled == 0
            seen = None if hidden else hand.seen_from(cameras.poses[camera])
            _write_frame(folder / serial, frame, seen, cameras.intrinsics[camera])


def _write_frame(
    folder: Path, frame: int, hand: _Hand | None, intrinsics: Float[np.ndarray, "3 3"]
) -> None:
    picture, seg = _background(), np.zeros(SIZE, np.uint8)
    label = {
        "pose_m": np.zeros((1, 51)),
        "joint_3d": np.full((1, 21, 3), -1.0),
        "joint_2d": np.full((1, 21, 2), -1.0),
    }
    if hand is not None:
        _paint(picture, seg, hand, intrinsics)
        pixels = project_array(hand.landmarks, intrinsics)
        label = {
            "pose_m": hand.pose_m[None],
            "joint_3d": hand.landmarks[None],
            "joint_2d": pixels[None],
        }
    thing = np.eye(3, 4, dtype=np.float32)[None]
    numbers: dict[str, Any] = {name: values.astype(np.float32) for name, values in label.items()}
    np.savez_compressed(label_path(folder, frame), seg=seg, pose_y=thing, **numbers)
    path = folder / f"color_{frame:06d}.jpg"
    cv2.imwrite(str(path), picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 90])


def _background() -> UInt8[np.ndarray, "height width 3"]:
    return np.tile(np.array(BACKGROUND, np.uint8), (*SIZE, 1))


def _paint(
    picture: UInt8[np.ndarray, "height width 3"],
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
    # Sixteenths of a pixel; OpenCV counts from pixel centres.
    pixels = np.round((project_array(hand.vertices, intrinsics) - 0.5) * 16).astype(np.int32)
    corners_2d = pixels[hand.faces]
    for face in np.argsort(-corners[..., 2].mean(axis=1)).tolist():
        triangle = corners_2d[face]
        cv2.fillConvexPoly(picture, triangle, colours[face], shift=4)
    seg[picture[..., 0] != BACKGROUND[0]] = HAND
