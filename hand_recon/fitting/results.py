"""What `python -m hand_recon.fit` leaves behind: hands as JSON, meshes and pictures.

`fit.json` is a list with one object per hand, in the order of the input and one to a line: what
`hand_recon.fitting.fitted_hands` describes. `joints.json` names its landmarks, joints and
axes. Meshes are in metres in the camera's frame.
"""

import json
import logging
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import trimesh
from jaxtyping import Int
from rich.console import Console
from rich.table import Table
from torch import Tensor

from hand_recon.fitting.fitted_hands import FittedHands, entries
from hand_recon.fitting.images import contact_sheet, draw_fitted, picture_of
from hand_recon.hand.skeleton import ARTICULATED, AXES, LANDMARK_PARENTS, LANDMARKS

logger = logging.getLogger(__name__)

MESH_FORMATS: Final = ("obj", "ply")
"""Formats of meshes that can be written."""

PRODUCTS: Final = (
    "fit.json", "fit.json.part", "meshes", "pictures", "metrics.json", "checkpoints",
)  # fmt: skip
"""What a folder must not hold yet."""


@dataclass(frozen=True)
class ResultOptions:
    """How much is written besides `fit.json`.

    Raises:
        ValueError: The format of meshes is unknown.
    """

    meshes: int = 100
    """The most meshes, of the first hands; none are written at 0."""
    mesh_format: str = "obj"
    """One of `MESH_FORMATS`."""
    pictures: int = 16
    """The most pictures, of the first hands; none are drawn at 0."""
    panel: int = 224
    """Side of the panels of a picture, pixels."""

    def __post_init__(self) -> None:
        if self.mesh_format not in MESH_FORMATS:
            raise ValueError(
                f"Unknown format of meshes {self.mesh_format!r}; choose one of {list(MESH_FORMATS)}."
            )


def claim_results_folder(path: str | Path) -> Path:
    """Make the folder of results; call it before fitting, so that no result is without a place.

    Raises:
        FileExistsError: It already holds results.
    """
    folder = Path(path).expanduser().absolute()
    taken = [name for name in PRODUCTS if (folder / name).exists()]
    if taken:
        raise FileExistsError(
            f"{folder} already holds {', '.join(taken)} of a fit or a run, and nothing is overwritten. "
            "Name another folder, for example output=outputs/fit/second."
        )
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def write_results(
    folder: str | Path,
    parts: Iterable[FittedHands],
    faces: Int[Tensor, "face 3"],
    options: ResultOptions | None = None,
) -> dict[str, float]:
    """Write hands as they come, and print a summary.

    Args:
        folder: Where to; made if it is not there.
        parts: The hands in their order, some at a time: a generator may fit them meanwhile.
        faces: The right hand's triangles.
        options: How much is written.

    Returns:
        Number of hands, and the means over the hands that were fitted.

    Raises:
        FileExistsError: The folder already holds results.
    """
    folder = claim_results_folder(folder)
    shown = _Shown(folder, faces.cpu().numpy(), options or ResultOptions())
    totals = _Totals()
    _write_names(folder / "joints.json")
    with _list_in(folder / "fit.json") as write:
        for part in parts:
            for position, (content, fitted) in enumerate(
                zip(entries(part), part.fitted.tolist(), strict=True)
            ):
                write(content)
                if fitted:
                    shown.add(part, position, totals.hands + position)
            totals.add(part)
    shown.finish(totals.hands)
    summary = totals.summary()
    _print_summary(summary, folder)
    return summary


@contextmanager
def _list_in(path: Path) -> Iterator[Callable[[dict[str, Any]], None]]:
    """Write a JSON list one entry at a time; the file has its name once the list is complete.

    What was written before an error is kept, as valid JSON, under the name of an unfinished file.
    """
    unfinished = path.with_name(f"{path.name}.part")
    with unfinished.open("x", encoding="utf-8") as stream:
        separator = "[\n"

        def write(entry: dict[str, Any]) -> None:
            nonlocal separator
            # No NaN: it is not JSON, and most readers refuse the file.
            text = json.dumps(entry, allow_nan=False, ensure_ascii=False)
            stream.write(separator + text)
            separator = ",\n"

        try:
            yield write
        finally:
            stream.write("\n]\n" if separator.startswith(",") else "[]\n")
    unfinished.rename(path)


def _write_names(path: Path) -> None:
    """What the rows and columns of `fit.json` are."""
    names = {
        "landmarks": LANDMARKS,
        "landmark_parents": LANDMARK_PARENTS,
        "joints": ARTICULATED,
        "axes": AXES,
        "units": {
            "landmarks_3d": "metres, camera frame: x right, y down, z forward",
            "landmarks_2d": "pixels of the image, pixel i covering [i, i + 1)",
            "joint_angles_degrees": "degrees from the anatomical neutral, the straight finger",
            "shape": "standard deviations",
            "sigma": "pixels of the image",
            "residual": "pixels of the image",
        },
    }
    path.write_text(json.dumps(names, indent=2) + "\n", encoding="utf-8")


class _Shown:
    """The meshes and pictures of the first hands."""

    def __init__(
        self, folder: Path, faces: Int[np.ndarray, "face 3"], options: ResultOptions
    ) -> None:
        self.folder, self.faces, self.options = folder, faces, options
        self.rows: list[np.ndarray] = []
        self.captions: list[str] = []

    def add(self, part: FittedHands, position: int, number: int) -> None:
        """Write what is wanted of a hand.

        Args:
            part: The hands that it is among.
            position: Its place among them.
            number: Its place among all hands.
        """
        name = _file_name(part.observed.names[position], number)
        if number < self.options.meshes:
            target = self._folder("meshes") / f"{name}.{self.options.mesh_format}"
            _mesh(part, position, self.faces).export(target)
        if number < self.options.pictures:
            picture = picture_of(part, position, number)
            self.captions.append(picture.caption)
            self.rows.append(draw_fitted(picture, self.faces, self.options.panel))
            _write_png(self._folder("pictures") / f"{name}.png", self.rows[-1])

    def finish(self, hands: int) -> None:
        """Write the sheet, and say what was left out."""
        if self.rows:
            _write_png(self.folder / "fits.png", contact_sheet(self.rows, self.captions))
        for what, most in (("meshes", self.options.meshes), ("pictures", self.options.pictures)):
            if hands > most > 0:
                logger.info(
                    "%s: %s of the first %d hands only, %d are left out; raise %s for more.",
                    self.folder, what, most, hands - most, what,
                )  # fmt: skip

    def _folder(self, name: str) -> Path:
        folder = self.folder / name
        folder.mkdir(exist_ok=True)
        return folder


def _file_name(name: str, number: int) -> str:
    """A hand's number and its name, in characters that every file system knows."""
    stem = re.sub(r"\.(png|jpe?g|bmp|tiff?|webp)\b", "", name, flags=re.IGNORECASE)
    safe = re.sub(r"[^A-Za-z0-9.-]+", "-", stem).strip("-.")[:60]
    return f"{number:06d}" if safe in ("", str(number)) else f"{number:06d}_{safe}"


def _mesh(part: FittedHands, position: int, faces: Int[np.ndarray, "face 3"]) -> trimesh.Trimesh:
    # Seen in a mirror, the same triangles face inwards.
    turned = faces[:, ::-1] if bool(part.observed.left[position]) else faces
    vertices = part.prediction.vertices[position].double().numpy()
    return trimesh.Trimesh(vertices, turned, process=False)


def _write_png(path: Path, picture: np.ndarray) -> None:
    # Through bytes: OpenCV cannot open every path on every system, and says nothing.
    path.write_bytes(cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))[1].tobytes())


@dataclass
class _Totals:
    """Sums over the parts."""

    hands: int = 0
    fitted: int = 0
    left: int = 0
    landmarks: int = 0
    pixels: float = 0.0
    crop_pixels: float = 0.0
    loss: dict[str, float] = field(default_factory=dict)

    def add(self, part: FittedHands) -> None:
        """Count a part in."""
        distance, fitted = part.distance, part.fitted
        self.hands += len(part)
        self.fitted += int(fitted.sum())
        self.left += int(part.observed.left.sum())
        self.landmarks += int(distance.isfinite().sum())
        self.pixels += float(distance.nansum())
        self.crop_pixels += float((distance * part.scale[:, None]).nansum())
        for name, value in part.loss.items():
            self.loss[name] = self.loss.get(name, 0.0) + float(value[fitted].double().sum())

    def summary(self) -> dict[str, float]:
        """Counts, and means where there is something to average."""
        counts: dict[str, float] = {"hands": self.hands, "fitted": self.fitted, "left": self.left}
        if not self.landmarks:
            return counts
        return counts | {
            "landmarks": self.landmarks,
            "residual": self.pixels / self.landmarks,
            "residual_224": self.crop_pixels / self.landmarks,
            **{f"loss/{name}": total / self.fitted for name, total in self.loss.items()},
        }


_MEANINGS: Final = {
    "hands": "hands in the file",
    "fitted": "hands with enough landmarks to be fitted",
    "left": "left hands",
    "landmarks": "landmarks that were fitted to",
    "residual": "mean distance to them, pixels of the image",
    "residual_224": "the same, pixels of a 224-pixel crop",
}
"""What the lines of the summary say."""


def _print_summary(summary: dict[str, float], folder: Path) -> None:
    table = Table(title=str(folder), show_header=False)
    table.add_column("what")
    table.add_column("value", justify="right")
    for name, value in summary.items():
        shown = str(value) if isinstance(value, int) else f"{value:.3f}"
        table.add_row(_MEANINGS.get(name, name), shown)
    Console().print(table)
