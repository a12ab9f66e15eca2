"""What a model says of a whole test set: every hand once, in order, as benchmarks want it (Sec. 4.1)."""

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
from hand_recon.schema import HandBatch

MANO: Final = "mano"
"""Name of the hand whose vertices the benchmarks number."""


@dataclass(frozen=True)
class TestedHands:
    """Predictions and truth of a test set, in the cameras' frames, metres, left hands as left hands."""

    prediction: HandPoints
    """Its vertices are there only if they are MANO's."""
    ground_truth: HandPoints | None
    """None where the dataset does not tell; without vertices where it has none of this hand."""


def benchmark_of(data: HandDataModule, protocol: Protocol) -> Benchmark:
    """What the benchmark needs to know of the test hands, if they are the benchmark's.

    Raises:
        ValueError: They are another benchmark's or nobody's, or some are missing.
    """
    found = getattr(data.dataset("test"), "benchmark", None)
    if found is None:
        raise ValueError(
            f"The test hands of {data.name} are no benchmark's, so that protocol={protocol.name} does not "
            "apply: they were held out of training data, thinned out, or some subjects are missing (see the "
            "warnings above), or it is a dataset without a benchmark."
        )
    # DexYCB's setups share one metric: its bare name serves them all.
    fits = found.protocol == protocol.name or (
        protocol.name == "dexycb" and found.protocol.startswith("dexycb_")
    )
    if not fits:
        raise ValueError(
            f"These test hands are of the benchmark {found.protocol}; protocol={protocol.name} would score "
            f"them as another's. Give protocol={found.protocol}."
        )
    if found.left_out:
        raise ValueError(
            f"{found.left_out} of the benchmark's test hands are missing from {data.name}, and a file "
            "without them would be read with all later hands out of place. Unpack the archive again."
        )
    return found


@torch.no_grad()
def predict_test(
    module: nn.Module, data: HandDataModule, hand: str, device: str = "cpu"
) -> TestedHands:
    """Reconstruct every test hand.

    Args:
        module: From batches to predictions.
        data: Whose test set.
        hand: Name of the module's hand model.
        device: Where to compute.

    Raises:
        ValueError: A picture could not be read: a benchmark takes no file that lacks a hand.
    """
    module = module.to(device).eval()
    loader = data.test_dataloader()
    columns: dict[str, list[Tensor]] = {}
    places: list[int] = []
    for batch in with_progress(loader, len(loader), "Predicting"):
        found = module(to_float(batch.to(device))).to("cpu")
        places += batch.index.tolist()
        rows = {"landmarks": found.landmarks_3d, "true landmarks": batch.landmarks_3d}
        if hand == MANO:
            rows |= {"vertices": found.vertices, "true vertices": batch.vertices}
        for name, points in rows.items():
            if points is not None:
                columns.setdefault(name, []).append(_as_it_is(points, batch))
    _check_order(places, len(data.dataset("test")), data.name)
    joined = {name: torch.cat(parts) for name, parts in columns.items()}
    prediction = HandPoints(joined["landmarks"], joined.get("vertices"))
    return TestedHands(prediction, _ground_truth_of(joined, len(prediction)))


def _as_it_is(
    points: Float[Tensor, "hand point 3"], batch: HandBatch
) -> Float[Tensor, "hand point 3"]:
    """Left hands, which were mirrored when they were read, are left again."""
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


def _check_order(places: list[int], hands: int, name: str) -> None:
    """Every sample in its place: another one stands in for a picture that could not be read."""
    missing = sorted(set(range(hands)) - set(places))
    if missing or places != sorted(places) or len(places) != hands:
        raise ValueError(
            f"{len(missing)} of {hands} test hands of {name} could not be read (the first: {missing[:5]}), "
            "and a file for the benchmark needs all of them. Unpack the pictures again."
        )
