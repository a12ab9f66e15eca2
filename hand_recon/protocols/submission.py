"""Writers of prediction files in the benchmarks' formats (Sec. 4.1).

Coordinates are rounded to keep the files small: FreiHAND's to 0.01 mm, HO3D's to 0.1 mm, DexYCB's to 0.01 mm.
For predictions with errors of millimetres this changes a mean error by less than 0.01 mm, which
`tests/protocols/test_submission.py` checks; a perfect prediction gets an error of the rounding itself.
"""

import json
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from hand_recon.evaluation.alignment import WRIST
from hand_recon.evaluation.finite import require_finite
from hand_recon.evaluation.scores import HandPoints
from hand_recon.protocols.benchmarks import Protocol

FRAMES: Final = 64
"""Frames converted to text at a time."""

TEXT: Final = "predictions.txt"
"""File name of DexYCB's text; its toolkit prescribes none."""


def write_submission(
    protocol: Protocol,
    prediction: HandPoints,
    folder: Path,
    *,
    root: Float[Tensor, "hand 3"] | None = None,
    ids: Int[Tensor, " hand"] | None = None,
) -> list[Path]:
    """Write predictions in the format of the benchmark's server.

    Args:
        protocol: Benchmark.
        prediction: FreiHAND's order, camera frame, metres; left hands not mirrored. Without vertices, the
            wrist is written in place of each surface.
        folder: Folder to write into; it is created.
        root: Position of each wrist, camera frame, metres: HO3D gives it for its test hands. None keeps
            the predicted positions.
        ids: DexYCB's id of each hand; none counts from zero.

    Returns:
        Paths of `pred.json` and `pred.zip`, or of DexYCB's `predictions.txt`.

    Raises:
        FileExistsError: One of the files exists already.
        ValueError: A prediction is not finite, or there are more or fewer ids than hands.
    """
    names = [TEXT] if protocol.is_text else ["pred.json", "pred.zip"]
    paths = [folder / name for name in names]
    _check(paths, prediction, ids)
    points = protocol.from_internal(rooted(prediction, root).double())
    folder.mkdir(parents=True, exist_ok=True)
    if protocol.is_text:
        _write_text(paths[0], points, ids, protocol.decimals)
        return paths
    _write_json(paths[0], paths[1], points, protocol.decimals)
    return paths


def _check(paths: list[Path], prediction: HandPoints, ids: Tensor | None) -> None:
    for path in paths:
        if path.exists():
            raise FileExistsError(
                f"{path} exists and is not overwritten; choose another folder or remove it."
            )
    index = torch.arange(len(prediction))
    require_finite("landmarks", prediction.landmarks, index)
    if prediction.vertices is not None:
        require_finite("vertices", prediction.vertices, index)
    if ids is not None and len(ids) != len(prediction):
        raise ValueError(
            f"There are {len(prediction)} hands and {len(ids)} ids; give one for each."
        )


def rooted(points: HandPoints, root: Float[Tensor, "hand 3"] | None) -> HandPoints:
    """Translate hands so that their wrists are at given positions.

    Args:
        points: Hands, camera frame, metres.
        root: Position of each wrist, camera frame, metres; none returns the hands unchanged.
    """
    if root is None:
        return points
    translation = (root.to(points.landmarks) - points.landmarks[:, WRIST])[:, None]
    vertices = (
        None if points.vertices is None else points.vertices + translation.to(points.vertices)
    )
    return HandPoints(points.landmarks + translation, vertices)


def _write_json(path: Path, packed: Path, points: HandPoints, decimals: int) -> None:
    with path.open("x", encoding="ascii") as stream:
        stream.writelines(_json_parts(points, decimals))
    # The lowest compression level: higher ones take minutes for a gigabyte of digits.
    with zipfile.ZipFile(packed, "x", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.write(path, "pred.json")


def _json_parts(points: HandPoints, decimals: int) -> Iterator[str]:
    """`[landmarks, vertices]` as JSON in pieces: HO3D's as a whole would take ten gigabytes of memory."""
    yield "["
    yield from _list_parts(points.landmarks, decimals)
    yield ", "
    # FreiHAND's script indexes the second list at every frame; it scores one point as no surface (−1).
    surface = points.landmarks[:, :1] if points.vertices is None else points.vertices
    yield from _list_parts(surface, decimals)
    yield "]"


def _list_parts(points: Tensor, decimals: int) -> Iterator[str]:
    yield "["
    for start in range(0, len(points), FRAMES):
        part = np.round(points[start : start + FRAMES].numpy(), decimals).tolist()
        # Drop the brackets of the piece.
        yield (", " if start else "") + json.dumps(part, separators=(",", ":"))[1:-1]
    yield "]"


def _write_text(path: Path, points: HandPoints, ids: Tensor | None, decimals: int) -> None:
    numbers = range(len(points)) if ids is None else ids.tolist()
    with path.open("x", encoding="ascii") as stream:
        for identity, hand in zip(numbers, points.landmarks.flatten(1).tolist(), strict=True):
            row = ",".join(f"{value:.{decimals}f}" for value in hand)
            stream.write(f"{identity},{row}\n")
