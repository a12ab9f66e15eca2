"""The paper's figures: the effect of knowledge (Fig. 3) and of the likelihood (Fig. 4) on single hands."""

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
    """Mean σ over the coordinates of each hand's landmarks, pixels of a 224-pixel crop."""
    return prediction.log_sigma.detach().double().exp().mean(dim=(-2, -1)).cpu().numpy()


def rank_by_uncertainty(
    batch: HandBatch, prediction: HandPrediction, count: int = 6, panel: int = 224
) -> Sheet:
    """Draw the hands of largest and of smallest mean σ, each with its ellipses below it (Fig. 4b).

    Args:
        batch: Images with their labels.
        prediction: Predictions for these images.
        count: Hands of largest and hands of smallest σ; at most half of the hands each.
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
    for hands in ends.values():
        rows.append([Panel(_input(batch, hand, panel)) for hand in hands])
        rows.append(
            [
                Panel(
                    with_ellipses[hand],
                    f"test hand {int(batch.index[hand])}: σ {sigma[hand]:.1f} px",
                )
                for hand in hands
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
    """Draw every hand as several models predict it, from the front and from the side (Fig. 3).

    The first column has the labels on the image, and the ground-truth mesh from the side where there is one
    with these triangles.

    Args:
        columns: Titles, and each model's predictions for the batch.
        batch: Images with their labels.
        faces: Triangles of the hand.
        errors: E_J of each column and hand, millimetres, for the captions.
        panel: Side of each panel, pixels.

    Raises:
        ValueError: There is no column.
    """
    if not columns:
        raise ValueError(
            "Found no prediction to compare; expected one or more predictions. Give a column."
        )
    triangles = faces.cpu().numpy()
    rows: list[list[Panel | None]] = []
    for hand in range(len(batch)):
        front: list[Panel | None] = [Panel(_labelled(batch, hand, panel))]
        side = [_ground_truth_from_the_side(batch, hand, triangles, panel)]
        for column, (_, prediction) in enumerate(columns):
            front.append(Panel(mesh_on_image(batch, prediction, hand, triangles, panel)))
            vertices = prediction.vertices[hand].detach().double().cpu().numpy()
            caption = _caption(errors, column, hand)
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
    """Draw a row per hand: its labels, each model's mesh, and the last model's ellipses (Fig. 4a).

    Args:
        columns: Titles, and each model's predictions for the batch; the last model has learnt σ.
        batch: Images with their labels.
        faces: Triangles of the hand.
        errors: E_J of each column and hand, millimetres, for the captions.
        panel: Side of each panel, pixels.

    Raises:
        ValueError: There is no column.
    """
    if not columns:
        raise ValueError(
            "Found no prediction to compare; expected one or more predictions. Give a column."
        )
    triangles = faces.cpu().numpy()
    sigma, uncertain = mean_sigma(columns[-1][1]), ellipse_panels(batch, columns[-1][1], panel)
    rows = [
        [
            Panel(_labelled(batch, hand, panel), f"test hand {int(batch.index[hand])}"),
            *(
                Panel(
                    mesh_on_image(batch, prediction, hand, triangles, panel),
                    _caption(errors, column, hand),
                )
                for column, (_, prediction) in enumerate(columns)
            ),
            Panel(uncertain[hand], f"mean σ {sigma[hand]:.1f} px"),
        ]
        for hand in range(len(batch))
    ]
    return sheet(rows, ["labels", *(title for title, _ in columns), "1σ and 2σ"])


def mesh_on_image(
    batch: HandBatch,
    prediction: HandPrediction,
    hand: int,
    triangles: Int[np.ndarray, "face 3"],
    panel: int,
) -> UInt8[np.ndarray, "height width 3"]:
    """Draw the predicted mesh on the image; without an image, on white with the labels over it.

    Args:
        batch: Images, or landmarks without images.
        prediction: Predictions for the batch.
        hand: Index of the hand in the batch.
        triangles: Triangles of the hand.
        panel: Side of the panel, pixels.
    """
    camera = prediction.intrinsics[hand].detach().double().cpu().numpy().copy()
    camera[:2] *= panel / batch.crop_size
    vertices = prediction.vertices[hand].detach().double().cpu().numpy()
    shaded = shade(vertices, triangles, camera, panel)
    image = shaded.over(background(batch.image[hand], panel), opacity=0.8)
    return image if batch.image.numel() else _with_labels(image, batch, hand)


def _input(batch: HandBatch, hand: int, panel: int) -> UInt8[np.ndarray, "height width 3"]:
    """Draw the input of the model: the image, or the landmarks."""
    if batch.image.numel():
        return background(batch.image[hand], panel)
    return _labelled(batch, hand, panel)


def _labelled(batch: HandBatch, hand: int, panel: int) -> UInt8[np.ndarray, "height width 3"]:
    return _with_labels(background(batch.image[hand], panel), batch, hand)


def _with_labels(
    image: UInt8[np.ndarray, "height width 3"], batch: HandBatch, hand: int
) -> UInt8[np.ndarray, "height width 3"]:
    scale = image.shape[0] / batch.crop_size
    labels = (batch.landmarks_2d[hand] * scale).double().cpu().numpy()
    return draw_landmarks(image, labels, batch.labelled[hand].cpu().numpy())


def _ground_truth_from_the_side(
    batch: HandBatch, hand: int, triangles: Int[np.ndarray, "face 3"], panel: int
) -> Panel | None:
    if batch.vertices is None or batch.vertices.shape[1] != triangles.max() + 1:
        return None
    vertices = batch.vertices[hand].double().cpu().numpy()
    if not np.isfinite(vertices).all():
        return None
    return Panel(from_the_side(vertices, triangles, panel), "ground truth")


def _caption(errors: Errors | None, column: int, hand: int) -> str:
    if errors is None or not np.isfinite(errors[column, hand]):
        return ""
    return f"E_J {errors[column, hand]:.1f} mm"
