"""Benchmark of the metrics on FreiHAND's 3,960 test frames on one core, against a frame-by-frame version.

The frame-by-frame version has the structure of the official script: SciPy aligns one frame at a time, errors
are collected point by point, and each of the four F-scores builds a KD-tree per surface. Run it with
`python -m tools.benchmark_evaluation`; it prints seconds of processor time, which other programs on the
machine disturb less than wall-clock time.
"""

import argparse
import time
from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from hand_recon.evaluation.metrics import HandMetrics
from hand_recon.evaluation.scores import HandPoints
from hand_recon.hand.open_hand import open_hand
from hand_recon.protocols.official import freihand_scores
from tests.support import metric_reference as reference

BATCH = 64


def posed_hands(count: int, *, angle_error: float, seed: int = 0) -> tuple[HandPoints, HandPoints]:
    """Open hands in random poses, and predictions with errors of joint angles and translation."""
    generator = torch.Generator().manual_seed(seed)
    hand = open_hand()

    def posed(angles: torch.Tensor, translation: torch.Tensor) -> HandPoints:
        geometry = hand(angles, torch.zeros(count, 10))
        return HandPoints(geometry.landmarks + translation, geometry.vertices + translation)

    def random(*shape: int) -> torch.Tensor:
        return torch.randn(count, *shape, generator=generator)

    axes = torch.tensor([1.0, 0.3, 0.1])
    angles = 0.3 * random(15, 3) * axes
    translation = torch.tensor([0.0, 0.0, 0.6])
    ground_truth = posed(angles, translation)
    return ground_truth, posed(
        angles + angle_error * random(15, 3) * axes, translation + 0.02 * random(1, 3)
    )


def frame_by_frame(ground_truth: HandPoints, prediction: HandPoints) -> dict[str, float]:
    """FreiHAND's scores, computed as in its script."""
    pairs = {
        name: (
            getattr(ground_truth, points).double().numpy(),
            getattr(prediction, points).double().numpy(),
        )
        for name, points in {"xyz": "landmarks", "mesh": "vertices"}.items()
    }
    errors: dict[str, list[list[float]]] = {}
    agreement: dict[str, list[float]] = {}
    for frame in range(len(ground_truth)):
        for name, (points, predicted) in pairs.items():
            aligned = reference.align_official(points[frame], predicted[frame])
            for suffix, moved in {"": predicted[frame], "_al": aligned}.items():
                filed = errors.setdefault(name + suffix, [[] for _ in points[frame]])
                for of_point, one, other in zip(filed, points[frame], moved, strict=True):
                    of_point.append(float(np.linalg.norm(one - other)))
                if name == "mesh":
                    for threshold in (5, 15):
                        score = _f_score(points[frame], moved, threshold / 1000)
                        agreement.setdefault(f"f{suffix}_score_{threshold}", []).append(score)
    scores = {name: float(np.mean(values)) for name, values in agreement.items()}
    for name, values in errors.items():
        scores[f"{name}_mean3d"] = 100 * float(np.mean(values))
        scores[f"{name}_auc3d"] = reference.auc(np.array(values).T)
    return scores


def _f_score(
    ground_truth: NDArray[np.float64], moved: NDArray[np.float64], threshold: float
) -> float:
    recall = np.mean(cKDTree(moved).query(ground_truth)[0] < threshold)
    precision = np.mean(cKDTree(ground_truth).query(moved)[0] < threshold)
    total = recall + precision
    return float(2 * recall * precision / total) if total else 0.0


def seconds(run: Callable[[], dict[str, float]]) -> tuple[float, dict[str, float]]:
    """Run a function: its processor time in seconds, and its result."""
    start = time.process_time()
    result = run()
    return time.process_time() - start, result


def all_metrics(ground_truth: HandPoints, prediction: HandPoints) -> dict[str, float]:
    """All scores of `HandMetrics`, computed batch by batch as in an evaluation."""
    metrics = HandMetrics()
    for index in torch.arange(len(ground_truth)).split(BATCH):
        metrics.update(prediction[index], ground_truth[index], index)
    return metrics.compute()


def main() -> None:
    """Measure both versions, compare their scores, and print the result."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hands", type=int, default=3960)
    parser.add_argument("--compared-hands", type=int, default=100)
    parser.add_argument("--angle-error", type=float, default=0.2, help="radians")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    ground_truth, prediction = posed_hands(arguments.hands, angle_error=arguments.angle_error)
    all_metrics(ground_truth[:BATCH], prediction[:BATCH])

    took, scores = seconds(lambda: all_metrics(ground_truth, prediction))
    print(f"all metrics of {arguments.hands} hands: {took:.2f} s")
    print("  " + "  ".join(f"{name} {value:.3f}" for name, value in scores.items()))
    some = slice(0, arguments.compared_hands)
    slow, expected = seconds(lambda: frame_by_frame(ground_truth[some], prediction[some]))
    slow *= arguments.hands / arguments.compared_hands
    print(f"frame by frame: {slow:.1f} s, {slow / took:.0f} times as long")
    actual = freihand_scores(ground_truth[some], prediction[some])
    worst = max(abs(actual[name] - expected[name]) for name in expected)
    print(f"largest difference of FreiHAND's scores: {worst:.1e}")


if __name__ == "__main__":
    main()
