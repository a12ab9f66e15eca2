"""Predictions for a benchmark's whole test set, every hand once and in order (Sec. 4.1)."""

from dataclasses import dataclass
from typing import Final

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from hand_recon.data.annotated_dataset import Benchmark
from hand_recon.data.augment import to_float
from hand_recon.data.datamodule import HandDataModule
from hand_recon.data.progress import with_progress
from hand_recon.evaluation.scores import HandPoints
from hand_recon.protocols.benchmarks import Protocol
from hand_recon.schema import HandBatch, HandPrediction

MANO: Final = "mano"
"""Name of the hand model whose vertices the benchmarks score."""


@dataclass(frozen=True)
class TestedHands:
    """Predictions and ground truth of a test set, camera frame, metres; left hands not mirrored."""

    prediction: HandPoints
    """Predicted hands; vertices only if they are MANO's."""
    ground_truth: HandPoints | None
    """Ground truth; none where the dataset has none; no vertices where it has none of this hand."""


def benchmark_of(data: HandDataModule, protocol: Protocol) -> Benchmark:
    """Benchmark that the test hands belong to.

    Raises:
        ValueError: They are of another benchmark or of none, or some are missing.
    """
    found = getattr(data.dataset("test"), "benchmark", None)
    if found is None:
        raise ValueError(
            f"The test hands of {data.name} are no benchmark's, so that protocol={protocol.name} does not "
            "apply: they were held out of training data, only every n-th is used, some subjects are missing "
            "(see the warnings above), or the dataset has no benchmark. Leave protocol= out, or test on the "
            "whole official test set."
        )
    # DexYCB's setups share one metric: protocol=dexycb is for all of them.
    fits = found.protocol == protocol.name or (
        protocol.name == "dexycb" and found.protocol.startswith("dexycb_")
    )
    if not fits:
        raise ValueError(
            f"These test hands are of the benchmark {found.protocol}; protocol={protocol.name} is another. "
            f"Give protocol={found.protocol}."
        )
    if found.left_out:
        raise ValueError(
            f"{found.left_out} of the benchmark's test hands are missing from {data.name}; a file "
            "without them would shift all later hands. Unpack the archive again."
        )
    return found


class BenchmarkPredictions:
    """Collects predictions and ground truth of a test set, batch by batch.

    Args:
        hand: Name of the module's hand model; vertices are collected only if it is MANO.
    """

    def __init__(self, hand: str) -> None:
        self.hand = hand
        self.columns: dict[str, list[Tensor]] = {}
        self.indices: list[int] = []

    def __call__(self, batch: HandBatch, prediction: HandPrediction) -> None:
        """Add a batch; batch and prediction are on the CPU."""
        self.indices += batch.index.tolist()
        rows = {"landmarks": prediction.landmarks_3d, "true landmarks": batch.landmarks_3d}
        if self.hand == MANO:
            rows |= {"vertices": prediction.vertices, "true vertices": batch.vertices}
        for name, points in rows.items():
            if points is not None:
                self.columns.setdefault(name, []).append(_unmirrored(points, batch))

    def tested(self, data: HandDataModule) -> TestedHands:
        """The test set in order.

        Args:
            data: Datamodule with the test set.

        Raises:
            ValueError: An image could not be read: benchmarks refuse a file that lacks a hand.
        """
        _check_order(self.indices, len(data.dataset("test")), data.name)
        joined = {name: torch.cat(parts) for name, parts in self.columns.items()}
        prediction = HandPoints(joined["landmarks"], joined.get("vertices"))
        return TestedHands(prediction, _ground_truth_of(joined, len(prediction)))


@torch.no_grad()
def predict_test(
    module: nn.Module, data: HandDataModule, hand: str, device: str = "cpu"
) -> TestedHands:
    """Reconstruct every test hand, in one process.

    Args:
        module: Maps a batch to a prediction.
        data: Datamodule with the test set.
        hand: Name of the module's hand model.
        device: Device to compute on.

    Raises:
        ValueError: An image could not be read: benchmarks refuse a file that lacks a hand.
    """
    module = module.to(device).eval()
    loader = data.test_dataloader()
    collected = BenchmarkPredictions(hand)
    for batch in with_progress(loader, len(loader), "Predicting"):
        collected(batch, module(to_float(batch.to(device))).to("cpu"))
    return collected.tested(data)


def _unmirrored(
    points: Float[Tensor, "hand point 3"], batch: HandBatch
) -> Float[Tensor, "hand point 3"]:
    """Mirror left hands back, which were mirrored to right ones when they were read."""
    if batch.mirrored is None:
        return points
    mirrored: Bool[Tensor, " hand"] = batch.mirrored
    sign = torch.ones(len(points), 1, 3)
    sign[mirrored, :, 0] = -1.0
    return points * sign


def _ground_truth_of(joined: dict[str, Tensor], hands: int) -> HandPoints | None:
    landmarks, vertices = joined.get("true landmarks"), joined.get("true vertices")
    whole = landmarks is not None and len(landmarks) == hands and landmarks.isfinite().all()
    if landmarks is None or not whole:
        return None
    if vertices is None or len(vertices) < hands or not vertices.isfinite().all():
        return HandPoints(landmarks)
    return HandPoints(landmarks, vertices)


def _check_order(indices: list[int], hands: int, name: str) -> None:
    """Check that every sample came once and in order: an unreadable image is replaced by another sample."""
    missing = sorted(set(range(hands)) - set(indices))
    if missing or indices != sorted(indices) or len(indices) != hands:
        raise ValueError(
            f"{len(missing)} of {hands} test hands of {name} could not be read (the first: {missing[:5]}), "
            "and a file for the benchmark needs all of them. Unpack the images again."
        )
