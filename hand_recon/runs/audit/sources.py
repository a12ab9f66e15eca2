"""Hands to audit, read from files of any origin and told apart by their content."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import torch

from hand_recon.fitting.hand_records import HandRecords
from hand_recon.fitting.hands_file import read_hands
from hand_recon.hand.model import HandModel
from hand_recon.plausibility.given_hands import GivenCamera, GivenHands, joined_hands, of_points
from hand_recon.reading.naming import naming
from hand_recon.runs.audit.arrays import read_npy, read_npz
from hand_recon.runs.audit.mano import ManoReader
from hand_recon.runs.audit.metas import read_meta_hand
from hand_recon.runs.audit.tables import read_table
from hand_recon.runs.audit.texts import holds_hands, read_json, read_lines
from hand_recon.schema import HandParameters

SUFFIXES: Final = (".json", ".jsonl", ".npz", ".npy", ".csv", ".pkl", ".zip", ".txt")
"""Files that are read."""

OUR_TABLES: Final = frozenset(
    {"audit.json", "audit.csv", "hands.csv", "landmarks.csv", "images.csv", "metrics.json"}
)
"""Files that our commands write beside hands; they are left out in folders."""

PICKLES: Final = (".pth", ".pt", ".joblib", ".pickle")
"""Files that would have to be unpickled, which may run code."""


@dataclass(frozen=True)
class Reading:
    """Settings of reading."""

    sequence: bool = False
    """True if the hands of each file and side are the frames of one hand."""
    same_person: bool = False
    """True if all hands of a file and side are one person's hand."""
    fps: float = 30.0
    """Frames per second of sequences without times, those of tracks too."""


def read_given(
    names: Sequence[str | Path], hand: HandModel, mano: Path | None, reading: Reading
) -> GivenHands:
    """Read all hands of files.

    Args:
        names: Files, and folders with them.
        hand: The configured hand.
        mano: Folder of MANO's files; None without `hand=mano`.
        reading: Settings.

    Raises:
        FileNotFoundError: A file is missing, or a folder has none that is read.
        ValueError: A file has another form; the message says what was found.
    """
    reader = None if mano is None else ManoReader(hand, mano)
    parts = []
    for path in _files(names):
        with naming(path, "3D hands"):
            parts.append(_read(path, reader, reading.fps))
        if parts[-1].points.isinf().any():
            raise ValueError(
                f"{path} has infinite coordinates; expected metres, and nan or null for a point that is "
                "missing. Correct these hands."
            )
    return _in_sequences(joined_hands(parts), reading)


def _files(names: Sequence[str | Path]) -> list[Path]:
    found: list[Path] = []
    for name in names:
        path = Path(name).expanduser()
        if path.is_dir():
            # A folder of results has its hands in one file, and tables of the same hands beside it.
            inside = [path / "hands.json", path / "hands.jsonl"]
            inside = [one for one in inside if one.is_file()] or sorted(
                one
                for one in path.rglob("*")
                if one.suffix.lower() in SUFFIXES and one.name not in OUR_TABLES
            )
            if not inside:
                raise FileNotFoundError(
                    f"{path} holds no file of hands; expected one with {', '.join(SUFFIXES)}."
                )
            found += inside
        elif path.is_file():
            found.append(path)
        else:
            raise FileNotFoundError(
                f"No file of hands at {path}. Give hands.json, pred.json, npz, npy or csv, or a folder."
            )
    return found


def _read(path: Path, mano: ManoReader | None, fps: float) -> GivenHands:
    suffix = path.suffix.lower()
    if suffix in PICKLES:
        raise ValueError(
            f"{path} is a pickle, which may run code when it is read: not read. Save its arrays with "
            "numpy.savez and give the npz."
        )
    if suffix not in SUFFIXES:
        raise ValueError(
            f"{path} has the suffix {suffix or 'none'}; expected one of {', '.join(SUFFIXES)}."
        )
    if suffix == ".jsonl" or (suffix == ".json" and holds_hands(path)):
        return of_records(read_hands(path), str(path))
    with_mano = {".pkl": read_meta_hand, ".npz": read_npz, ".json": read_json, ".zip": read_json}
    if suffix in with_mano:
        found = with_mano[suffix](path, mano)
        # Times of arrays are numbers of frames.
        return replace(found, times=found.times / fps)
    without = {".txt": read_lines, ".npy": read_npy, ".csv": read_table}
    found = without[suffix](path)
    return replace(found, times=found.times / fps)


def of_records(hands: HandRecords, file: str) -> GivenHands:
    """Hands of a file of hands; those that were not fitted have landmarks and angles of NaN.

    Args:
        hands: Records of the file.
        file: The file.
    """
    left = [side == "left" for side in hands.sides]
    given = of_points(
        torch.from_numpy(hands.landmarks_3d), file, names=_distinct(hands.names), left=left,
        sides=hands.sides,
    )  # fmt: skip
    mirror = np.where(np.array(left)[:, None], [-1.0, 1.0, 1.0], 1.0)
    # A left hand's model is the right one's with x → −x.
    rotation = mirror[:, :, None] * hands.root_rotation * mirror[:, None]
    parameters = HandParameters(
        torch.from_numpy(np.radians(hands.joint_angles_degrees)).float(),
        torch.from_numpy(hands.shape).float(),
        torch.from_numpy(rotation).float(),
        torch.from_numpy(mirror * hands.translation).float(),
    )
    moments = hands.moments
    return replace(
        given,
        parameters=parameters,
        hand_models=hands.hand_models,
        sequences=tuple("" if one is None else f"{file} hand {one.hand}" for one in moments),
        times=torch.tensor([torch.nan if one is None else one.time for one in moments]),
        moments=moments,
        cameras=tuple(
            None if source is None else GivenCamera(matrix, source, image, size)
            for matrix, source, image, size in zip(
                hands.intrinsics, hands.cameras, hands.images, hands.image_sizes, strict=True
            )
        ),
    )


def _distinct(names: Sequence[str]) -> tuple[str, ...]:
    """Names with a number behind those that occur more than once."""
    seen: dict[str, int] = {}
    found = []
    for name in names:
        seen[name] = seen.get(name, 0) + 1
        found.append(name if seen[name] == 1 else f"{name} ({seen[name]})")
    return tuple(found)


def _in_sequences(hands: GivenHands, reading: Reading) -> GivenHands:
    """Take the hands of each file and side as one sequence, or as one person's, if the settings say so."""
    if not (reading.sequence or reading.same_person):
        return hands
    names, times, frames = list(hands.sequences), hands.times.clone(), dict[str, int]()
    for row, name in enumerate(names):
        if name:
            continue
        # The left and the right hand of a person are two sequences.
        names[row] = f"{hands.files[row]} {hands.sides[row]}".strip()
        if not reading.sequence:
            continue
        frame = frames.get(names[row], 0)
        frames[names[row]] = frame + 1
        times[row] = frame / reading.fps
    return replace(hands, sequences=tuple(names), times=times)
