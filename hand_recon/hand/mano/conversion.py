"""Conversion of the user's MANO download to files that hold only numbers (`store.py`).

No code in the download is run (`pickle_file.py`), nothing is unpacked to disk, and MANO's numbers are written
only to the folder that the user names.
"""

import hashlib
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from hand_recon.hand.mano.inert_pickle import RefusedPickleError
from hand_recon.hand.mano.pickle_file import MAX_BYTES, load_pickle, to_array
from hand_recon.hand.mano.store import (
    ManoArrays,
    ManoFile,
    Side,
    file_name,
    left_shape_of,
    read_file,
    write_mano,
)
from hand_recon.hand.skeleton import PARENTS
from hand_recon.reading.archives import opened_zip

WANTED: Final = "mano_v1_2.zip, or MANO_RIGHT.pkl and MANO_LEFT.pkl from the models folder in it"

KEYS: Final = {
    "template": "v_template",
    "shape_directions": "shapedirs",
    "pose_directions": "posedirs",
    "joint_regressor": "J_regressor",
    "skinning_weights": "weights",
    "faces": "f",
    "hands_mean": "hands_mean",
    "hands_components": "hands_components",
}
"""Names of the arrays in MANO's pickle; `kintree_table` is checked too, other entries are not read."""

SHAPES: Final = {
    "v_template": (778, 3),
    "f": (1538, 3),
    "posedirs": (778, 3, 135),
    "J_regressor": (16, 778),
    "weights": (778, 16),
    "hands_mean": (45,),
    "hands_components": (45, 45),
    "kintree_table": (2, 16),
}

OTHER_MODELS: Final = {
    6890: "SMPL or SMPL+H, a body",
    10475: "SMPL-X, a body",
    5023: "FLAME, a head",
}
"""Other models, recognised by their number of vertices."""


def prepare_mano(source: Path, folder: Path) -> list[Path]:
    """Convert the hands in a download and write one file for each.

    The left hand's shape directions are stored unchanged, together with their state (`LeftShape`);
    `load_mano` decides whether to correct them.

    Args:
        source: `mano_v1_2.zip`, one of its pickles, or such a pickle saved again without chumpy.
        folder: Folder for `MANO_RIGHT.safetensors` and `MANO_LEFT.safetensors`.

    Returns:
        Paths of the files, including those that already existed with the same content.

    Raises:
        FileNotFoundError: The source does not exist.
        ValueError: The source is another kind of file, or a pickle that names functions MANO does not use.
        FileExistsError: The folder holds another hand under that name.
    """
    files = {}
    for name, data in _pickles_of(source):
        file = convert_pickle(data, name)
        files[file.side] = file
    right = files.get("right")
    right_path = folder / file_name("right")
    if right is None and right_path.is_file():
        right = read_file(right_path)
    if "left" in files:
        state = left_shape_of(files["left"].arrays, None if right is None else right.arrays)
        files["left"] = replace(files["left"], left_shape=state)
    paths = []
    for side, file in sorted(files.items(), reverse=True):
        paths.append(folder / file_name(side))
        write_mano(file, paths[-1])
    return paths


def convert_pickle(data: bytes, name: str) -> ManoFile:
    """Read and check one of MANO's pickles.

    Args:
        data: Content of the pickle.
        name: File name, for messages and to check the side.

    Raises:
        ValueError: The content is not a MANO hand, or is damaged.
    """
    found = _arrays_of(load_pickle(data, name), name)
    _check_shapes(found, name)
    _check_numbers(found, name)
    template, regressor = found["v_template"], found["J_regressor"]
    side = _side_of(regressor @ template, name)
    faces = _outward(template, found["f"].astype(np.int64))
    arrays = ManoArrays(
        template=template,
        shape_directions=found["shapedirs"][..., :10],
        pose_directions=found["posedirs"],
        joint_regressor=regressor,
        skinning_weights=found["weights"],
        faces=faces,
        wrist_ring=wrist_ring_of(faces, name),
        hands_mean=found["hands_mean"],
        hands_components=found["hands_components"],
    )
    return ManoFile(
        arrays=arrays,
        side=side,
        source_sha256=hashlib.sha256(data).hexdigest(),
        left_shape="released" if side == "right" else "unknown",
    )


def wrist_ring_of(faces: Int[np.ndarray, "face 3"], name: str) -> Int[np.ndarray, " ring=16"]:
    """Vertices of the open boundary in the order in which a cap's triangles go round it, lowest index first.

    Raises:
        ValueError: The open edges are not one ring of 16.
    """
    edges = {
        (int(a), int(b)) for face in faces for a, b in zip(face, np.roll(face, -1), strict=True)
    }
    following = {b: a for a, b in edges if (b, a) not in edges}
    ring = [min(following, default=-1)]
    while len(ring) <= len(following) and following.get(ring[-1], ring[0]) != ring[0]:
        ring.append(following[ring[-1]])
    if len(ring) != 16 or len(following) != 16:
        raise ValueError(
            f"{name}: the surface has {len(following)} open edges, of which {len(ring)} make a ring; "
            "expected one ring of 16 at the wrist. The faces are not MANO's."
        )
    return np.array(ring)


def _pickles_of(source: Path) -> Iterator[tuple[str, bytes]]:
    """Names and contents of the pickles to convert."""
    if not source.is_file():
        raise FileNotFoundError(f"No file {source.absolute()}. Expected {WANTED}.")
    if not zipfile.is_zipfile(source):
        if source.stat().st_size > MAX_BYTES:
            raise ValueError(f"{source} is larger than any MANO file. Expected {WANTED}.")
        yield str(source), source.read_bytes()
        return
    with opened_zip(source, source) as archive:
        entries = archive.infolist()
        if entries and all(entry.filename.endswith(".npy") for entry in entries):
            raise ValueError(
                f"{source} is an archive of NumPy arrays {[entry.filename for entry in entries][:5]}, "
                f"such as mano_mean_params.npz, and not the hand model. Expected {WANTED}."
            )
        hands = [entry for entry in entries if _is_hand(entry.filename)]
        if not hands or len({PurePosixPath(entry.filename).name for entry in hands}) < len(hands):
            raise ValueError(
                f"{source} holds {[entry.filename for entry in hands] or 'no MANO_RIGHT.pkl'}, expected "
                f"one MANO_RIGHT.pkl and one MANO_LEFT.pkl. Use {WANTED}."
            )
        for entry in hands:
            if entry.file_size > MAX_BYTES:
                raise ValueError(
                    f"{entry.filename} in {source} has {entry.file_size} bytes, expected at most "
                    f"{MAX_BYTES}. Download MANO again."
                )
            yield f"{source}/{entry.filename}", archive.read(entry)


def _is_hand(filename: str) -> bool:
    # Archives made on macOS hold a second entry for every file, in the folder __MACOSX.
    path = PurePosixPath(filename)
    return path.name in ("MANO_RIGHT.pkl", "MANO_LEFT.pkl") and "__MACOSX" not in path.parts


def _arrays_of(content: dict[str, object], name: str) -> dict[str, np.ndarray]:
    """Extract the arrays of `KEYS`, or raise an error that says what the file holds instead."""
    missing = [key for key in (*KEYS.values(), "kintree_table") if key not in content]
    vertices = 0
    if "v_template" in content:
        vertices = _array(content["v_template"], "v_template", name).shape[0]
    if missing or vertices != 778:
        found = f"holds {sorted(content)[:12]}"
        if vertices and vertices != 778:
            found = f"is {OTHER_MODELS.get(vertices, 'another model')} ({vertices} vertices)"
        elif missing:
            found += f" without {missing}"
        raise ValueError(f"{name} {found}: not MANO's hand. Expected {WANTED}.")
    wanted = (*KEYS.values(), "kintree_table")
    return {key: _array(content[key], key, name) for key in wanted}


def _array(value: object, key: str, name: str) -> np.ndarray:
    try:
        array = to_array(value)
        return array if key in ("f", "kintree_table") else array.astype(np.float64)
    except (TypeError, ValueError, ArithmeticError) as error:
        raise RefusedPickleError(f"{name}: {key}: {error}; expected MANO's array.") from error


def _check_shapes(found: dict[str, np.ndarray], name: str) -> None:
    """Raise an error if an array does not have MANO's shape."""
    shapes = {key: found[key].shape for key in SHAPES}
    wrong = {key: shape for key, shape in shapes.items() if shape != SHAPES[key]}
    shape_directions = found["shapedirs"].shape
    if shape_directions[:2] != (778, 3) or len(shape_directions) != 3 or shape_directions[2] < 10:
        wrong["shapedirs"] = shape_directions
    if wrong:
        expected = {key: SHAPES.get(key, (778, 3, "10 or more")) for key in wrong}
        raise ValueError(f"{name}: the arrays are of shapes {wrong}, expected {expected}.")


def _check_numbers(found: dict[str, np.ndarray], name: str) -> None:
    """Raise an error if the numbers are not finite or the skeleton, weights or faces are not MANO's."""
    for key, array in found.items():
        if not np.isfinite(array).all():
            raise ValueError(
                f"{name}: {key} holds numbers that are not finite. Download MANO again."
            )
    if (found["kintree_table"][0, 1:].astype(np.int64) != PARENTS[1:]).any():
        raise ValueError(
            f"{name}: the joints' parents are {found['kintree_table'][0].tolist()}, expected "
            f"{list(PARENTS)}: the order of joints is not MANO's."
        )
    for key, tolerance in (("weights", 1e-3), ("J_regressor", 1e-2)):
        error = float(np.abs(found[key].sum(axis=1) - 1).max())
        if error > tolerance:
            raise ValueError(
                f"{name}: rows of {key} miss a sum of one by {error:.3g}, expected at most "
                f"{tolerance}. Download MANO again."
            )
    if found["f"].min() < 0 or found["f"].max() >= 778:
        raise ValueError(
            f"{name}: faces have vertex indices from {found['f'].min()} to {found['f'].max()}, "
            "expected 0 to 777. Download MANO again."
        )


def _side_of(joints: Float[np.ndarray, "joint=16 3"], name: str) -> Side:
    """Determine the side: a right hand's fingers point to −x at rest, a left hand's to +x.

    Raises:
        ValueError: The file is named as the other side.
    """
    side: Side = "right" if joints[1:, 0].mean() < joints[0, 0] else "left"
    other = "left" if side == "right" else "right"
    own_name = PurePosixPath(name.replace("\\", "/")).name.lower()
    if other in own_name and side not in own_name:
        raise ValueError(
            f"{name} is named as the {other} hand, but its fingers point as the {side} one's: "
            "a mirrored or renamed file. Take the files from MANO's own download."
        )
    return side


def _outward(
    template: Float[np.ndarray, "vertex 3"], faces: Int[np.ndarray, "face 3"]
) -> Int[np.ndarray, "face 3"]:
    """Order the triangles' corners counter-clockwise from outside, so that the signed volume is positive."""
    corners = (template - template.mean(axis=0))[faces]
    volume = np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    return faces if volume > 0 else faces[:, ::-1].copy()
