"""The distance to the mean pose in the space of a PCA, and its table."""

from pathlib import Path

import numpy as np
import pytest
import torch

import build_pose_components
from hand_recon.knowledge import pose_components
from hand_recon.knowledge.pose_components import PoseComponents
from tests.support.tolerance import BATCH_SHAPES, assert_close


@pytest.fixture(scope="module")
def shipped() -> dict[str, np.ndarray]:
    path = Path(pose_components.__file__).parent / pose_components.TABLE
    with np.load(path, allow_pickle=False) as archive:
        return {name: archive[name].astype(float) for name in archive.files}


@pytest.fixture(scope="module")
def distance() -> PoseComponents:
    return PoseComponents().double()


def pose(flat: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(flat).reshape(*flat.shape[:-1], 15, 3)


def test_the_mean_pose_costs_nothing(
    distance: PoseComponents, shipped: dict[str, np.ndarray]
) -> None:
    leaf = pose(shipped["mean"]).requires_grad_()
    value = distance(leaf)
    value.backward()
    assert value.item() == 0.0
    assert leaf.grad is not None
    assert leaf.grad.count_nonzero() == 0


@pytest.mark.parametrize("component", [0, 1, 7, 44])
def test_a_standard_deviation_along_a_component_costs_one(
    distance: PoseComponents, shipped: dict[str, np.ndarray], component: int
) -> None:
    step = shipped["components"][component] * shipped["deviations"][component]
    # The table is in single precision: its components are a unit long to about 1e-6.
    for size, expected in ((1.0, 1.0), (-2.0, 4.0)):
        value = distance(pose(shipped["mean"] + size * step))
        torch.testing.assert_close(
            value, torch.tensor(expected, dtype=torch.float64), rtol=1e-4, atol=0
        )


@pytest.mark.parametrize("shape", BATCH_SHAPES)
def test_agrees_with_the_definition_written_out(
    distance: PoseComponents, shipped: dict[str, np.ndarray], shape: tuple[int, ...]
) -> None:
    angles = torch.randn(*shape, 15, 3, dtype=torch.float64)
    expected = []
    for hand in angles.reshape(-1, 45).numpy():
        total = 0.0
        for row, deviation in zip(shipped["components"], shipped["deviations"], strict=True):
            total += (float(row @ (hand - shipped["mean"])) / deviation) ** 2
        expected.append(total)
    found = distance(angles)
    assert found.shape == shape
    torch.testing.assert_close(
        found, torch.tensor(expected, dtype=torch.float64).reshape(shape), rtol=1e-5, atol=0
    )


def test_gradient_matches_finite_differences(distance: PoseComponents) -> None:
    angles = torch.randn(2, 15, 3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(distance, angles)


def test_far_outside_values_and_gradients_are_finite() -> None:
    leaf = torch.full((15, 3), 1e4, requires_grad=True)
    PoseComponents()(leaf).backward()
    assert leaf.grad is not None
    assert leaf.grad.isfinite().all()


def test_components_are_orthonormal_and_by_decreasing_spread(
    shipped: dict[str, np.ndarray],
) -> None:
    components, deviations = shipped["components"], shipped["deviations"]
    np.testing.assert_allclose(components @ components.T, np.eye(45), atol=1e-5)
    assert (np.diff(deviations) <= 0).all()
    assert deviations[-1] == pytest.approx(np.radians(2), rel=1e-6)


def test_the_shipped_table_is_what_the_tool_builds(shipped: dict[str, np.ndarray]) -> None:
    built = build_pose_components.tables()
    assert set(built) == set(shipped)
    np.testing.assert_allclose(built["mean"], shipped["mean"], atol=1e-6)
    np.testing.assert_allclose(built["deviations"], shipped["deviations"], rtol=1e-5)
    # Components up to their sign; those of the smallest deviations may rotate within their space.
    spread = built["deviations"] > 1.01 * np.radians(2)
    cosine = np.abs((built["components"] * shipped["components"]).sum(axis=1))
    np.testing.assert_allclose(cosine[spread], 1.0, atol=1e-3)


def test_a_missing_table_is_told_how_to_come_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pose_components, "TABLE", "tables/absent.npz")
    with pytest.raises(FileNotFoundError, match=r"build_pose_components\.py"):
        PoseComponents()


def test_whoever_is_asked_for_it_gets_it_in_the_precision_of_the_pose() -> None:
    assert PoseComponents()(torch.zeros(15, 3)).dtype == torch.float32
    assert_close(
        PoseComponents()(torch.zeros(15, 3, dtype=torch.float64)),
        PoseComponents()(torch.zeros(15, 3)),
    )
