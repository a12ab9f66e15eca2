"""The figures show the right hands in the right panels."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
import torch

from hand_recon.hand.model import HandModel
from hand_recon.schema import HandBatch, HandPrediction
from hand_recon.visualization import paper_figures as figures
from hand_recon.visualization.canvas import Panel, background, sheet
from hand_recon.visualization.paper_figures import (
    before_after,
    likelihood_effect,
    mean_sigma,
    mesh_on_image,
    rank_by_uncertainty,
)

Scene = tuple[HandBatch, HandPrediction]


def plain(grey: int, side: int = 100) -> np.ndarray:
    return np.full((side, side, 3), grey, dtype=np.uint8)


def repeated(scene: Scene, count: int) -> Scene:
    """Several copies of the first hand, numbered from 0."""
    batch, prediction = scene
    first = torch.zeros(count, dtype=torch.int64)
    batch = replace(
        batch._map(lambda tensor: tensor[first]), source=("a",) * count, index=torch.arange(count)
    )
    return batch, prediction._map(lambda tensor: tensor[first])


def captions_of(draw: object, *arguments: object) -> list[list[str]]:
    """The captions of the sheet that a figure would draw."""
    with patch.object(figures, "sheet", return_value=plain(0)) as drawn:
        draw(*arguments)  # type: ignore[operator]  # one of the figures
    return [[panel.caption if panel else "" for panel in row] for row in drawn.call_args.args[0]]


def test_panels_stand_in_their_rows_and_columns() -> None:
    rows: list[list[Panel | None]] = [
        [Panel(plain(10), "a"), Panel(plain(90))],
        [None, Panel(plain(200))],
    ]
    image = sheet(rows, ["first", "second"], ["upper", "lower"])
    found = {grey: np.argwhere((image == grey).all(axis=-1)).mean(axis=0) for grey in (10, 90, 200)}
    assert found[10][1] < found[90][1]
    assert abs(found[10][0] - found[90][0]) < 3
    assert found[200][0] > found[90][0] + 90
    assert abs(found[200][1] - found[90][1]) < 3


@pytest.mark.parametrize("rows", [[], [[]], [[Panel(plain(0))], []]])
def test_a_sheet_needs_rows_of_one_length(rows: list[list[Panel | None]]) -> None:
    with pytest.raises(ValueError, match="expected rows of one length"):
        sheet(rows)


def test_a_crop_is_enlarged_and_no_crop_is_white(scene: Scene) -> None:
    batch, _ = scene
    assert (background(batch.image[0], 96) == 128).all()
    assert (background(batch.image[0].float() / 255, 96) == 128).all()
    assert (background(torch.zeros(3, 0, 0, dtype=torch.uint8), 96) == 255).all()


def test_mean_sigma_is_over_all_coordinates(scene: Scene) -> None:
    """Half of the coordinates 2 px, half 6 px: 4 px."""
    _, prediction = scene
    log_sigma = torch.log(torch.tensor([2.0, 6.0])).expand(2, 21, 2)
    np.testing.assert_allclose(mean_sigma(replace(prediction, log_sigma=log_sigma)), 4.0, rtol=1e-6)


def test_hands_are_ranked_from_the_most_uncertain_and_from_the_most_certain(scene: Scene) -> None:
    batch, prediction = repeated(scene, 6)
    sigma = torch.tensor([3.0, 9.0, 1.0, 5.0, 7.0, 2.0])
    prediction = replace(prediction, log_sigma=sigma.log()[:, None, None].expand(6, 21, 2))
    captions = captions_of(rank_by_uncertainty, batch, prediction, 2)
    assert captions[1] == ["test hand 1: σ 9.0 px", "test hand 4: σ 7.0 px"]
    assert captions[3] == ["test hand 2: σ 1.0 px", "test hand 5: σ 2.0 px"]


def test_few_hands_are_ranked_without_any_twice(scene: Scene) -> None:
    batch, prediction = repeated(scene, 3)
    captions = captions_of(rank_by_uncertainty, batch, prediction, 6)
    assert [len(row) for row in captions] == [1, 1, 1, 1]
    image = rank_by_uncertainty(batch, prediction, 6, 48)
    assert image.dtype == np.uint8


def test_before_and_after_has_a_column_per_model_and_two_views_per_hand(
    scene: Scene, hand: HandModel
) -> None:
    batch, prediction = scene
    errors = np.array([[22.44, 20.0], [8.5, np.nan]])
    columns = [("No Knowledge", prediction), ("+NLL", prediction)]
    captions = captions_of(before_after, columns, batch, hand.faces, errors)
    assert captions == [
        ["", "", ""], ["", "E_J 22.4 mm", "E_J 8.5 mm"], ["", "", ""], ["", "E_J 20.0 mm", ""],
    ]  # fmt: skip
    assert before_after(columns, batch, hand.faces, errors, 48).ndim == 3


def test_ground_truth_is_shown_from_the_side_where_there_is_one(
    scene: Scene, hand: HandModel
) -> None:
    batch, prediction = scene
    vertices = prediction.vertices.clone()
    vertices[1] = float("nan")
    batch = replace(batch, vertices=vertices)
    captions = captions_of(before_after, [("a", prediction)], batch, hand.faces)
    assert captions[1][0] == "ground truth"
    assert captions[3][0] == ""
    other_mesh = replace(batch, vertices=prediction.vertices[:, :100])
    assert captions_of(before_after, [("a", prediction)], other_mesh, hand.faces)[1][0] == ""


def test_the_likelihoods_figure_ends_with_the_last_models_ellipses(
    scene: Scene, hand: HandModel
) -> None:
    batch, prediction = scene
    certain = replace(prediction, log_sigma=torch.full((2, 21, 2), -1.0))
    columns = [("+Physics", certain), ("+NLL", prediction)]
    captions = captions_of(likelihood_effect, columns, batch, hand.faces)
    assert captions[0] == ["test hand 0", "", "", "mean σ 1.0 px"]


def test_without_an_image_the_mesh_lies_under_its_labels_on_white(
    scene: Scene, without_image: HandBatch, hand: HandModel
) -> None:
    _, prediction = scene
    scale = torch.tensor([3.5, 3.5, 1.0])[:, None]
    enlarged = replace(prediction, intrinsics=prediction.intrinsics * scale)
    image = mesh_on_image(without_image, enlarged, 0, hand.faces.numpy(), 224)
    assert (image[0, 0] == 255).all()
    tip = without_image.landmarks_2d[0, 8].floor().int().tolist()
    assert tuple(image[tip[1], tip[0]]) == (240, 190, 20)


def test_a_figure_of_no_model_is_refused(scene: Scene, hand: HandModel) -> None:
    batch, _ = scene
    for figure in (before_after, likelihood_effect):
        with pytest.raises(ValueError, match="expected one or more predictions"):
            figure([], batch, hand.faces)
