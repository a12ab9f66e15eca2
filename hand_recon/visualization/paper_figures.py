"""The paper's pictures of what knowledge (Fig. 3) and the likelihood (Fig. 4) do to single hands."""

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float, Int, UInt8

from hand_recon.rendering.mesh import from_the_side, shade
from hand_recon.schema import HandBatch, HandPrediction
from hand_recon.visualization.canvas import Panel, background, sheet
from hand_recon.visualization.ellipses import ellipse_panels
from hand_recon.visualization.overlay import draw_landmarks

Errors = Float[np.ndarray, "column hand"]
"""E_J of each prediction and hand, millimetres; NaN where there is no ground truth."""

Sheet = UInt8[np.ndarray, "sheet_height sheet_width 3"]
"""RGB."""


def mean_sigma(prediction: HandPrediction) -> Float[np.ndarray, " hand"]:
    """σ averaged over the coordinates of each hand's landmarks, pixels of a 224-pixel crop."""
    return prediction.log_sigma.detach().double().exp().mean(dim=(-2, -1)).cpu().numpy()


def rank_by_uncertainty(
    batch: HandBatch, prediction: HandPrediction, count: int = 6, panel: int = 224
) -> Sheet:
    """The hands of largest and of smallest mean σ, each with its ellipses below it (Fig. 4b).

    Args:
        batch: Images with their labels.
        prediction: Of these images.
        count: Hands at either end; fewer where there are fewer than twice as many.
        panel: Side of each panel, pixels.

    Raises:
        ValueError: There is no hand.
    """
    sigma = mean_sigma(prediction)
    order = np.argsort(-sigma, kind="stable")
    count = max(1, min(count, len(order) // 2))
    ends = {"largest σ": order[:count].tolist(), "smallest σ": order[::-1][:count].tolist()}
    with_ellipses = ellipse_panels(batch, prediction, panel)
    rows: list[list[Panel]] = []
    for places in ends.values():
        rows.append([Panel(_seen(batch, place, panel)) for place in places])
        rows.append(
            [
                Panel(
                    with_ellipses[place],
                    f"test hand {int(batch.index[place])}: σ {sigma[place]:.1f} px",
                )
                for place in places
            ]
        )
    return sheet(rows, names=[name for end in ends for name in (end, "1σ and 2σ")])


def before_after(
    columns: Sequence[tuple[str, HandPrediction]],
    batch: HandBatch,
    faces: Int[torch.Tensor, "face 3"],
    errors: Errors | None = None,
    panel: int = 224,
) -> Sheet:
    """Every hand as several models see it, from the front and from the side (Fig. 3).

    The first column has the labels on the image and, where there is ground truth of this hand's mesh, the
    truth from the side.

    Args:
        columns: Titles, and what each model says of the batch.
        batch: Images with their labels.
        faces: The hand's triangles.
        errors: E_J of each column and hand, millimetres, for the captions.
        panel: Side of each panel, pixels.

    Raises:
        ValueError: There is no column.
    """
    if not columns:
        raise ValueError("Nothing to compare: give one or more predictions.")
    triangles = faces.cpu().numpy()
    rows: list[list[Panel | None]] = []
    for place in range(len(batch)):
        front: list[Panel | None] = [Panel(_labelled(batch, place, panel))]
        side = [_truth_from_the_side(batch, place, triangles, panel)]
        for column, (_, prediction) in enumerate(columns):
            front.append(Panel(mesh_on_image(batch, prediction, place, triangles, panel)))
            vertices = prediction.vertices[place].detach().double().cpu().numpy()
            caption = _caption(errors, column, place)
            side.append(Panel(from_the_side(vertices, triangles, panel), caption))
        rows += [front, side]
    names = [
        name for index in batch.index.tolist() for name in (f"test hand {index}", "from the side")
    ]
    return sheet(rows, ["labels", *(title for title, _ in columns)], names)


def likelihood_effect(
    columns: Sequence[tuple[str, HandPrediction]],
    batch: HandBatch,
    faces: Int[torch.Tensor, "face 3"],
    errors: Errors | None = None,
    panel: int = 224,
) -> Sheet:
    """One row per hand: its labels, what each model makes of it, and the last one's ellipses (Fig. 4a).

    Args:
        columns: Titles, and what each model says of the batch; the last one has learnt σ.
        batch: Images with their labels.
        faces: The hand's triangles.
        errors: E_J of each column and hand, millimetres, for the captions.
        panel: Side of each panel, pixels.

    Raises:
        ValueError: There is no column.
    """
    if not columns:
        raise ValueError("Nothing to compare: give one or more predictions.")
    triangles = faces.cpu().numpy()
    sigma, uncertain = mean_sigma(columns[-1][1]), ellipse_panels(batch, columns[-1][1], panel)
    rows = [
        [
            Panel(_labelled(batch, place, panel), f"test hand {int(batch.index[place])}"),
            *(
                Panel(
                    mesh_on_image(batch, prediction, place, triangles, panel),
                    _caption(errors, column, place),
                )
                for column, (_, prediction) in enumerate(columns)
            ),
            Panel(uncertain[place], f"mean σ {sigma[place]:.1f} px"),
        ]
        for place in range(len(batch))
    ]
    return sheet(rows, ["labels", *(title for title, _ in columns), "1σ and 2σ"])


def mesh_on_image(
    batch: HandBatch,
    prediction: HandPrediction,
    place: int,
    triangles: Int[np.ndarray, "face 3"],
    panel: int,
) -> UInt8[np.ndarray, "height width 3"]:
    """The mesh where the camera sees it; without a picture, on white and under the labels.

    Args:
        batch: Images, or landmarks alone.
        prediction: Of the batch.
        place: Of the hand in the batch.
        triangles: The hand's faces.
        panel: Side, pixels.
    """
    camera = prediction.intrinsics[place].detach().double().cpu().numpy().copy()
    camera[:2] *= panel / batch.crop_size
    vertices = prediction.vertices[place].detach().double().cpu().numpy()
    shaded = shade(vertices, triangles, camera, panel)
    picture = shaded.over(background(batch.image[place], panel), opacity=0.8)
    return picture if batch.image.numel() else _with_labels(picture, batch, place)


def _seen(batch: HandBatch, place: int, panel: int) -> UInt8[np.ndarray, "height width 3"]:
    """What the model was given: the bare picture, or the landmarks."""
    if batch.image.numel():
        return background(batch.image[place], panel)
    return _labelled(batch, place, panel)


def _labelled(batch: HandBatch, place: int, panel: int) -> UInt8[np.ndarray, "height width 3"]:
    return _with_labels(background(batch.image[place], panel), batch, place)


def _with_labels(
    picture: UInt8[np.ndarray, "height width 3"], batch: HandBatch, place: int
) -> UInt8[np.ndarray, "height width 3"]:
    scale = picture.shape[0] / batch.crop_size
    labels = (batch.landmarks_2d[place] * scale).double().cpu().numpy()
    return draw_landmarks(picture, labels, batch.labelled[place].cpu().numpy())


def _truth_from_the_side(
    batch: HandBatch, place: int, triangles: Int[np.ndarray, "face 3"], panel: int
) -> Panel | None:
    if batch.vertices is None or batch.vertices.shape[1] != triangles.max() + 1:
        return None
    vertices = batch.vertices[place].double().cpu().numpy()
    if not np.isfinite(vertices).all():
        return None
    return Panel(from_the_side(vertices, triangles, panel), "ground truth")


def _caption(errors: Errors | None, column: int, place: int) -> str:
    if errors is None or not np.isfinite(errors[column, place]):
        return ""
    return f"E_J {errors[column, place]:.1f} mm"
