"""MANO as this project keeps it: one safetensors file per hand, which holds numbers and no code.

The user's own MANO (Romero et al., SIGGRAPH Asia 2017) goes in by `mano_conversion.py` and out by
`mano.py`; its licence lets nobody pass the numbers on, so they are in no repository and no checkpoint.
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
"""Whether a left hand's shape directions are MANO's own, which forgot the mirror, or mended ones."""

FORMAT: Final = "hand_recon MANO 1"
"""Goes up when the arrays of the file change."""


@dataclass(frozen=True)
class ManoArrays:
    """MANO's numbers as its file has them, in its order of joints and vertices and in its frame."""

    template: Float[np.ndarray, "vertex=778 3"]
    """Mean surface at rest, metres."""
    shape_directions: Float[np.ndarray, "vertex=778 3 direction=10"]
    """Displacement of the surface per standard deviation, metres; the left hand's as in the file."""
    pose_directions: Float[np.ndarray, "vertex=778 3 rotation=135"]
    """Displacement of the surface per entry of R − I, metres."""
    joint_regressor: Float[np.ndarray, "joint=16 vertex=778"]
    """Rotation centres from the surface at rest."""
    skinning_weights: Float[np.ndarray, "vertex=778 joint=16"]
    """Rows sum to one."""
    faces: Int[np.ndarray, "face=1538 3"]
    """Counter-clockwise from outside, open at the wrist."""
    wrist_ring: Int[np.ndarray, " ring=16"]
    """The open boundary in the order in which a cap's triangles traverse it."""
    hands_mean: Float[np.ndarray, " angle=45"]
    """The mean pose, axis angles, radians."""
    hands_components: Float[np.ndarray, "component=45 angle=45"]
    """Directions of pose about the mean, one per row, radians."""


@dataclass(frozen=True)
class ManoFile:
    """One hand of MANO and where it came from."""

    arrays: ManoArrays
    """The numbers."""
    side: Side
    """Which hand."""
    source_sha256: str
    """Of the pickle that it was made from."""
    left_shape: LeftShape
    """Of a left hand; `released` for right hands, which need no mending."""


def file_name(side: Side) -> str:
    """What a hand's file is called in its folder."""
    return f"MANO_{side.upper()}.safetensors"


def write_mano(file: ManoFile, path: Path) -> None:
    """Write a hand; a file of the same numbers is left as it is.

    Raises:
        FileExistsError: There is a file of other numbers.
    """
    if path.exists():
        if _same(read_file(path).arrays, file.arrays):
            return
        raise FileExistsError(
            f"{path} holds another hand than the one to be written. Nothing was changed: move it "
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
    # Written under another name and renamed: a run that is killed leaves no half file.
    partial = path.with_name(f"{path.name}.partial")
    save_file(arrays, partial, metadata=metadata)
    partial.rename(path)


def read_mano(path: Path | str, side: Side = "right") -> ManoFile:
    """Read one hand.

    Args:
        path: A folder with `MANO_RIGHT.safetensors` or `MANO_LEFT.safetensors`, or such a file.
        side: Which hand is wanted.

    Raises:
        FileNotFoundError: It is not there.
        ValueError: The file is none of this project's, or of the other hand.
    """
    path = Path(path).expanduser()
    found = path / file_name(side) if path.is_dir() or not path.suffix else path
    if not found.is_file():
        raise FileNotFoundError(_missing(found, side))
    file = read_file(found)
    if file.side != side:
        raise ValueError(f"{found} is MANO's {file.side} hand; wanted was the {side} one.")
    return file


def read_file(path: Path) -> ManoFile:
    """Read a file that `write_mano` wrote.

    Raises:
        ValueError: It is another kind of file.
    """
    try:
        with safe_open(path, framework="numpy") as stored:
            metadata = stored.metadata() or {}
            found = {name: stored.get_tensor(name) for name in stored.keys()}  # noqa: SIM118
    except SafetensorError as error:
        metadata, found = {"format": f"none that safetensors can read ({error})"}, {}
    if metadata.get("format") != FORMAT or found.keys() != {f.name for f in fields(ManoArrays)}:
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
    """Whether the shape directions of a left hand mirror the right one's.

    In the files of the release they point the same way in x, so the same shape is another hand on the
    left (vchoutas/smplx issue 48). Only beside the right hand can this be told.
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
        f"No MANO hand at {path.absolute()}. MANO is licensed to each user by its makers: get "
        f"{_wanted()} from mano.is.tue.mpg.de and run `python -m hand_recon.prepare mano <that file>`. "
        f"It reads the {side} hand without running anything in the file, checks it, and writes {path.name}. "
        "HAND_RECON_MANO or hand.path names another folder. hand=open needs no licence."
    )
