"""Scores of hands that are spread over processes unevenly: those of one process with all of them."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import pytest
import torch
from torchmetrics import Metric
from torchmetrics.utilities import dim_zero_cat

from hand_recon.evaluation.calibration import Calibration
from hand_recon.evaluation.landmarks_2d import Landmarks2D
from hand_recon.evaluation.metrics import HandMetrics
from hand_recon.evaluation.plausibility import Plausibility
from hand_recon.evaluation.scores import HandPoints
from hand_recon.knowledge.ranges import load_ranges

HANDS = 11
"""Size of a test set that neither two nor three processes share evenly."""


def draws(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed))


TRUTH = HandPoints(draws(HANDS, 21, 3, seed=1) * 0.05, draws(HANDS, 40, 3, seed=2) * 0.05)
FOUND = HandPoints(draws(HANDS, 21, 3, seed=3) * 0.05, draws(HANDS, 40, 3, seed=4) * 0.05)
LABELLED = draws(HANDS, 21, seed=5) > -0.5


class Depths:
    """Depths of vertices, a tenth of which are beyond the tolerance."""

    tolerance = 0.002

    def depths(self, vertices: torch.Tensor) -> torch.Tensor:
        """Their third coordinate, where it is large."""
        return (vertices[..., 2] - 0.1).clamp(min=0)


def add_points(metric: HandMetrics, hands: torch.Tensor) -> None:
    metric.update(FOUND[hands], TRUTH[hands], hands)


def add_landmarks(metric: Landmarks2D, hands: torch.Tensor) -> None:
    found, truth = draws(HANDS, 21, 2, seed=6) * 20, draws(HANDS, 21, 2, seed=7) * 20
    metric.update(found[hands], truth[hands], LABELLED[hands], hands, crop_size=224)


def add_angles(metric: Plausibility, hands: torch.Tensor) -> None:
    assert FOUND.vertices is not None
    metric.update(draws(HANDS, 15, 3, seed=8)[hands], FOUND.vertices[hands], hands)


def add_sigma(metric: Calibration, hands: torch.Tensor) -> None:
    residual, log_sigma = draws(HANDS, 21, 2, seed=9) * 5, draws(HANDS, 21, 2, seed=10)
    noise = draws(HANDS, 21, seed=11).abs()
    metric.update(residual[hands], log_sigma[hands], LABELLED[hands], noise[hands], hands)


KINDS: dict[str, tuple[Callable[[], Metric], Callable[[Any, torch.Tensor], None]]] = {
    "3D": (HandMetrics, add_points),
    "2D": (Landmarks2D, add_landmarks),
    "plausibility": (lambda: Plausibility(load_ranges("literature"), Depths()), add_angles),
    "calibration": (Calibration, add_sigma),
}

SHARES: dict[str, list[Sequence[int]]] = {
    "of two": [range(0, 11, 2), range(1, 11, 2)],
    "of three": [range(0, 11, 3), range(1, 11, 3), range(2, 11, 3)],
    "of three with repeated hands": [[0, 3, 6, 9], [1, 4, 7, 10], [2, 5, 8, 0]],
    "of three of which one has none": [range(0, 4), [], range(4, 11)],
}


def filled(kind: str, hands: Sequence[int]) -> Metric:
    """A metric of some hands, in batches of three."""
    make, add = KINDS[kind]
    metric = make()
    for batch in torch.tensor(list(hands), dtype=torch.int64).split(3):
        if len(batch):
            add(metric, batch)
    return metric


def states_of(metrics: list[Metric]) -> list[list[torch.Tensor]]:
    """Each state of all processes, in the order in which a metric gathers them."""
    names = metrics[0]._reductions
    return [[dim_zero_cat(getattr(metric, name)) for metric in metrics] for name in names]


def gather(states: list[list[torch.Tensor]]) -> Callable[..., list[torch.Tensor]]:
    """Gather as `torch.distributed` does: at each call, the next state of all processes."""
    left: Iterator[list[torch.Tensor]] = iter(states)

    def next_state(own: torch.Tensor, group: object = None) -> list[torch.Tensor]:
        everyone = next(left)
        # NaN, for a missing label, equals nothing.
        assert any(own.nan_to_num().equal(one.nan_to_num()) for one in everyone)
        # What it needs of all processes: one type, and one shape but for the number of rows.
        assert len({(one.dtype, one.shape[1:]) for one in everyone}) == 1
        return everyone

    return next_state


@pytest.mark.filterwarnings("ignore:The ``compute`` method of metric")
@pytest.mark.parametrize("share", SHARES)
@pytest.mark.parametrize("kind", KINDS)
def test_scores_of_all_processes_are_those_of_one(kind: str, share: str) -> None:
    expected = filled(kind, range(HANDS)).compute()
    assert expected
    metrics = [filled(kind, hands) for hands in SHARES[share]]
    states = states_of(metrics)
    for metric in metrics:
        metric.sync(dist_sync_fn=gather(states), distributed_available=lambda: True)
    for metric in metrics:
        # The wrapper would gather once more.
        found = type(metric).compute.__get__(metric)()
        assert found == pytest.approx(expected, rel=1e-12, abs=1e-12)
