"""Files in MANO's format without MANO's content: the open hand in MANO's numbering.

The pickle is written opcode by opcode as Python 2 wrote the original's (protocol 2, chumpy and old scipy by
name), so that neither is needed. The template is the open hand with flat, spread fingers; blend shapes and
pose components are seeded noise. A left hand is the mirror image, but for its shape directions, which point
as the right one's, as in MANO's release.
"""

import struct
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float

from hand_recon.hand.mano.conversion import prepare_mano
from hand_recon.hand.model import HandModel
from hand_recon.hand.open_hand import load_open_hand, open_hand
from hand_recon.hand.skeleton import ARTICULATED, PARENTS, TIPS

WRIST = np.array([0.09, 0.006, 0.006])
"""Wrist of the right hand at rest, metres: near MANO's, not at the origin."""

AZIMUTHS = {"index": 3.9, "middle": -10.2, "ring": -10.2, "little": -36.3}
"""Directions of MANO's proximal phalanges at rest from −x towards the thumb, degrees."""

TIP_IDS = ((744, 745), (320, 333, 317), (443, 444, 445), (555, 554, 556), (672, 671, 673))
"""Vertices that datasets take for each fingertip, thumb first and FreiHAND's choice first."""

RING_IDS = (108, 79, 78, 121, 214, 215, 279, 239, 234, 92, 38, 122, 118, 117, 119, 120)
"""MANO's vertices around the open wrist, in the order of a cap."""

MIRROR = np.array([-1.0, 1.0, 1.0])
ANGLE_MIRROR = np.tile([1.0, -1.0, -1.0], 15)


class Named:
    """Name and state of an object whose class is not installed."""

    def __init__(self, name: str, state: Mapping[str, object]) -> None:
        self.name = name
        self.state = dict(state)


def write_mano_pickle(path: Path, side: str = "right", seed: int = 0) -> dict[str, np.ndarray]:
    """Write a pickle in the form of MANO_RIGHT.pkl or MANO_LEFT.pkl.

    Args:
        path: Path of the pickle.
        side: `right` or `left`.
        seed: Seed of the blend shapes and pose components.

    Returns:
        The arrays that a loader must find, by MANO's names.
    """
    arrays = mano_arrays(side, seed)
    path.write_bytes(mano_pickle(arrays))
    return arrays


def write_mano_folder(folder: Path, seed: int = 0) -> Path:
    """Write both hands converted, as `hand=mano` reads them."""
    folder.mkdir(parents=True, exist_ok=True)
    for side in ("right", "left"):
        pickled = folder / f"MANO_{side.upper()}.pkl"
        write_mano_pickle(pickled, side, seed)
        prepare_mano(pickled, folder)
        pickled.unlink()
    return folder


def mano_arrays(side: str = "right", seed: int = 0) -> dict[str, np.ndarray]:
    """Copies of a hand's arrays, by MANO's names."""
    right = _right_hand(seed)
    arrays = {key: array.copy() for key, array in right.items()}
    if side == "left":
        rows = np.tile(np.outer(MIRROR, MIRROR).ravel(), 15)
        arrays["v_template"] *= MIRROR
        arrays["f"] = arrays["f"][:, ::-1].copy()
        arrays["posedirs"] *= MIRROR[:, None] * rows
        arrays["J"] = arrays["J_regressor"] @ arrays["v_template"]
        arrays["hands_mean"] *= ANGLE_MIRROR
        arrays["hands_components"] = np.roll(arrays["hands_components"], 1, axis=0) * ANGLE_MIRROR
    return arrays


def mano_pickle(arrays: dict[str, np.ndarray]) -> bytes:
    """A hand as a pickle with the classes of MANO's."""
    shapes = arrays["shapedirs"]
    # As in the original: 20 directions are stored, and an object that is called selects ten of them.
    spare = np.random.default_rng(9).normal(size=shapes.shape)
    stored = np.concatenate([shapes, spare], axis=2)
    chosen = np.arange(stored.size).reshape(stored.shape)[..., : shapes.shape[2]].ravel()
    book = {"_dirty_vars": {1, 2}, "_itr": None, "_depends_on_deps": set(), "want_out": True}
    selected = {
        "a": Named("chumpy.ch Ch", {"x": stored, **book}),
        "idxs": chosen,
        "preferred_shape": shapes.shape,
        **book,
    }
    content: dict[str, object] = dict(arrays)
    content |= {
        "shapedirs": Named("chumpy.reordering Select", selected),
        "J_regressor": Named("scipy.sparse.csc csc_matrix", _columns(arrays["J_regressor"])),
        "bs_style": "lbs",
        "bs_type": "lrotmin",
    }
    return b"\x80\x02" + opcodes(content) + b"."


def opcodes(value: object) -> bytes:
    """A value in pickle protocol 2, as Python 2 writes it."""
    if isinstance(value, np.ndarray):
        return _array(value)
    if isinstance(value, Named):
        return _name(value.name) + b")\x81" + opcodes(value.state) + b"b"
    if isinstance(value, bool):
        return b"\x88" if value else b"\x89"
    if isinstance(value, int):
        return b"J" + struct.pack("<i", value)
    if isinstance(value, str):
        return b"T" + struct.pack("<i", len(value)) + value.encode("latin1")
    if isinstance(value, bytes):
        return b"T" + struct.pack("<i", len(value)) + value
    return _container(value)


def _container(value: object) -> bytes:
    if isinstance(value, dict):
        items = b"".join(opcodes(key) + opcodes(entry) for key, entry in value.items())
        return b"}(" + items + b"u"
    if isinstance(value, set):
        items = b"".join(map(opcodes, sorted(value)))
        return _name("__builtin__ set") + b"](" + items + b"e\x85R"
    if isinstance(value, tuple):
        return b"(" + b"".join(map(opcodes, value)) + b"t"
    if value is None:
        return b"N"
    raise TypeError(f"no opcodes for a {type(value).__name__}")


def _name(name: str) -> bytes:
    return b"c" + name.replace(" ", "\n").encode() + b"\n"


def _array(array: np.ndarray) -> bytes:
    code, order = array.dtype.str[1:], array.dtype.str[0]
    dtype = _name("numpy dtype") + opcodes((code, 0, 1)) + b"R"
    dtype += opcodes((3, order, None, None, None, -1, -1, 0)) + b"b"
    made = _name("numpy.core.multiarray _reconstruct") + b"(" + _name("numpy ndarray")
    made += opcodes((0,)) + opcodes("b") + b"tR"
    state = b"(" + opcodes(1) + opcodes(array.shape) + dtype + opcodes(False)
    return made + state + opcodes(array.tobytes()) + b"tb"


def _columns(dense: Float[np.ndarray, "row column"]) -> dict[str, object]:
    """The state of a compressed sparse column matrix."""
    filled = dense.T != 0
    starts = np.concatenate([[0], filled.sum(axis=1).cumsum()])
    return {
        "_shape": dense.shape,
        "data": dense.T[filled],
        "indices": np.nonzero(filled)[1].astype(np.int32),
        "indptr": starts.astype(np.int32),
        "maxprint": 50,
    }


@cache
def _right_hand(seed: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    asset, (vertices, joints) = load_open_hand(), _spread_hand()
    order = _manos_numbering()
    place = np.argsort(order)
    weights = asset.skinning_weights.numpy().astype(np.float64)[order]
    weights /= weights.sum(axis=1, keepdims=True)
    template = (vertices - joints[0])[order] + WRIST
    centres = joints - joints[0] + WRIST
    turn, _ = np.linalg.qr(rng.normal(size=(10, 10)))
    noise = rng.normal(size=(778, 3, 15, 9)) * weights[:, None, 1:, None]
    return {
        "v_template": template,
        "f": place[asset.faces.numpy()].astype(np.uint32),
        "shapedirs": asset.shape_directions.numpy().astype(np.float64)[order] @ turn,
        "posedirs": (2e-4 * noise).reshape(778, 3, 135),
        "J_regressor": _regressor(template, centres),
        "J": centres,
        "weights": weights,
        "kintree_table": np.array([[2**32 - 1, *PARENTS[1:]], range(16)], dtype=np.uint32),
        "hands_mean": 0.15 * rng.normal(size=45),
        "hands_components": np.linalg.qr(rng.normal(size=(45, 45)))[0],
        "hands_coeffs": rng.normal(size=(4, 45)),
        "betas": np.zeros(10),
    }


@cache
def _spread_hand() -> tuple[Float[np.ndarray, "vertex 3"], Float[np.ndarray, "joint 3"]]:
    """The open hand with straight fingers in the directions of MANO's at rest."""
    hand: HandModel = open_hand().double()
    angles = hand.rest_angles.clone()
    third = hand.joints_template[0] - hand.joints_template[4]
    axis = torch.atan2(-third[2], third[0])
    for finger, azimuth in AZIMUTHS.items():
        first = ARTICULATED.index(f"{finger} MCP")
        angles[first : first + 3] = 0.0
        angles[first, 1] = np.radians(azimuth) - axis
    posed = hand(angles, torch.zeros(10, dtype=torch.float64))
    return posed.vertices.numpy(), posed.joints.numpy()


@cache
def _manos_numbering() -> np.ndarray:
    """Index of the open hand's vertex for each of MANO's numbers."""
    asset = load_open_hand()
    vertices = asset.template.numpy()
    order = np.full(778, -1)
    order[list(RING_IDS)] = asset.wrist_ring.numpy()
    for landmark, numbers in zip(TIPS, TIP_IDS, strict=True):
        tip = int(asset.landmark_regressors["mano"][landmark, :778].argmax())
        nearest = np.argsort(np.linalg.norm(vertices - vertices[tip], axis=1))
        order[list(numbers)] = nearest[: len(numbers)]
    order[order < 0] = np.setdiff1d(np.arange(778), order)
    return order


def _regressor(
    template: Float[np.ndarray, "vertex 3"], joints: Float[np.ndarray, "joint 3"]
) -> Float[np.ndarray, "joint vertex"]:
    """Least-norm weights of the nearest 40 vertices that sum to one and reproduce each joint."""
    regressor = np.zeros((len(joints), len(template)))
    for joint, centre in enumerate(joints):
        nearest = np.argsort(np.linalg.norm(template - centre, axis=1))[:40]
        conditions = np.vstack([template[nearest].T, np.ones(40)])
        regressor[joint, nearest] = np.linalg.pinv(conditions) @ np.append(centre, 1.0)
    return regressor
