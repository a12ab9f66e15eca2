"""Synthetic hands in FreiHAND's file layout, to test its loader and training without the dataset.

Folders, file names, counts and JSON shapes are those of FreiHAND v2 (Zimmermann et al., ICCV 2019). Hands
are the open hand, whose number of vertices differs from MANO's, unless the user's own MANO is given.
"""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8

from hand_recon.data.synthetic.levels import DIFFICULTIES, Level
from hand_recon.data.synthetic.recipe import Recipe
from hand_recon.data.synthetic.scene import SyntheticHand, synthetic_hand
from hand_recon.hand.mano.layer import ManoLayer
from hand_recon.hand.open_hand import open_hand
from hand_recon.hand.skeleton import LANDMARKS
from hand_recon.rehearsal.freihand_mano import ManoImage, mano_image
from hand_recon.schema import HandParameters

VERSIONS: Final = 4
"""Backgrounds per training hand; file i + N·v is version v of hand i."""

SIZE: Final = 224
"""Side of the images, pixels."""

FREIHAND_LIKE: Final[Level] = replace(
    DIFFICULTIES["medium"], name="freihand", cone=180.0, roll=180.0, focal=(366.0, 1131.0),
    principal_x=(107.0, 194.0), principal_y=(80.0, 119.0), fill=(0.33, 0.43), calm_background=0.1,
    clutter=0.3,
)  # fmt: skip
"""Level with focal lengths, principal points and hand sizes as in twenty images of FreiHAND."""

_SCALE_BONE: Final = (LANDMARKS.index("middle MCP"), LANDMARKS.index("middle PIP"))


@dataclass(frozen=True)
class FreiHandFolder:
    """Contents of the folder to write."""

    unique: int
    """Number of training hands, each with four images."""
    evaluation: int
    """Number of evaluation images."""
    with_vertices: bool = True
    """True writes `*_verts.json`."""
    with_mano: bool = False
    """True writes `training_mano.json` in the right shape (1×61), but with the open hand's joint angles and
    shape padded with zeros, which are no MANO parameters."""
    mano: ManoLayer | None = None
    """MANO's right hand with the landmark set `mano`. If given, all hands are MANO's, drawn in flat colours,
    and `training_mano.json` holds their parameters."""
    seed: int = 0
    """Seed of the hands."""


def write_freihand_layout(root: Path, folder: FreiHandFolder) -> None:
    """Write images and annotations.

    Args:
        root: Folder to create, which corresponds to `FreiHAND_pub_v2` with the published evaluation
            annotations.
        folder: Contents to write.

    Raises:
        ValueError: There would be no images.
        FileExistsError: The folder already has training images.
    """
    if folder.unique < 1 or folder.evaluation < 0:
        raise ValueError(
            f"Nothing to write: {folder.unique} training hands and {folder.evaluation} evaluation "
            "images; ask for at least one training hand."
        )
    if (root / "training").exists():
        raise FileExistsError(f"{root / 'training'} exists already; choose another root.")
    _write_split(
        root, "training", folder, Recipe("train", FREIHAND_LIKE, SIZE, folder.seed, "mano")
    )
    if folder.evaluation:
        recipe = Recipe("test", FREIHAND_LIKE, SIZE, folder.seed, "mano")
        _write_split(root, "evaluation", folder, recipe)


def _write_split(root: Path, name: str, folder: FreiHandFolder, recipe: Recipe) -> None:
    training = name == "training"
    count = folder.unique if training else folder.evaluation
    hands: list[SyntheticHand | ManoImage] = []
    for index in range(count):
        for version in range(VERSIONS if training else 1):
            hand = _render(folder, recipe, index, version)
            _write_image(root / name / "rgb" / f"{index + count * version:08d}.jpg", hand.image)
        if training:
            _write_image(root / name / "mask" / f"{index:08d}.jpg", _as_image(hand.mask))
        hands.append(hand)
    _write_json(root / f"{name}_K.json", [hand.intrinsics for hand in hands])
    _write_json(root / f"{name}_xyz.json", [hand.landmarks_3d for hand in hands])
    _write_json(root / f"{name}_scale.json", [np.array(_scale(hand)) for hand in hands])
    if folder.with_vertices:
        _write_json(root / f"{name}_verts.json", [_vertices(hand) for hand in hands])
    if (folder.with_mano or folder.mano is not None) and training:
        _write_json(root / f"{name}_mano.json", [_mano_numbers(hand) for hand in hands])


def _render(
    folder: FreiHandFolder, recipe: Recipe, index: int, version: int
) -> SyntheticHand | ManoImage:
    if folder.mano is not None:
        return mano_image(folder.mano, recipe, index, version)
    return synthetic_hand(recipe, index, appearance=version)


def _write_image(path: Path, image: UInt8[np.ndarray, "height width 3"]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 95])


def _as_image(mask: Bool[np.ndarray, "height width"]) -> UInt8[np.ndarray, "height width 3"]:
    return np.repeat(np.where(mask, 255, 0).astype(np.uint8)[..., None], 3, axis=2)


def _write_json(path: Path, arrays: list[np.ndarray]) -> None:
    path.write_text(json.dumps([array.tolist() for array in arrays]), encoding="utf-8")


def _scale(hand: SyntheticHand | ManoImage) -> float:
    """Length of the middle finger's proximal phalanx, metres."""
    start, end = (hand.landmarks_3d[landmark].astype(float) for landmark in _SCALE_BONE)
    return float(np.linalg.norm(start - end))


def _vertices(hand: SyntheticHand | ManoImage) -> Float[np.ndarray, "vertex 3"]:
    if isinstance(hand, ManoImage):
        return hand.vertices
    parts = (hand.joint_angles, hand.shape, hand.root_rotation, hand.translation)
    parameters = HandParameters(*(torch.from_numpy(part).float() for part in parts))
    with torch.no_grad():
        return np.asarray(open_hand("mano").to_camera(parameters).vertices.numpy())


def _mano_numbers(hand: SyntheticHand | ManoImage) -> Float[np.ndarray, "1 61"]:
    """MANO's 61 numbers; for the open hand three zeros, 45 joint angles, 10 shape coefficients, uv, scale."""
    if isinstance(hand, ManoImage):
        return hand.label
    root = hand.landmarks_3d[_SCALE_BONE[0]].astype(float)
    focal = (hand.intrinsics[0, 0] + hand.intrinsics[1, 1]) / 2
    pixel = focal * root[:2] / root[2] + hand.intrinsics[:2, 2]
    numbers = (np.zeros(3), hand.joint_angles.ravel(), hand.shape, pixel, [focal / root[2]])
    return np.concatenate(numbers)[None]
