"""Reading and writing of converted MANO files: one safetensors file per hand, numbers only, no code.

`conversion.py` writes the files from the user's own MANO (Romero et al., SIGGRAPH Asia 2017), and `hand.py`
reads them. MANO's licence forbids redistribution, so its numbers are in no repository and no checkpoint.
"""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Final, Literal, cast

import numpy as np
from jaxtyping import Float, Int
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

Side = Literal["right", "left"]

LeftShape = Literal["released", "corrected", "unknown"]
"""State of a left hand's shape directions: as released (not mirrored), corrected (mirrored), or unknown."""

FORMAT: Final = "hand_recon MANO 1"
"""File format; its number increases when the arrays in the file change."""


@dataclass(frozen=True)
class ManoArrays:
    """Arrays of one MANO hand, in MANO's order of joints and vertices and in its frame."""

    template: Float[np.ndarray, "vertex=778 3"]
    """Mean surface at rest, metres."""
    shape_directions: Float[np.ndarray, "vertex=778 3 direction=10"]
    """Displacement of the surface per standard deviation, metres; a left hand's as in its file."""
    pose_directions: Float[np.ndarray, "vertex=778 3 rotation=135"]
    """Displacement of the surface per entry of R − I, metres."""
    joint_regressor: Float[np.ndarray, "joint=16 vertex=778"]
    """Weights that give the rotation centres from the surface at rest."""
    skinning_weights: Float[np.ndarray, "vertex=778 joint=16"]
    """Weight of each joint's motion at each vertex; rows sum to one."""
    faces: Int[np.ndarray, "face=1538 3"]
    """Triangles, counter-clockwise from outside, open at the wrist."""
    wrist_ring: Int[np.ndarray, " ring=16"]
    """Vertices of the open boundary, in the order in which the triangles of a cap go round it."""
    hands_mean: Float[np.ndarray, " angle=45"]
    """Mean pose, axis angles, radians."""
    hands_components: Float[np.ndarray, "component=45 angle=45"]
    """Pose components about the mean pose, one per row, radians."""


_ENTRIES: Final = {"side", "source_sha256", "left_shape_directions"}
"""Further entries of a file's metadata."""


@dataclass(frozen=True)
class ManoFile:
    """One MANO hand and its origin."""

    arrays: ManoArrays
    """Arrays of the hand."""
    side: Side
    """Right or left."""
    source_sha256: str
    """SHA-256 of the pickle that was converted."""
    left_shape: LeftShape
    """State of a left hand's shape directions; `released` for right hands, which need no correction."""


def file_name(side: Side) -> str:
    """File name of a hand."""
    return f"MANO_{side.upper()}.safetensors"


def write_mano(file: ManoFile, path: Path) -> None:
    """Write a hand; an existing file with the same arrays is left unchanged.

    Raises:
        FileExistsError: The file exists with other arrays.
    """
    if path.exists():
        if _same(read_file(path).arrays, file.arrays):
            return
        raise FileExistsError(
            f"{path} holds another hand than the one to write. Nothing was changed: move that file "
            "away, or choose another folder."
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    arrays = {name: np.ascontiguousarray(array) for name, array in vars(file.arrays).items()}
    metadata = {
        "format": FORMAT,
        "side": file.side,
        "source_sha256": file.source_sha256,
        "left_shape_directions": file.left_shape,
    }
    # Writing to another name and renaming leaves no incomplete file if the process is killed.
    partial = path.with_name(f"{path.name}.partial")
    save_file(arrays, partial, metadata=metadata)
    partial.rename(path)


def read_mano(path: Path | str, side: Side = "right") -> ManoFile:
    """Read one hand.

    Args:
        path: Folder with `MANO_RIGHT.safetensors` or `MANO_LEFT.safetensors`, or such a file.
        side: Side to read.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is in another format, or holds the other hand.
    """
    path = Path(path).expanduser()
    found = path / file_name(side) if path.is_dir() or not path.suffix else path
    if not found.is_file():
        raise FileNotFoundError(_missing(found, side))
    file = read_file(found)
    if file.side != side:
        raise ValueError(f"{found} is MANO's {file.side} hand; expected the {side} one.")
    return file


def read_file(path: Path) -> ManoFile:
    """Read a file written by `write_mano`.

    Raises:
        ValueError: The file is in another format.
    """
    try:
        with safe_open(path, framework="numpy") as stored:
            metadata = stored.metadata() or {}
            found = {name: stored.get_tensor(name) for name in stored.keys()}  # noqa: SIM118
    except SafetensorError as error:
        metadata, found = {"format": f"unreadable by safetensors ({error})"}, {}
    known = found.keys() == {f.name for f in fields(ManoArrays)} and metadata.keys() >= _ENTRIES
    if metadata.get("format") != FORMAT or not known:
        raise ValueError(
            f"{path} is of the format {metadata.get('format')!r}, expected {FORMAT!r}. Make the file "
            f"with `python -m hand_recon.prepare mano <your file>`, from {_wanted()}."
        )
    return ManoFile(
        arrays=ManoArrays(**found),
        side=cast(Side, metadata["side"]),
        source_sha256=metadata["source_sha256"],
        left_shape=cast(LeftShape, metadata["left_shape_directions"]),
    )


def left_shape_of(left: ManoArrays, right: ManoArrays | None) -> LeftShape:
    """Compare a left hand's shape directions with the right hand's: released, corrected or unknown.

    The released left hand's directions have the same x components as the right hand's instead of mirrored
    ones, so equal coefficients give different shapes (vchoutas/smplx issue 48). Without the right hand the
    state is unknown.
    """
    if right is None:
        return "unknown"
    own, other = left.shape_directions[:, 0], right.shape_directions[:, 0]
    same, mirrored = np.abs(own - other).sum(), np.abs(own + other).sum()
    if min(same, mirrored) > 0.1 * np.abs(other).sum():
        return "unknown"
    return "released" if same < mirrored else "corrected"


def _same(first: ManoArrays, second: ManoArrays) -> bool:
    pairs = zip(vars(first).values(), vars(second).values(), strict=True)
    return all(np.array_equal(one, other) for one, other in pairs)


def _wanted() -> str:
    return "mano_v1_2.zip, MANO_RIGHT.pkl or MANO_LEFT.pkl"


def _missing(path: Path, side: Side) -> str:
    return (
        f"No MANO hand at {path.absolute()}. Each user needs MANO's licence: get "
        f"{_wanted()} from mano.is.tue.mpg.de and run `python -m hand_recon.prepare mano <that file>`. "
        f"It reads the {side} hand without running any code in the file, checks it, and writes {path.name}. "
        "Set HAND_RECON_MANO or hand.path for another folder; hand=open needs no licence."
    )
