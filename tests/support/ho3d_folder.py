"""A small folder in HO3D's layout: flat colours, one dot per landmark, the open hand in random rotations.

The numbers go to HO3D's axes and order by lists written out here, not by the loader's own code.
"""

import json
import pickle
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import torch
from jaxtyping import Float

from hand_recon.hand.mano.layer import ManoLayer
from hand_recon.hand.open_hand import open_hand

WIDTH, HEIGHT = 160, 120

FREIHAND_TO_HO3D = [0, 5, 6, 7, 9, 10, 11, 17, 18, 19, 13, 14, 15, 1, 2, 3, 4, 8, 12, 16, 20]
"""HO3D's landmarks by their numbers in FreiHAND's order (shreyashampali/ho3d, joint_order.png)."""

TRAIN = {"ABF10": 4, "ABF11": 3, "ABF12": 3, "MC1": 4, "MC2": 3, "ND2": 5, "SMu40": 3}
EVALUATION = {"AP10": 3, "SM1": 4}


@dataclass(frozen=True)
class Hand:
    """Expected sample of one frame."""

    landmarks: Float[np.ndarray, "landmark=21 3"]
    vertices: Float[np.ndarray, "vertex 3"]
    intrinsics: Float[np.ndarray, "3 3"]
    box: list[int]
    mano: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None

    def pixels(self) -> Float[np.ndarray, "landmark=21 2"]:
        """Projected landmarks, one at a time."""
        rows = []
        for point in self.landmarks:
            u, v, w = self.intrinsics @ point
            rows.append((u / w, v / w))
        return np.array(rows)


@dataclass(frozen=True)
class Folder:
    """A written folder: frames by name, in the order of the lists."""

    root: Path
    train: dict[str, Hand] = field(default_factory=dict)
    evaluation: dict[str, Hand] = field(default_factory=dict)

    def meta(self, frame: str, part: str = "train") -> Path:
        """Path of a frame's annotation."""
        sequence, number = frame.split("/")
        return self.root / part / sequence / "meta" / f"{number}.pkl"


def write_folder(
    root: Path,
    version: str = "v3",
    *,
    ground_truth: bool = True,
    layer: ManoLayer | None = None,
    train: dict[str, int] | None = None,
) -> Folder:
    """Write both parts, the ground truth, and one unlisted frame per sequence.

    Args:
        root: The folder.
        version: `v2` with PNG images or `v3` with JPEG images.
        ground_truth: Also write the ground truth of the evaluation.
        layer: MANO's layer to make the hands with; the open hand by default.
        train: Number of frames by training sequence.
    """
    rng = np.random.default_rng(5)
    folder = Folder(root)
    for part, sequences in (("train", train or TRAIN), ("evaluation", EVALUATION)):
        hands = folder.train if part == "train" else folder.evaluation
        for place, (sequence, count) in enumerate(sequences.items()):
            intrinsics = np.array(
                [[150.0 + place, 0, 78.0 + place], [0, 152.0 + place, 61.0], [0, 0, 1]]
            )
            for number in range(count + 1):
                name = f"{sequence}/{3 * number:04d}"
                hand = _hand(rng, intrinsics, layer)
                meta = meta_of(hand, part == "train")
                if number < count:
                    hands[name] = hand
                else:
                    meta = dict.fromkeys(meta) | {"camMat": intrinsics}
                write_frame(root / part, name, hand, meta, ".jpg" if version == "v3" else ".png")
        # In reverse: the order of the lists is not that of the folders.
        names = list(hands)[::-1]
        (root / f"{part}.txt").write_text("\n".join(names) + "\n")
    if ground_truth:
        ordered = [folder.evaluation[name] for name in list(folder.evaluation)[::-1]]
        write_json(root / "evaluation_xyz.json", [in_ho3d(hand.landmarks) for hand in ordered])
        write_json(root / "evaluation_verts.json", [hand.vertices * FLIP for hand in ordered])
    return folder


FLIP = np.array([1.0, -1.0, -1.0])


def in_ho3d(landmarks: Float[np.ndarray, "landmark=21 3"]) -> Float[np.ndarray, "landmark=21 3"]:
    """Landmarks in HO3D's order and axes."""
    return landmarks[FREIHAND_TO_HO3D] * FLIP


def meta_of(hand: Hand, training: bool) -> dict[str, object]:
    """The annotation of a frame."""
    joints = in_ho3d(hand.landmarks)
    meta: dict[str, object] = {
        "objTrans": np.zeros(3), "objRot": np.zeros((3, 1)), "objName": "021_bleach_cleanser",
        "objLabel": 12, "camMat": hand.intrinsics, "camIDList": ["0", "1"],
        "objCorners3D": np.zeros((8, 3)), "objCorners3DRest": np.zeros((8, 3)),
    }  # fmt: skip
    if not training:
        return meta | {"handJoints3D": joints[0], "handBoundingBox": hand.box}
    pose, shape, translation = hand.mano or (None, None, None)
    return meta | {
        "handJoints3D": joints, "handPose": pose, "handBeta": shape, "handTrans": translation,
        "handVertContact": np.zeros(778, dtype=bool),
    }  # fmt: skip


def write_frame(
    folder: Path, name: str, hand: Hand, meta: dict[str, object], suffix: str = ".jpg"
) -> None:
    """Write an image with a dot per landmark, and its annotation."""
    sequence, number = name.split("/")
    for kind in ("rgb", "meta"):
        (folder / sequence / kind).mkdir(parents=True, exist_ok=True)
    image = np.full((HEIGHT, WIDTH, 3), (90, 40, 60), dtype=np.uint8)
    for u, v in hand.pixels():
        cv2.circle(image, (int(u), int(v)), 1, (255, 255, 255), -1)
    cv2.imwrite(str(folder / sequence / "rgb" / f"{number}{suffix}"), image)
    path = folder / sequence / "meta" / f"{number}.pkl"
    path.write_bytes(pickle.dumps(meta, protocol=2))


def edit_meta(path: Path, change: Callable[[dict[str, object]], object]) -> None:
    """Change an annotation in place."""
    meta = pickle.loads(path.read_bytes())  # noqa: S301  # the test's own
    change(meta)
    path.write_bytes(pickle.dumps(meta, protocol=2))


def write_json(path: Path, arrays: list[np.ndarray]) -> None:
    """Write arrays as nested lists."""
    path.write_text(json.dumps([array.tolist() for array in arrays]))


@cache
def _open_hand_at_rest() -> tuple[np.ndarray, np.ndarray]:
    hand = open_hand("ho3d")
    with torch.no_grad():
        posed = hand(hand.rest_angles, torch.zeros(10))
    return posed.landmarks.double().numpy(), posed.vertices.double().numpy()


def _hand(rng: np.random.Generator, intrinsics: np.ndarray, layer: ManoLayer | None) -> Hand:
    turn = cv2.Rodrigues(rng.normal(size=3))[0]
    place = np.array([*rng.uniform(-0.08, 0.08, 2), rng.uniform(0.55, 0.75)])
    mano = None
    if layer is None:
        landmarks, vertices = (part @ turn.T + place for part in _open_hand_at_rest())
    else:
        # MANO's parameters and points are in the axes of OpenGL's camera.
        mano = rng.normal(0, 0.3, 48), rng.normal(size=10), place * FLIP
        with torch.no_grad():
            parts = (mano[0][:3], mano[0][3:], mano[1], mano[2])
            geometry = layer(*(torch.from_numpy(part).float() for part in parts))
        landmarks = geometry.landmarks.double().numpy() * FLIP
        vertices = geometry.vertices.double().numpy() * FLIP
    pixels = (vertices / vertices[:, 2:]) @ intrinsics.T
    box = [*np.floor(pixels[:, :2].min(axis=0)), *np.ceil(pixels[:, :2].max(axis=0))]
    return Hand(landmarks, vertices, intrinsics, [int(side) for side in box], mano)
