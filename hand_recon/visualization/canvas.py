"""Backgrounds of drawings, and sheets of captioned panels."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import torch
from jaxtyping import Shaped, UInt8

Image = UInt8[np.ndarray, "height width 3"]
"""RGB image."""

_DPI: Final = 100
_CAPTION: Final = 0.24
_TITLE: Final = 0.45


def background(image: Shaped[torch.Tensor, "3 image_height image_width"], panel: int) -> Image:
    """Enlarge a crop to a panel; white for a crop without an image.

    Args:
        image: Bytes, or floats 0–1; of height and width 0 for landmarks without an image.
        panel: Side of the panel, pixels.
    """
    if image.numel() == 0:
        return np.full((panel, panel, 3), 255, dtype=np.uint8)
    pixels = image if image.dtype == torch.uint8 else (image * 255).round().clamp(0, 255)
    array = pixels.to(torch.uint8).permute(1, 2, 0).cpu().numpy()
    enlarged: Image = np.asarray(
        cv2.resize(array, (panel, panel), interpolation=cv2.INTER_LINEAR), dtype=np.uint8
    )
    return enlarged


@dataclass(frozen=True)
class Panel:
    """One image of a sheet with its caption."""

    image: Image
    """Square image."""
    caption: str = ""
    """Text below the image."""


def sheet(
    rows: Sequence[Sequence[Panel | None]],
    columns: Sequence[str] = (),
    names: Sequence[str] = (),
) -> UInt8[np.ndarray, "sheet_height sheet_width 3"]:
    """Arrange panels in a grid, with captions, column titles and row names.

    Args:
        rows: Rows of the same length; None leaves a cell empty.
        columns: Titles above the columns.
        names: Names at the left of the rows.

    Raises:
        ValueError: There is no panel, or the rows differ in length.
    """
    # Half a second, which commands that draw no sheet should not wait for.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    lengths = {len(row) for row in rows}
    if len(lengths) != 1 or 0 in lengths:
        raise ValueError(
            f"Found rows of lengths {sorted(lengths)}; expected rows of one length with a panel each. Fill "
            "short rows with None."
        )
    (width,) = lengths
    side = max(panel.image.shape[0] for row in rows for panel in row if panel) / _DPI
    # Without pyplot, which keeps global state and may ask for a display.
    figure = Figure(
        figsize=(
            width * side + (_TITLE if names else 0),
            len(rows) * (side + _CAPTION) + (_TITLE if columns else 0),
        ),
        dpi=_DPI,
        layout="constrained",
    )
    figure.get_layout_engine().set(w_pad=0.02, h_pad=0.02, wspace=0, hspace=0)  # type: ignore[call-arg, union-attr]  # of this engine
    grid = figure.subplots(len(rows), width, squeeze=False)
    for index, row in enumerate(rows):
        for column, panel in enumerate(row):
            axes = grid[index, column]
            axes.set(xticks=[], yticks=[])
            axes.spines[:].set_visible(False)
            if panel is not None:
                axes.imshow(panel.image, interpolation="none")
                axes.set_xlabel(panel.caption, fontsize=9, labelpad=2)
            if index == 0 and columns:
                axes.set_title(columns[column], fontsize=10)
            if column == 0 and names:
                axes.set_ylabel(names[index], fontsize=10)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]  # matplotlib has few types
    rgba = np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]
    return rgba[..., :3].copy()
