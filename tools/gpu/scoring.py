"""Scores of a trained row on hands in the device's memory (Sec. 4.1, metrics)."""

import torch

from gpu.packed import group_of
from gpu.resident import ResidentHands
from hand_recon.data.augment import to_float
from hand_recon.evaluation.landmarks_2d import Landmarks2D
from hand_recon.schema import HandBatch, HandPrediction
from hand_recon.training.module import HandReconstruction

Scored = dict[str, float]


@torch.no_grad()
def score(
    module: HandReconstruction, hands: ResidentHands, batch_size: int = 128
) -> dict[str, Scored]:
    """All scores that the labels allow over all hands, under `all`, and 2D ones by group of images.

    Args:
        module: Network and scores, on the device.
        hands: Hands on this device.
        batch_size: Hands at once.

    Raises:
        ValueError: A prediction is not finite.
    """
    module.eval()
    module.test.reset()
    groups: dict[str, Landmarks2D] = {}
    for raw in hands.batches(batch_size):
        batch = to_float(raw)
        prediction: HandPrediction = module(batch)
        module.test.update(batch, prediction)
        _by_group(groups, batch, prediction)
    found = {"all": module.test.compute()}
    module.test.reset()
    return found | {name: metric.compute() for name, metric in sorted(groups.items()) if name}


def _by_group(groups: dict[str, Landmarks2D], batch: HandBatch, prediction: HandPrediction) -> None:
    names = [group_of(name) for name in batch.source]
    for name in set(names):
        here = torch.tensor([other == name for other in names], device=batch.index.device)
        metric = groups.setdefault(name, Landmarks2D().to(batch.index.device))
        metric.update(
            prediction.landmarks_2d[here],
            batch.landmarks_2d[here],
            batch.labelled[here],
            batch.index[here],
            crop_size=batch.crop_size,
        )
