"""Reads and checks DexYCB's folders.

`<subject>/<sequence>/meta.yml`, `<subject>/<sequence>/<serial>/{color,labels}_000000.{jpg,npz}` and
`calibration/{intrinsics,mano_<id>}` (Chao et al., CVPR 2021). Names are those of NVlabs/dex-ycb-toolkit.
"""

import os
import re
import reprlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from hand_recon.reading.text import parse_yaml, read_text

SUBJECTS: Final = (
    "20200709-subject-01", "20200813-subject-02", "20200820-subject-03", "20200903-subject-04",
    "20200908-subject-05", "20200918-subject-06", "20200928-subject-07", "20201002-subject-08",
    "20201015-subject-09", "20201022-subject-10",
)  # fmt: skip
"""Folders of the subjects, in the toolkit's order."""

SERIALS: Final = (
    "836212060125", "839512060362", "840412060917", "841412060263",
    "932122060857", "932122060861", "932122061900", "932122062010",
)  # fmt: skip
"""Serial numbers of the cameras, in the toolkit's order."""

SEQUENCES: Final = 100
"""Number of sequences of a subject: 20 objects, each grasped five times."""

SIZE: Final = (480, 640)
"""Height and width of the images, pixels."""

_SEQUENCE_NAME: Final = re.compile(r"\d{8}_\d{6}")


_SHORT: Final = reprlib.Repr()
"""Abbreviates values for messages, to two levels of nested lists."""
_SHORT.maxlevel = 2


@dataclass(frozen=True)
class Grasp:
    """One sequence: a subject's hand seen by all cameras."""

    subject: int
    """Index of its subject in `SUBJECTS`."""
    index: int
    """Index among its subject's sorted sequences, which decides its split."""
    folder: Path
    """Folder of its `meta.yml`."""
    frames: int
    """Number of frames of each camera."""
    left: bool
    """True for a left hand; only `meta.yml` has the side."""
    calibration: str
    """Name of the hand's shape calibration; a subject has several."""


def image_path(grasp: Grasp, camera: int, frame: int) -> Path:
    """Image file of a frame."""
    return grasp.folder / SERIALS[camera] / image_name(frame)


def image_name(frame: int) -> str:
    """File name of a frame's image in each camera's folder."""
    return f"color_{frame:06d}.jpg"


def label_path(folder: Path, frame: int) -> Path:
    """Label file of a frame.

    Args:
        folder: Folder of one camera in one sequence.
        frame: Number of the frame.
    """
    return folder / f"labels_{frame:06d}.npz"


def find_root(root: Path | str | None) -> Path:
    """Find the dataset's folder.

    Raises:
        FileNotFoundError: No folder was given, or it is not DexYCB's.
    """
    if root is None or not str(root):
        raise FileNotFoundError(
            "No folder of DexYCB: give data.root=/path/to/dex-ycb, or set DEX_YCB_DIR as its toolkit "
            "wants (data/README.md says where to get it). data=synthetic needs no files."
        )
    folder = Path(root).expanduser()
    if not folder.is_dir():
        raise FileNotFoundError(
            f"No folder {folder}. Unpack DexYCB there, or set data.root or DEX_YCB_DIR to the folder that "
            f"holds {SUBJECTS[0]} (data/README.md says where to get it). data=synthetic needs no files."
        )
    if any((folder / name).is_dir() for name in SUBJECTS):
        return folder
    nested = sorted({path.parent for name in SUBJECTS for path in folder.glob(f"*/{name}")})
    above = [path for path in (folder.parent, folder.parent.parent) if folder.name and _holds(path)]
    for elsewhere in (*nested, *above):
        raise FileNotFoundError(
            f"{folder} holds no subject of DexYCB, but {elsewhere} does: set data.root={elsewhere}."
        )
    raise FileNotFoundError(
        f"{folder} holds no subject of DexYCB; expected {SUBJECTS[0]}, {SUBJECTS[1]} and so on, and "
        "calibration beside them. Unpack the archives into it."
    )


def present(root: Path, subjects: Sequence[int]) -> list[int]:
    """Subjects whose folders are there."""
    return [subject for subject in subjects if (root / SUBJECTS[subject]).is_dir()]


def read_grasps(root: Path, subject: int) -> list[Grasp]:
    """All sequences of a subject, sorted by name as the splits count them.

    Raises:
        FileNotFoundError: A sequence is missing; the indices of all later ones would be wrong.
        ValueError: There are too many, or a `meta.yml` is not DexYCB's.
    """
    folder = root / SUBJECTS[subject]
    with os.scandir(folder) as entries:
        names = sorted(e.name for e in entries if _SEQUENCE_NAME.fullmatch(e.name) and e.is_dir())
    if len(names) != SEQUENCES:
        raise (FileNotFoundError if len(names) < SEQUENCES else ValueError)(
            f"{folder} holds {len(names)} sequences named like 20200709_141754, expected {SEQUENCES}: the "
            "position of each in their order decides its split. Unpack the subject's archive again."
        )
    return [_read_grasp(folder / name, subject, index) for index, name in enumerate(names)]


def read_intrinsics(root: Path) -> Float[np.ndarray, "camera=8 3 3"]:
    """Colour cameras' matrices, pixels of the whole image, in the order of `SERIALS`.

    Raises:
        FileNotFoundError: A file is missing.
        ValueError: A file does not describe a camera.
    """
    matrices = np.tile(np.eye(3), (len(SERIALS), 1, 1))
    height, width = SIZE
    for camera, serial in enumerate(SERIALS):
        path = root / "calibration" / "intrinsics" / f"{serial}_{width}x{height}.yml"
        colour = _entry(path, _read_yaml(path), "color")
        focal = [_number(path, colour, name) for name in ("fx", "fy")]
        centre = [_number(path, colour, name) for name in ("ppx", "ppy")]
        if min(focal) <= 1:
            raise ValueError(f"{path} has focal lengths {focal}; expected pixels, about 600.")
        matrices[camera, [0, 1], [0, 1]], matrices[camera, :2, 2] = focal, centre
    return matrices


def read_betas(root: Path, calibration: str) -> Float[np.ndarray, " direction=10"]:
    """MANO's shape of a calibrated hand, standard deviations.

    Raises:
        FileNotFoundError: There is no such calibration.
        ValueError: It has not ten numbers.
    """
    path = root / "calibration" / f"mano_{calibration}" / "mano.yml"
    given = _entry(path, _read_yaml(path), "betas")
    try:
        betas = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"{path} has betas {_SHORT.repr(given)}, expected ten numbers.") from error
    if betas.shape != (10,):
        raise ValueError(f"{path} has betas of shape {list(betas.shape)}, expected ten numbers.")
    return betas


def _holds(folder: Path) -> bool:
    return any((folder / name).is_dir() for name in SUBJECTS)


def _read_grasp(folder: Path, subject: int, index: int) -> Grasp:
    path = folder / "meta.yml"
    meta = _read_yaml(path)
    frames, sides = _entry(path, meta, "num_frames"), _entry(path, meta, "mano_sides")
    calibrations = _entry(path, meta, "mano_calib")
    if not (isinstance(frames, int) and frames >= 0):
        raise ValueError(f"{path} has num_frames: {frames!r}, expected a whole number.")
    if not isinstance(sides, list) or not sides or sides[0] not in ("left", "right"):
        raise ValueError(f"{path} has mano_sides: {sides!r}, expected [right] or [left].")
    if (
        not isinstance(calibrations, list)
        or not calibrations
        or not isinstance(calibrations[0], str)
    ):
        raise ValueError(f"{path} has mano_calib: {calibrations!r}, expected the name of one.")
    return Grasp(subject, index, folder, frames, sides[0] == "left", calibrations[0])


def _read_yaml(path: Path) -> dict[str, Any]:
    try:
        content = parse_yaml(read_text(path, "utf-8"), path)
    except FileNotFoundError as error:
        raise FileNotFoundError(
            f"No {path}. It is part of DexYCB: unpack "
            f"{'calibration.tar.gz' if 'calibration' in path.parts else 'the archive of its subject'} again."
        ) from error
    except ValueError as error:
        raise ValueError(
            f"{path} is not YAML ({error.__cause__ or error}); unpack its archive again."
        ) from error
    if not isinstance(content, dict):
        # An alias makes a list of a few bytes endless to write out.
        shown = _SHORT.repr(content)
        raise ValueError(f"{path} holds {shown}, expected names and values; unpack it again.")
    return content


def _entry(path: Path, content: object, name: str) -> Any:  # noqa: ANN401  # whatever YAML holds
    if not isinstance(content, dict) or name not in content:
        shown = _SHORT.repr(list(content) if isinstance(content, dict) else content)
        raise ValueError(f"{path} has no {name!r}; it has {shown}. Unpack it again.")
    return content[name]


def _number(path: Path, content: object, name: str) -> float:
    value = _entry(path, content, name)
    # A whole number may be larger than any double.
    if not isinstance(value, int | float) or not abs(value) < 1e300:
        raise ValueError(f"{path} has {name}: {value!r:.80}, expected a number.")
    return float(value)
