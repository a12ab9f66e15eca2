"""Ellipses have the axes and the angle of their covariance."""

import numpy as np
import pytest
import torch

from hand_recon.schema import HandBatch, HandPrediction
from hand_recon.visualization.ellipses import (
    covariances,
    draw_ellipses,
    ellipse_panels,
    principal_axes,
)
from hand_recon.visualization.overlay import FINGER_COLOURS
from tests.support.tolerance import BATCH_SHAPES

WHITE = np.full((200, 200, 3), 255, dtype=np.uint8)


def one_ellipse(covariance: np.ndarray) -> np.ndarray:
    """Mask of the pixels of one ellipse, the index fingertip's, in the middle of an image."""
    landmarks, matrices = np.full((21, 2), 100.0), np.tile(covariance, (21, 1, 1))
    shown = np.arange(21) == 8
    drawn = draw_ellipses(WHITE, landmarks, matrices, shown)
    return np.asarray((drawn != 255).any(axis=-1))


def covariance_of(sigma_u: float, sigma_v: float, correlation: float) -> np.ndarray:
    mixed = correlation * sigma_u * sigma_v
    return np.array([[sigma_u**2, mixed], [mixed, sigma_v**2]])


def test_the_outer_ellipse_is_four_sigma_wide_and_high() -> None:
    """σ_u = 20 and σ_v = 8 px: two σ to either side are 80 px across and 32 px down."""
    rows, columns = np.nonzero(one_ellipse(covariance_of(20.0, 8.0, 0.0)))
    assert abs(np.ptp(columns) + 1 - 80) <= 3
    assert abs(np.ptp(rows) + 1 - 32) <= 3
    assert abs(columns.mean() + 0.5 - 100) < 0.3
    assert abs(rows.mean() + 0.5 - 100) < 0.3


def test_the_filled_ellipse_has_the_area_of_one_sigma() -> None:
    """π · 20 · 8 = 503 px², tinted in the finger's colour at an opacity of 0.35."""
    landmarks, matrices = (
        np.full((21, 2), 100.0),
        np.tile(covariance_of(20.0, 8.0, 0.0), (21, 1, 1)),
    )
    drawn = draw_ellipses(WHITE, landmarks, matrices, np.arange(21) == 8)
    tinted = 0.35 * np.array(FINGER_COLOURS[1]) + 0.65 * 255
    filled = np.asarray((np.abs(drawn - tinted) < 3).all(axis=-1))
    assert abs(filled.sum() / (np.pi * 20 * 8) - 1) < 0.08
    assert filled[99, 99]


@pytest.mark.parametrize("correlation", [0.9, -0.9])
def test_a_correlation_slants_the_ellipse(correlation: float) -> None:
    """With equal σ the axes lie at 45°, √(1 ± ρ) σ long; v points down, so ρ > 0 falls to the right."""
    mask = one_ellipse(covariance_of(20.0, 20.0, correlation))
    diagonal = np.array([1.0, np.sign(correlation)]) / np.sqrt(2)
    rows, columns = np.nonzero(mask)
    points = np.stack([columns, rows], axis=1) + 0.5 - 100.0
    along, across = points @ diagonal, points @ np.array([-diagonal[1], diagonal[0]])
    assert abs(np.ptp(along) - 4 * 20 * np.sqrt(1.9)) < 4
    assert abs(np.ptp(across) - 4 * 20 * np.sqrt(0.1)) < 4


def test_principal_axes_rebuild_the_covariance() -> None:
    generator = np.random.default_rng(0)
    roots = generator.normal(size=(50, 2, 2))
    matrices = roots @ roots.transpose(0, 2, 1)
    halves, angles = principal_axes(matrices)
    assert (halves[:, 0] >= halves[:, 1]).all()
    rotation = np.array([[np.cos(angles), -np.sin(angles)], [np.sin(angles), np.cos(angles)]])
    rotation = rotation.transpose(2, 0, 1)
    rebuilt = rotation @ (halves[:, :, None] ** 2 * rotation.transpose(0, 2, 1))
    np.testing.assert_allclose(rebuilt, matrices, atol=1e-12)


@pytest.mark.parametrize("shape", BATCH_SHAPES)
def test_sigma_is_in_pixels_of_a_224_crop_whatever_the_images_size(
    shape: tuple[int, ...],
) -> None:
    log_sigma = torch.log(torch.tensor([4.0, 2.0])).expand(*shape, 21, 2)
    matrices = covariances(log_sigma, torch.full((*shape, 21), 0.5), 448)
    assert matrices.shape == (*shape, 21, 2, 2)
    expected = np.array([[64.0, 16.0], [16.0, 16.0]])
    np.testing.assert_allclose(matrices, np.broadcast_to(expected, matrices.shape), rtol=1e-6)
    uncorrelated = covariances(log_sigma, None, 224)
    np.testing.assert_allclose(uncorrelated[..., 0, 1], 0.0)


def test_what_is_not_finite_or_enormous_does_no_harm() -> None:
    landmarks, matrices = np.full((21, 2), 50.0), np.tile(np.eye(2), (21, 1, 1))
    landmarks[3] = np.nan
    matrices[4] = np.inf
    matrices[5] = np.eye(2) * 1e30
    matrices[6] = 0.0
    assert draw_ellipses(WHITE, landmarks, matrices).shape == WHITE.shape
    nothing = draw_ellipses(WHITE, np.full((21, 2), np.nan), matrices)
    assert (nothing == 255).all()


def test_the_image_that_is_drawn_on_is_not_changed() -> None:
    before = WHITE.copy()
    draw_ellipses(WHITE, np.full((21, 2), 50.0), np.tile(np.eye(2) * 9, (21, 1, 1)))
    assert (before == WHITE).all()


def test_an_uncertain_landmark_has_more_ink_and_no_image_is_white(
    scene: tuple[HandBatch, HandPrediction], without_image: HandBatch
) -> None:
    batch, prediction = scene
    log_sigma = torch.zeros(2, 21, 2)
    log_sigma[1] = 2.0
    uncertain = HandPrediction(**(vars(prediction) | {"log_sigma": log_sigma}))
    panels = ellipse_panels(batch, uncertain, 128)
    assert [panel.shape for panel in panels] == [(128, 128, 3)] * 2
    ink = [(panel != 128).any(axis=-1).sum() for panel in panels]
    assert ink[1] > 1.5 * ink[0]
    white = ellipse_panels(without_image, uncertain, 128)
    assert (white[0][0, 0] == 255).all()
    assert (white[0] != 255).any()
