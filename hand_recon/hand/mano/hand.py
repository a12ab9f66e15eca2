"""MANO as a `HandModel`, with the same joint angles, anatomical neutral and records as the open hand.

MANO (Romero et al., SIGGRAPH Asia 2017) needs its makers' licence; `store.py` describes its file. Its rest
pose is flat with spread fingers. Anatomical axes and rest angles are computed from its skeleton by the same
function as for the open hand.
"""

from pathlib import Path
from typing import Final

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.hand.anatomical_axes import ORDER, axes_at_rest
from hand_recon.hand.mano.store import (
    ManoArrays,
    ManoFile,
    Side,
    file_name,
    left_shape_of,
    read_file,
    read_mano,
)
from hand_recon.hand.model import HandAsset, HandModel
from hand_recon.hand.skeleton import FINGERS, LANDMARK_OF_JOINT, TIPS

TIP_VERTICES: Final[dict[str, tuple[int, int, int, int, int]]] = {
    "freihand": (744, 320, 443, 555, 672),
    "dexycb": (745, 317, 444, 556, 673),
    "ho3d": (744, 333, 444, 555, 672),
    "smplx": (744, 320, 443, 554, 671),
}
"""Fingertip vertices of each dataset, thumb first.

Sources: lmb-freiburg/freihand `mano_utils.py`, manopth's `manolayer.py` (which labelled DexYCB),
shreyashampali/ho3d, smplx's `vertex_ids.py` (also HaMeR's).
"""

DEXYCB_LEFT_MIDDLE_TIP: Final = 445
"""Middle fingertip of manopth's left hand, which differs from its right hand's."""

REGRESSED: Final = ("freihand",)
"""Landmark sets with joints regressed from the posed surface, as in FreiHAND; others use rotation centres."""

ALIASES: Final = {"mano": "freihand"}
"""Further names of landmark sets."""


INSPECTED_HANDS: Final = 100
"""Number of hands from which `follows_mano` decides on a dataset's vertex numbering."""


def follows_mano(
    vertices: Float[np.ndarray, "hand vertex 3"],
    landmarks: Float[np.ndarray, "hand landmark=21 3"],
    landmark_set: str,
) -> bool:
    """Check that vertices are numbered as MANO's: the tip vertices must coincide with the fingertips.

    Args:
        vertices: Surfaces of a dataset, metres; only the first `INSPECTED_HANDS` are used.
        landmarks: Landmarks of the same hands, in the same frame.
        landmark_set: Landmark set of the dataset, a key of `TIP_VERTICES`.
    """
    if vertices.shape[1] != 778:
        return False
    tips = np.asarray(vertices[:INSPECTED_HANDS, list(TIP_VERTICES[landmark_set])])
    # The median tolerates single hands with a bad fit.
    return bool(np.median(np.abs(tips - landmarks[:INSPECTED_HANDS, list(TIPS)])) < 1e-3)


def mano_hand(path: Path | str, landmark_set: str = "mano") -> HandModel:
    """Build the hand model of MANO's right hand.

    Args:
        path: Folder written by `hand_recon.prepare mano`, or the file in it.
        landmark_set: `mano` (the same as `freihand`), `dexycb`, `ho3d` or `smplx`.

    Raises:
        FileNotFoundError: There is no MANO file.
        ValueError: The file is in another format, or the landmark set is unknown.
    """
    return HandModel(load_mano(path), landmark_set)


def load_mano(
    path: Path | str,
    side: Side = "right",
    fix_left_shape: bool = True,
    dtype: torch.dtype = torch.float32,
) -> HandAsset:
    """Read a MANO file as a `HandAsset`.

    Args:
        path: Folder written by `hand_recon.prepare mano`, or the file in it.
        side: Right or left hand; the left one's fingers point to +x.
        fix_left_shape: Mirror the left hand's shape directions, so that equal coefficients mean equal shapes
            of both hands. The released file lacks the mirroring, and DexYCB is labelled with the released
            file (dex-ycb-toolkit issue 28).
        dtype: Precision of the arrays; the file has double precision.

    Raises:
        FileNotFoundError: There is no MANO file.
        ValueError: The file is in another format, or holds the other hand.
    """
    return asset_of(with_left_shape(read_mano(path, side), path, fix_left_shape), dtype)


def with_left_shape(file: ManoFile, path: Path | str, fixed: bool) -> ManoFile:
    """Select a left hand's released or corrected (mirrored) shape directions.

    Args:
        file: Hand that was read; right hands are returned unchanged.
        path: Path that the file was read from. If the state of the file's directions is unknown, the right
            hand in the same folder decides it; without a right hand they count as released.
        fixed: True for corrected directions, False for released ones.
    """
    if file.side == "right":
        return file
    state = file.left_shape
    beside = Path(path).expanduser()
    right = (beside if beside.is_dir() else beside.parent) / file_name("right")
    if state == "unknown" and right.is_file():
        state = left_shape_of(file.arrays, read_file(right).arrays)
    if (state == "corrected") == fixed:
        return file
    values = dict(vars(file.arrays))
    values["shape_directions"] = file.arrays.shape_directions * np.array([[-1.0], [1.0], [1.0]])
    return ManoFile(
        ManoArrays(**values), file.side, file.source_sha256, "corrected" if fixed else "released"
    )


def asset_of(file: ManoFile, dtype: torch.dtype = torch.float32) -> HandAsset:
    """Convert a MANO file to a `HandAsset`, with axes, rest angles and landmark sets."""
    arrays = file.arrays
    joints = arrays.joint_regressor @ arrays.template
    tips = arrays.template[list(TIP_VERTICES["freihand"])]
    frames, rest_angles = _axes(joints, tips, file.side)

    def tensor(array: Float[np.ndarray, "..."]) -> Tensor:
        return torch.from_numpy(np.array(array)).to(dtype)

    names = [*TIP_VERTICES, *ALIASES]
    return HandAsset(
        name="mano" if file.side == "right" else "mano left",
        template=tensor(arrays.template),
        shape_directions=tensor(arrays.shape_directions),
        joints=tensor(joints),
        joint_shape_directions=tensor(
            np.einsum("jv,vxs->jxs", arrays.joint_regressor, arrays.shape_directions)
        ),
        skinning_weights=tensor(arrays.skinning_weights),
        faces=torch.from_numpy(np.array(arrays.faces)).long(),
        wrist_ring=torch.from_numpy(np.array(arrays.wrist_ring)).long(),
        frames=tensor(frames),
        rest_angles=tensor(rest_angles),
        landmark_regressors={name: tensor(_landmarks(arrays, name, file.side)) for name in names},
        pose_directions=tensor(arrays.pose_directions),
    )


def tip_vertices(landmark_set: str, side: Side) -> tuple[int, ...]:
    """Fingertip vertices of a landmark set, thumb first."""
    tips = TIP_VERTICES[ALIASES.get(landmark_set, landmark_set)]
    if landmark_set == "dexycb" and side == "left":
        return (*tips[:2], DEXYCB_LEFT_MIDDLE_TIP, *tips[3:])
    return tips


def _landmarks(
    arrays: ManoArrays, landmark_set: str, side: Side
) -> Float[np.ndarray, "landmark=21 point"]:
    """Weights over the vertices followed by the rotation centres."""
    count = len(arrays.template)
    regressor = np.zeros((21, count + 16))
    for joint, landmark in enumerate(LANDMARK_OF_JOINT):
        if ALIASES.get(landmark_set, landmark_set) in REGRESSED:
            regressor[landmark, :count] = arrays.joint_regressor[joint]
        else:
            regressor[landmark, count + joint] = 1.0
    for landmark, vertex in zip(TIPS, tip_vertices(landmark_set, side), strict=True):
        regressor[landmark, vertex] = 1.0
    return regressor


def _axes(
    joints: Float[np.ndarray, "joint=16 3"], tips: Float[np.ndarray, "finger=5 3"], side: Side
) -> tuple[Float[np.ndarray, "joint=15 3 3"], Float[np.ndarray, "joint=15 axis=3"]]:
    """Axes and rest angles; a left hand's are computed on its mirror image and mirrored back.

    A mirrored frame is left-handed; reversing its bend axis makes it right-handed again. Bend then has the
    same sign on both hands, and splay and twist have opposite signs.
    """
    by_joints = tips[[FINGERS.index(finger) for finger in ORDER]]
    if side == "right":
        return axes_at_rest(joints, by_joints)
    mirror = np.array([-1.0, 1.0, 1.0])
    frames, rest_angles = axes_at_rest(joints * mirror, by_joints * mirror)
    return (
        mirror[:, None] * frames * np.array([1.0, 1.0, -1.0]),
        rest_angles * np.array([1.0, -1.0, -1.0]),
    )
