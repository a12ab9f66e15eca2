"""Benchmark of the two solvers of a fit: loss, accuracy and processor time on synthetic views.

    python -m tools.benchmark_fit                  # level hard
    python -m tools.benchmark_fit --level easy --hands 100

Both fit the same batches in turn in one process, so that a busy machine slows both alike. Numbers in
decision 62 are from here.
"""

import argparse
import time
from pathlib import Path

import torch
from torch import Tensor

from hand_recon.data.synthetic.dataset import SyntheticHands
from hand_recon.evaluation.metrics import HandMetrics
from hand_recon.evaluation.scores import HandPoints
from hand_recon.fitting.descent import SOLVERS, Descent, fit
from hand_recon.fitting.objective import Objective
from hand_recon.fitting.observation import observed
from hand_recon.hand.open_hand import open_hand
from hand_recon.knowledge.prior import Prior
from hand_recon.uncertainty import NegativeLogLikelihood, SquaredError, Staged


def pa_mpjpe(found: Tensor, expected: Tensor | None) -> Tensor:
    """PA-MPJPE (E_J) of each hand, millimetres."""
    if expected is None:
        raise ValueError("Found views without 3D landmarks; expected those of synthetic hands.")
    metrics = HandMetrics()
    index = torch.arange(len(found))
    metrics.update(HandPoints(found, None), HandPoints(expected, None), index)
    return metrics.per_hand()[1]["E_J"]


def main() -> None:
    """Fit by both solvers, and print the comparison."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else None)
    parser.add_argument("--level", default="hard")
    parser.add_argument("--hands", type=int, default=200)
    parser.add_argument("--batch", type=int, default=64)
    parser.add_argument("--cache", type=Path, default=Path("outputs/cache"))
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    views = SyntheticHands(
        "test", arguments.hands, 224, arguments.level, cache_dir=arguments.cache, pictures=False,
        with_vertices=False,
    )  # fmt: skip
    batch, hand = views.batch(list(range(arguments.hands))), open_hand()
    term = Staged(SquaredError(), NegativeLogLikelihood(), switch_at=0.5)
    objective = Objective(hand, Prior.default(hand), term)
    seconds, losses, points = (
        dict.fromkeys(SOLVERS, 0.0), {s: [] for s in SOLVERS}, {s: [] for s in SOLVERS}
    )  # type: tuple[dict[str, float], dict[str, list[Tensor]], dict[str, list[Tensor]]]  # fmt: skip
    for first in range(0, arguments.hands, arguments.batch):
        seen = observed(batch.select(slice(first, first + arguments.batch)))
        for solver in SOLVERS:
            began = time.process_time()
            found = fit(seen, objective, descent=Descent(solver=solver))
            seconds[solver] += time.process_time() - began
            losses[solver].append(found.loss["total"])
            points[solver].append(found.prediction.landmarks_3d)
    loss = {solver: torch.cat(values) for solver, values in losses.items()}
    error = {s: pa_mpjpe(torch.cat(values), batch.landmarks_3d) for s, values in points.items()}
    for solver in SOLVERS:
        time_each, errors = seconds[solver] / arguments.hands * 1e3, error[solver]
        print(
            f"{solver:13} {time_each:7.1f} ms per hand, loss {loss[solver].mean():7.2f}, "
            f"PA-MPJPE {errors.mean():.2f} mm, median {errors.median():.2f}"
        )
    second, adam = SOLVERS
    within = (loss[second] <= loss[adam] + 0.005 * loss[adam].abs()).float().mean()
    change = error[second] - error[adam]
    half = 1.96 * float(change.std()) / len(change) ** 0.5
    print(f"loss at most 0.5 % above Adam's: {within:.1%} of the hands")
    print(f"PA-MPJPE minus Adam's: {change.mean():+.2f} mm, 95 % interval ± {half:.2f}")


if __name__ == "__main__":
    main()
