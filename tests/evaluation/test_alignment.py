"""Alignment: equal to SciPy's, with and without reflections, and finite for degenerate points."""

from collections.abc import Callable

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from hand_recon.evaluation.alignment import (
    align_official,
    align_proper,
    align_scale_translation,
    fit_similarity,
    root_relative,
)
from hand_recon.evaluation.point_error import point_errors
from hand_recon.speed.published import scores_by_definition
from tests.support import metric_reference as reference
from tests.support.tolerance import BATCH_SHAPES, assert_close

ALIGNMENTS = {"official": align_official, "proper": align_proper}
Alignment = Callable[[Tensor, Tensor], Tensor]


def cloud(*shape: int, seed: int = 0, size: float = 0.05) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return size * torch.randn(*shape, 3, generator=generator, dtype=torch.float64)


def rotation(seed: int) -> Tensor:
    matrix = torch.linalg.qr(cloud(3, seed=seed, size=1.0))[0]
    return matrix * torch.linalg.det(matrix)


@pytest.mark.parametrize("name", ALIGNMENTS)
@pytest.mark.parametrize("batch", BATCH_SHAPES)
def test_agrees_with_scipy_hand_by_hand(name: str, batch: tuple[int, ...]) -> None:
    ground_truth, prediction = cloud(*batch, 21), cloud(*batch, 21, seed=1) + 0.6
    twin = {"official": scores_by_definition.align_official, "proper": reference.align_proper}[name]
    pairs = zip(ground_truth.reshape(-1, 21, 3), prediction.reshape(-1, 21, 3), strict=True)
    expected = np.stack([twin(t.numpy(), p.numpy()) for t, p in pairs]).reshape(*batch, 21, 3)
    # The offset of 1e-8 on the norms moves the last digits; only the official reference has it.
    tolerance = 1e-12 if name == "official" else 1e-6
    actual = ALIGNMENTS[name](ground_truth, prediction)
    torch.testing.assert_close(actual, torch.from_numpy(expected), rtol=0, atol=tolerance)


@given(
    seed=st.integers(0, 2**31),
    points=st.integers(4, 40),
    noise=st.floats(0, 0.1),
    mirrored=st.booleans(),
    scale=st.floats(0.01, 100),
)
def test_agrees_with_scipy_on_any_pair_of_clouds(
    seed: int, points: int, noise: float, mirrored: bool, scale: float
) -> None:
    ground_truth = cloud(points, seed=seed)
    mirror = torch.tensor([-1.0 if mirrored else 1.0, 1.0, 1.0], dtype=torch.float64)
    prediction = scale * (ground_truth + noise * cloud(points, seed=seed + 1)) * mirror
    expected = scores_by_definition.align_official(ground_truth.numpy(), prediction.numpy())
    actual = align_official(ground_truth, prediction)
    torch.testing.assert_close(actual, torch.from_numpy(expected), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("align", ALIGNMENTS.values(), ids=ALIGNMENTS)
def test_a_similarity_of_the_prediction_changes_nothing(align: Alignment) -> None:
    ground_truth, prediction = cloud(5, 21), cloud(5, 21, seed=1)
    moved = 3.0 * prediction @ rotation(2) + torch.tensor([0.1, -2.0, 0.6], dtype=torch.float64)
    torch.testing.assert_close(
        align(ground_truth, moved), align(ground_truth, prediction), rtol=0, atol=1e-7
    )


@pytest.mark.parametrize("align", ALIGNMENTS.values(), ids=ALIGNMENTS)
def test_aligning_twice_is_aligning_once_up_to_scale(align: Alignment) -> None:
    ground_truth, prediction = cloud(5, 21), cloud(5, 21, seed=1)
    once = align(ground_truth, prediction)
    torch.testing.assert_close(align(ground_truth, once), once, rtol=0, atol=1e-7)


def test_a_mirrored_hand_has_no_error_officially_and_a_large_one_without_reflections() -> None:
    ground_truth = cloud(4, 21)
    mirrored = ground_truth * torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64)
    assert point_errors(ground_truth, align_official(ground_truth, mirrored)).max() < 1e-7
    assert (
        point_errors(ground_truth, align_proper(ground_truth, mirrored)).mean(dim=-1) > 0.01
    ).all()
    assert fit_similarity(ground_truth, mirrored, reflections=True).mirrors.all()
    assert not fit_similarity(ground_truth, mirrored, reflections=False).mirrors.any()


def test_both_alignments_are_equal_for_a_good_prediction() -> None:
    ground_truth = cloud(50, 21)
    prediction = ground_truth + cloud(50, 21, seed=1, size=0.002)
    assert torch.equal(
        align_official(ground_truth, prediction), align_proper(ground_truth, prediction)
    )


def test_proper_alignment_is_the_best_of_all_rotations() -> None:
    ground_truth, prediction = cloud(21), cloud(21, seed=1)
    best = fit_similarity(ground_truth, prediction, reflections=False)
    error = (ground_truth - best.apply(prediction)).square().sum()
    for seed in range(200):
        rotated = (prediction - best.source) @ rotation(seed) * best.scale + best.target
        assert (ground_truth - rotated).square().sum() >= error


@pytest.mark.parametrize("align", ALIGNMENTS.values(), ids=ALIGNMENTS)
def test_a_prediction_without_extent_goes_to_the_centre(align: Alignment) -> None:
    ground_truth = cloud(3, 21)
    aligned = align(ground_truth, torch.full((3, 21, 3), 0.7, dtype=torch.float64))
    torch.testing.assert_close(
        aligned, ground_truth.mean(dim=1, keepdim=True).expand_as(ground_truth)
    )


@pytest.mark.parametrize("align", ALIGNMENTS.values(), ids=ALIGNMENTS)
@pytest.mark.parametrize(
    "prediction",
    [torch.zeros(21, 3), torch.ones(21, 3), torch.linspace(0, 1, 21)[:, None].expand(21, 3)],
    ids=["zeros", "one point", "a line"],
)
def test_degenerate_clouds_stay_finite(align: Alignment, prediction: Tensor) -> None:
    assert align(cloud(21), prediction).isfinite().all()
    assert align(prediction, cloud(21)).isfinite().all()


def test_single_precision_comes_back_double() -> None:
    assert align_official(cloud(21).float(), cloud(21).float()).dtype == torch.float64


def test_root_relative_puts_the_root_at_the_origin() -> None:
    points = cloud(2, 21)
    assert_close(root_relative(points, points[:, 0])[:, 0], torch.zeros(2, 3).double())


def test_scale_and_translation_do_not_rotate_the_hand() -> None:
    ground_truth = cloud(2, 21)
    rotated = 2.5 * ground_truth @ rotation(1) + 0.3
    aligned = align_scale_translation(ground_truth, rotated)
    expected = (ground_truth - ground_truth[:, :1]) @ rotation(1) + ground_truth[:, :1]
    assert_close(aligned, expected)


def test_scale_and_translation_of_one_point_is_the_wrist() -> None:
    ground_truth = cloud(21)
    aligned = align_scale_translation(ground_truth, torch.zeros(21, 3))
    assert_close(aligned, ground_truth[:1].expand(21, 3))
