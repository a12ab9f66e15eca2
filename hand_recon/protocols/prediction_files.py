"""Readers of prediction files and their ground truth, in the benchmarks' own formats (Sec. 4.1).

FreiHAND and HO3D take `pred.json`, or a zip of it; DexYCB takes text, one line of an id and 63 numbers
for each image. Deviations that the official server would refuse are read with a remark.
"""

import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from hand_recon.evaluation.finite import require_finite
from hand_recon.evaluation.scores import HandPoints
from hand_recon.protocols.benchmarks import UNITS, Protocol
from hand_recon.protocols.prediction_json import (
    MAX_BYTES,
    PointLists,
    read_point_list,
    read_point_lists,
)
from hand_recon.reading.archives import opened_zip
from hand_recon.reading.naming import naming
from hand_recon.reading.text import read_bytes

COLUMNS: Final = 64
"""Numbers on a line of DexYCB's text: the id, then three coordinates of 21 landmarks."""

LONGEST: Final = 64
"""Most characters of an entry of DexYCB's text; a double needs 25."""

MESH: Final = 778
"""Number of vertices that the official scripts expect: MANO's."""

ABSENT: Final = -1.0
"""Value of every coordinate of a hand without annotation in DexYCB."""


@dataclass(frozen=True)
class PointFile:
    """Points of a file, in the file's own order, axes and unit."""

    points: HandPoints
    """Landmarks in double precision; vertices, where there are some, in single precision."""
    ids: Int[Tensor, " hand"]
    """Id of each frame: its position in the file, or the id in DexYCB's text."""
    remarks: tuple[str, ...] = ()
    """Deviations that the official server would refuse, and what was left out."""


@dataclass(frozen=True)
class Pair:
    """Predictions and ground truth of the same frames, in the protocol's order, axes and unit."""

    ground_truth: HandPoints
    """True points."""
    prediction: HandPoints
    """Predicted points; vertices only where both files have them."""
    remarks: tuple[str, ...]
    """Remarks on the files for the user."""
    predicted_vertices: Tensor | None = None
    """Predicted vertices even where there is no ground truth of them."""


def read_pair(predictions: Path, ground_truth: Path, protocol: Protocol) -> Pair:
    """Read predictions and ground truth and match their frames.

    Raises:
        FileNotFoundError: A file does not exist.
        ValueError: A file has another format, or the two do not have the same frames.
    """
    expected = read_ground_truth(ground_truth, protocol)
    found = read_predictions(predictions, protocol)
    remarks = list(expected.remarks + found.remarks)
    if protocol.is_text:
        found = _of_ids(found, expected.ids, predictions, ground_truth)
    elif len(found.points) != len(expected.points):
        raise ValueError(
            f"{predictions} has {len(found.points)} frames and the ground truth in {ground_truth} "
            f"{len(expected.points)}. Predict every frame once, in the order of the ground truth."
        )
    with naming(predictions, "finite predictions of every frame"):
        require_finite("landmarks", found.points.landmarks, found.ids)
    if protocol.frames not in (None, len(expected.points)):
        remarks.append(
            f"{len(expected.points)} frames are scored and not the {protocol.frames} of {protocol.name}: "
            "these are not scores of the official test set."
        )
    mesh = found.points.vertices
    if mesh is not None:
        with naming(predictions, "finite predictions of every frame"):
            require_finite("vertices", mesh, found.ids)
    return _with_common_vertices(expected.points, found.points, remarks, protocol)


def _with_common_vertices(
    ground_truth: HandPoints, found: HandPoints, remarks: list[str], protocol: Protocol
) -> Pair:
    mesh, expected = found.vertices, ground_truth.vertices
    if not protocol.scores_vertices:
        return Pair(HandPoints(ground_truth.landmarks), HandPoints(found.landmarks), tuple(remarks))
    reason = None
    if mesh is None:
        reason = "The predictions have no vertices"
    elif expected is None:
        reason = "The ground truth has no evaluation_verts.json"
    elif mesh.shape[1] != expected.shape[1]:
        reason = (
            f"The predictions have {mesh.shape[1]} vertices and the ground truth {expected.shape[1]}, "
            "which do not correspond"
        )
    if reason is None:
        return Pair(ground_truth, found, tuple(remarks), mesh)
    remarks.append(f"{reason}: landmarks alone are scored, and the surface's scores are -1.")
    landmarks = HandPoints(ground_truth.landmarks), HandPoints(found.landmarks)
    # Fewer points than landmarks are no surface, and the lint cannot compare them with a hand.
    surface = mesh if mesh is not None and mesh.shape[1] > 21 else None
    return Pair(*landmarks, tuple(remarks), surface)


def read_predictions(path: Path, protocol: Protocol) -> PointFile:
    """Read a file of predictions.

    Args:
        path: `pred.json`, a zip of it, or DexYCB's text.
        protocol: Benchmark whose format it has.

    Raises:
        FileNotFoundError: It does not exist.
        ValueError: It has another format; the message says what was found and what to do.
    """
    if not path.is_file():
        raise FileNotFoundError(
            f"There is no file {path}; predictions=<file> is pred.json, pred.zip or DexYCB's text."
        )
    with naming(path, "predictions in the benchmark's format"):
        if protocol.is_text:
            return _read_text(path)
        if zipfile.is_zipfile(path):
            return _read_zip(path)
        with path.open("rb") as stream:
            return _checked(read_point_lists(stream, str(path)))


def read_ground_truth(folder: Path, protocol: Protocol) -> PointFile:
    """Read `evaluation_xyz.json` and, where it exists, `evaluation_verts.json`.

    For DexYCB, either a text in the format of its predictions, or a folder whose `evaluation_xyz.json` is in
    metres and FreiHAND's order: then ids are positions, and hands whose coordinates are all −1 are left out.

    Raises:
        FileNotFoundError: It does not exist.
        ValueError: It has another format.
    """
    if folder.is_file() and protocol.is_text:
        return _annotated(_read_text(folder))
    path, mesh = folder / "evaluation_xyz.json", folder / "evaluation_verts.json"
    if not path.is_file():
        raise FileNotFoundError(
            f"{folder} holds no evaluation_xyz.json. Give ground_truth=<folder> with the benchmark's "
            "evaluation_xyz.json and, where it is known, evaluation_verts.json."
        )
    with path.open("rb") as stream:
        lists = read_point_lists(stream, str(path))
    landmarks = torch.from_numpy(lists.landmarks)
    ids = torch.arange(len(landmarks))
    if protocol.is_text:
        metres = _annotated(PointFile(HandPoints(landmarks), ids))
        return PointFile(HandPoints(metres.points.landmarks / UNITS[protocol.unit]), metres.ids)
    with naming(path, "finite ground truth of every frame"):
        require_finite("ground-truth landmarks", landmarks, ids)
    return PointFile(HandPoints(landmarks, _true_vertices(mesh, len(landmarks))), ids)


def _true_vertices(path: Path, frames: int) -> Tensor | None:
    if not path.is_file():
        return None
    with path.open("rb") as stream:
        vertices = torch.from_numpy(read_point_list(stream, str(path)))
    if len(vertices) != frames:
        raise ValueError(
            f"{path} has {len(vertices)} frames and evaluation_xyz.json beside it {frames}; "
            "both must be of one test set. Copy them again."
        )
    return vertices


def _read_zip(path: Path) -> PointFile:
    with opened_zip(path, path) as archive:
        names = [name for name in archive.namelist() if Path(name).name == "pred.json"]
        if not names:
            raise ValueError(
                f"{path} holds {', '.join(archive.namelist()[:5]) or 'nothing'} and no pred.json; "
                "pack it with `zip -j pred.zip pred.json`."
            )
        name = min(names, key=len)
        size = archive.getinfo(name).file_size
        if size > MAX_BYTES:
            raise ValueError(
                f"{path}:{name} would unpack to {size} bytes, more than the {MAX_BYTES} that are read; "
                "HO3D's predictions take about 1.2e9."
            )
        with archive.open(name) as stream:
            read = _checked(read_point_lists(stream, f"{path}:{name}"))  # type: ignore[arg-type]
    if name == "pred.json":
        return read
    remark = (
        f"pred.json is in a folder of the archive ({name}); the official server looks at the top level: "
        "pack it with `zip -j pred.zip pred.json`."
    )
    return PointFile(read.points, read.ids, (*read.remarks, remark))


def _checked(lists: PointLists) -> PointFile:
    remarks = []
    if not lists.nested:
        remarks.append(
            "The file is a list of landmarks alone; the official scripts expect [xyz, verts]."
        )
    vertices = None if lists.vertices is None else torch.from_numpy(lists.vertices)
    if vertices is not None and vertices.shape[1] != MESH:
        remarks.append(
            f"The mesh has {vertices.shape[1]} vertices; the official scripts expect MANO's {MESH}."
        )
    landmarks = torch.from_numpy(lists.landmarks)
    return PointFile(HandPoints(landmarks, vertices), torch.arange(len(landmarks)), tuple(remarks))


def _read_text(path: Path) -> PointFile:
    """DexYCB's text: comma-separated, an id and 63 millimetres on each line."""
    text = read_bytes(path)
    lines = [line for line in text.splitlines() if line.strip()]
    for number, line in enumerate(lines):
        if line.count(b",") != COLUMNS - 1:
            raise ValueError(
                f"Line {number + 1} of {path} has {line.count(b',') + 1} comma-separated entries; expected "
                f"are {COLUMNS}: id,x1,y1,z1,...,x21,y21,z21 in millimetres."
            )
        # NumPy stores every entry with the length of the longest.
        if max(map(len, line.split(b","))) > LONGEST:
            raise ValueError(
                f"Line {number + 1} of {path} has an entry of more than {LONGEST} characters; "
                "expected are numbers."
            )
    try:
        numbers = np.array([line.split(b",") for line in lines]).astype(np.float64)
    except ValueError as error:
        raise ValueError(
            f"{path} has an entry that is no number: {error}. Expected are {COLUMNS} numbers on each line."
        ) from error
    if not len(numbers):
        raise ValueError(
            f"{path} is empty; expected is a line of {COLUMNS} numbers for each image."
        )
    table = torch.from_numpy(numbers)
    ids = _whole_ids(numbers[:, 0], path)
    unique, counts = ids.unique(return_counts=True)
    if len(unique) < len(ids):
        raise ValueError(
            f"{path} has {int(counts.max())} lines for id {int(unique[counts.argmax()])}; one is expected."
        )
    return PointFile(HandPoints(table[:, 1:].reshape(-1, 21, 3)), ids)


def _whole_ids(numbers: Float[np.ndarray, " hand"], path: Path) -> Int[Tensor, " hand"]:
    """Ids as integers, which count images from zero; beyond 2⁵³ a double skips whole numbers."""
    wrong = ~((numbers >= 0) & (numbers < 2**53) & (numbers % 1 == 0))
    if wrong.any():
        raise ValueError(
            f"{path} has the id {float(numbers[wrong][0])!r}; expected is a whole number, the image's "
            "position in the split. Check that the first column is not missing."
        )
    return torch.from_numpy(numbers.astype(np.int64))


def _annotated(file: PointFile) -> PointFile:
    """Drop hands without annotation."""
    known = (file.points.landmarks != ABSENT).flatten(1).any(dim=1)
    return PointFile(file.points[known.nonzero()[:, 0]], file.ids[known])


def _of_ids(
    file: PointFile, wanted: Int[Tensor, " hand"], path: Path, ground_truth: Path
) -> PointFile:
    """Select the frames of some ids, in their order."""
    row_of = {identity: row for row, identity in enumerate(file.ids.tolist())}
    missing = [identity for identity in wanted.tolist() if identity not in row_of]
    if missing:
        shown = ", ".join(str(identity) for identity in missing[:5])
        raise ValueError(
            f"{path} has {len(file.ids)} frames and lacks {len(missing)} of the {len(wanted)} annotated "
            f"ones in {ground_truth}: ids {shown}{' ...' if len(missing) > 5 else ''}. "
            "Predict every image; ids count all images of the split, annotated or not."
        )
    rows = torch.tensor([row_of[identity] for identity in wanted.tolist()], dtype=torch.int64)
    return PointFile(file.points[rows], wanted, file.remarks)
