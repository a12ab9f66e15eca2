"""Results of a fit of landmarks: hands as JSON and tables, meshes and images.

`hands.json` has one object per hand, in the order of the input, in the format of
`hand_recon.fitting.hands_file`. Meshes are in metres in the camera's frame.
"""

import logging
import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import torch
from jaxtyping import Float, Int, UInt8
from rich.console import Console
from rich.table import Table
from torch import Tensor

from hand_recon.data.images import read_image
from hand_recon.data.landmarks.crops import to_crops
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.fitting.drawing import save_meshes
from hand_recon.fitting.fitted_hands import FittedHands
from hand_recon.fitting.hand_records import HandRecords
from hand_recon.fitting.hands_file import read_hands, writing_hands
from hand_recon.fitting.hands_tables import write_tables
from hand_recon.fitting.images import contact_sheet, draw_fitted, fitted_image, row_caption
from hand_recon.fitting.records_of_fits import to_records
from hand_recon.rendering.mesh_files import MESH_SUFFIXES

logger = logging.getLogger(__name__)

MESH_FORMATS: Final = tuple(suffix.removeprefix(".") for suffix in MESH_SUFFIXES)
"""File formats of meshes."""

PRODUCTS: Final = (
    "hands.json", "hands.json.part", "hands.csv", "landmarks.csv", "images.csv", "fits.png", "meshes",
    "pictures", "overlays", "index.html", "per_hand.csv", "metrics.json", "checkpoints",
)  # fmt: skip
"""Files and folders of a fit or a run; a folder that holds one of them is not written to."""


@dataclass(frozen=True)
class ResultOptions:
    """Options for the results besides `hands.json`.

    Raises:
        ValueError: The format of meshes is unknown.
    """

    meshes: int = 100
    """Number of hands, the first ones, whose meshes are written; 0 for none."""
    mesh_format: str = "obj"
    """One of `MESH_FORMATS`."""
    pictures: int = 16
    """Number of hands, the first ones, whose images are drawn; 0 for none."""
    panel: int = 224
    """Side of each panel of an image, pixels."""

    def __post_init__(self) -> None:
        check_mesh_format(self.mesh_format)


def check_mesh_format(name: str) -> None:
    """Check the name of a format of meshes.

    Raises:
        ValueError: It is not one of `MESH_FORMATS`.
    """
    if name not in MESH_FORMATS:
        raise ValueError(f"Unknown format of meshes {name!r}; choose one of {list(MESH_FORMATS)}.")


def claim_results_folder(path: str | Path, *further: str) -> Path:
    """Make the folder of results; called before the fit, so that a taken folder is refused at once.

    Raises:
        FileExistsError: The folder already holds results.
    """
    folder = Path(os.path.expanduser(path)).absolute()
    taken = [name for name in (*PRODUCTS, *further) if (folder / name).exists()]
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
    *,
    done: Sequence[dict[str, Any]] | None = None,
) -> dict[str, float]:
    """Write all results part by part, and print a summary.

    Args:
        folder: Folder of the results; made if it does not exist.
        parts: The hands in order, some at a time; a generator may fit each part when it is asked for it.
        faces: The right hand's triangles.
        options: How much is written besides `hands.json`.
        done: Objects of the first hands, of an interrupted run that goes on in this folder.

    Returns:
        Number of hands, and means over the fitted hands.

    Raises:
        FileExistsError: The folder already holds results.
    """
    folder = Path(folder) if done is not None else claim_results_folder(folder)
    extras = _MeshesAndImages(folder, faces.cpu().numpy(), options or ResultOptions())
    number, path = len(done or ()), folder / "hands.json"
    with writing_hands(path, done) as write:
        for part in parts:
            # First the meshes and images: a hand that is in the file is done.
            for position, fitted in enumerate(part.fitted.tolist()):
                if fitted:
                    extras.add(part, position, number + position)
            number += len(part)
            write(to_records(part))
    hands = read_hands(path)
    write_tables(folder, hands)
    extras.finish(hands)
    summary = summary_of(hands)
    _print_summary(summary, folder)
    return summary


class _MeshesAndImages:
    """Writer of the meshes and images of the first hands."""

    def __init__(
        self, folder: Path, faces: Int[np.ndarray, "face 3"], options: ResultOptions
    ) -> None:
        self.folder, self.faces, self.options = folder, faces, options

    def add(self, part: FittedHands, position: int, number: int) -> None:
        """Write the mesh and the image of a hand, as far as the options ask for them.

        Args:
            part: The part that the hand belongs to.
            position: Index of the hand in the part.
            number: Index of the hand among all hands.
        """
        name = file_name(part.observed.names[position], number)
        if number < self.options.meshes:
            target = self._folder("meshes") / f"{name}.{self.options.mesh_format}"
            vertices = part.prediction.vertices[position : position + 1].numpy()
            side = "left" if bool(part.observed.left[position]) else "right"
            save_meshes(target, vertices, [side], self.faces)
        if number < self.options.pictures:
            row = draw_fitted(fitted_image(part, position, number), self.faces, self.options.panel)
            write_image(self._folder("pictures") / f"{name}.png", row)

    def finish(self, hands: HandRecords) -> None:
        """Write the contact sheet, and log how many meshes and images were left out."""
        rows, captions = [], []
        for number in np.flatnonzero(hands.fitted[: self.options.pictures]).tolist():
            name = hands.names[number]
            picture = read_image(self.folder / "pictures" / f"{file_name(name, number)}.png")
            if picture is not None:
                rows.append(picture)
                residual = hands.residual[number]
                captions.append(row_caption(number, name, hands.sides[number], float(residual)))
        if rows:
            write_image(self.folder / "fits.png", contact_sheet(rows, captions))
        for what, most in (("meshes", self.options.meshes), ("pictures", self.options.pictures)):
            if len(hands) > most > 0:
                logger.info(
                    "%s: %s of the first %d hands only, %d are left out; raise %s for more.",
                    self.folder, what, most, len(hands) - most, what,
                )  # fmt: skip

    def _folder(self, name: str) -> Path:
        folder = self.folder / name
        folder.mkdir(exist_ok=True)
        return folder


def file_name(name: str, number: int) -> str:
    """A hand's number and name in characters that are allowed on every file system."""
    stem = re.sub(r"\.(png|jpe?g|bmp|tiff?|webp)\b", "", name, flags=re.IGNORECASE)
    safe = re.sub(r"[^A-Za-z0-9.-]+", "-", stem).strip("-.")[:60]
    return f"{number:06d}" if safe in ("", str(number)) else f"{number:06d}_{safe}"


IMAGE_SUFFIXES: Final = (".png", ".jpg", ".jpeg")
"""Suffixes of the files that `write_image` writes."""


def write_image(path: Path, image: UInt8[np.ndarray, "height width 3"]) -> None:
    """Write an RGB image as PNG or JPEG, by the file's suffix, one of `IMAGE_SUFFIXES`."""
    suffix = path.suffix.lower()
    options = [] if suffix == ".png" else [cv2.IMWRITE_JPEG_QUALITY, 90]
    # Through bytes: cv2.imwrite fails without an error on paths with letters outside ASCII on some systems.
    code = cv2.imencode(suffix, cv2.cvtColor(image, cv2.COLOR_RGB2BGR), options)[1]
    path.write_bytes(code.tobytes())


def summary_of(hands: HandRecords) -> dict[str, float]:
    """Counts of hands, and means over the landmarks and the fitted hands if there are any.

    Args:
        hands: All hands of a fit.
    """
    fitted = hands.fitted
    counts: dict[str, float] = {**hands.counts(), "left": hands.sides.count("left")}
    distance = np.linalg.norm(hands.landmarks_2d - hands.observed_2d, axis=-1)
    known = np.isfinite(distance)
    if not known.any():
        return counts
    scale = _pixels_of_crop(hands.observed_2d[fitted])
    return counts | {
        "landmarks": int(known.sum()),
        "residual": float(distance[known].mean()),
        "residual_224": float((distance[fitted] * scale[:, None])[known[fitted]].mean()),
        **{
            f"loss/{term}": float(np.nan_to_num(values[fitted]).mean())
            for term, values in hands.loss.items()
        },
    }


def _pixels_of_crop(
    observed: Float[np.ndarray, "hand landmark=21 2"],
) -> Float[np.ndarray, " hand"]:
    """Pixels of the 224-pixel crop about each hand per pixel of its image."""
    points = torch.from_numpy(observed)
    crops = to_crops(
        ImageLandmarks(
            points,
            points.isfinite().all(dim=-1),
            torch.zeros(len(points), dtype=torch.bool),
            ("",) * len(points),
        )
    )
    scale: Float[np.ndarray, " hand"] = (
        torch.linalg.det(crops.matrices[:, :2, :2]).abs().sqrt().numpy()
    )
    return scale


_MEANINGS: Final = {
    "hands": "hands",
    "fitted": "fitted",
    "doubtful": "doubtful, with the reasons in hands.json",
    "left": "left hands",
    "landmarks": "landmarks given for the fitted hands",
    "residual": "mean distance to them, pixels of the image",
    "residual_224": "the same, pixels of a 224-pixel crop",
}
"""Descriptions of the summary's lines."""


def _print_summary(summary: dict[str, float], folder: Path) -> None:
    table = Table(title=str(folder), show_header=False)
    table.add_column("what")
    table.add_column("value", justify="right")
    for name, value in summary.items():
        shown = str(value) if isinstance(value, int) else f"{value:.3f}"
        table.add_row(_MEANINGS.get(name, name), shown)
    Console().print(table)
