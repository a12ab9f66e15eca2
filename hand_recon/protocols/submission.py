"""Writes files of predictions as the benchmarks take them (Sec. 4.1).

Coordinates are rounded to keep the files small: FreiHAND's to 0.01 mm, HO3D's to 0.1 mm, DexYCB's to 0.01 mm.
For predictions with errors of millimetres this changes a mean error by less than 0.01 mm, which
`tests/protocols/test_submission.py` checks; a perfect prediction would get an error of the rounding itself.
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
from hand_recon.evaluation.per_sample import require_finite
from hand_recon.evaluation.scores import HandPoints
from hand_recon.protocols.benchmarks import Protocol

FRAMES: Final = 64
"""Frames that are text at a time."""

TEXT: Final = "predictions.txt"
"""Name of DexYCB's file, which its toolkit leaves free."""


def write_submission(
    protocol: Protocol,
    prediction: HandPoints,
    folder: Path,
    *,
    root: Float[Tensor, "hand 3"] | None = None,
    ids: Int[Tensor, " hand"] | None = None,
) -> list[Path]:
    """Write what the benchmark's server takes.

    Args:
        protocol: The benchmark.
        prediction: In FreiHAND's order and the camera's frame, metres; left hands as left hands. Without
            vertices, the wrist stands in for each surface.
        folder: Where to; it is made.
        root: Where each wrist goes, camera frame, metres: HO3D gives it for its test hands. None leaves the
            hands where they were predicted.
        ids: DexYCB's id of each hand; none counts from zero.

    Returns:
        `pred.json` and `pred.zip`, or DexYCB's `predictions.txt`.

    Raises:
        FileExistsError: One of them is there already.
        ValueError: A prediction is not finite, or has the wrong count.
    """
    names = [TEXT] if protocol.unit == "mm" else ["pred.json", "pred.zip"]
    paths = [folder / name for name in names]
    for path in paths:
        if path.exists():
            raise FileExistsError(
                f"{path} exists, and nothing is overwritten; choose another folder or remove it."
            )
    _check(prediction, ids)
    points = protocol.from_internal(rooted(prediction, root).double())
    folder.mkdir(parents=True, exist_ok=True)
    if protocol.unit == "mm":
        _write_text(paths[0], points, ids, protocol.decimals)
        return paths
    with paths[0].open("x", encoding="ascii") as stream:
        stream.writelines(_json_parts(points, protocol.decimals))
    # At the lowest level: a gigabyte of digits is not worth minutes.
    with zipfile.ZipFile(paths[1], "x", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.write(paths[0], "pred.json")
    return paths


def _check(prediction: HandPoints, ids: Tensor | None) -> None:
    index = torch.arange(len(prediction))
    require_finite("landmarks", prediction.landmarks, index)
    if prediction.vertices is not None:
        require_finite("vertices", prediction.vertices, index)
    if ids is not None and len(ids) != len(prediction):
        raise ValueError(
            f"There are {len(prediction)} hands and {len(ids)} ids; give one for each."
        )


def rooted(points: HandPoints, root: Float[Tensor, "hand 3"] | None) -> HandPoints:
    """Hands with each wrist where it is told to be.

    Args:
        points: Camera frame, metres.
        root: The wrists, metres; none leaves the hands where they are.
    """
    if root is None:
        return points
    shift = (root.to(points.landmarks) - points.landmarks[:, WRIST])[:, None]
    vertices = None if points.vertices is None else points.vertices + shift.to(points.vertices)
    return HandPoints(points.landmarks + shift, vertices)


def _json_parts(points: HandPoints, decimals: int) -> Iterator[str]:
    """`[landmarks, vertices]` piece by piece: as a whole, HO3D's would take ten gigabytes."""
    yield "["
    yield from _list_parts(points.landmarks, decimals)
    yield ", "
    # FreiHAND's script looks into the second list at every frame; one point is no surface to it (−1).
    surface = points.landmarks[:, :1] if points.vertices is None else points.vertices
    yield from _list_parts(surface, decimals)
    yield "]"


def _list_parts(points: Tensor, decimals: int) -> Iterator[str]:
    yield "["
    for start in range(0, len(points), FRAMES):
        part = np.round(points[start : start + FRAMES].numpy(), decimals).tolist()
        # Without the brackets of the piece.
        yield (", " if start else "") + json.dumps(part, separators=(",", ":"))[1:-1]
    yield "]"


def _write_text(path: Path, points: HandPoints, ids: Tensor | None, decimals: int) -> None:
    numbers = range(len(points)) if ids is None else ids.tolist()
    with path.open("x", encoding="ascii") as stream:
        for identity, hand in zip(numbers, points.landmarks.flatten(1).tolist(), strict=True):
            row = ",".join(f"{value:.{decimals}f}" for value in hand)
            stream.write(f"{identity},{row}\n")
