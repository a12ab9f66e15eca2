"""Passes every test batch with its prediction on, so that nothing is decoded or inferred twice."""

from collections.abc import Callable
from typing import Any

import lightning

from hand_recon.evaluation.metrics import HandMetrics
from hand_recon.evaluation.scores import HandPoints
from hand_recon.processes import process_group
from hand_recon.schema import HandBatch, HandPrediction

Observer = Callable[[HandBatch, HandPrediction], None]
"""Takes a test batch and its prediction, both on the CPU."""


class ObservedTest(lightning.Callback):
    """Calls observers after every test step of this process.

    Args:
        observers: What to call.
    """

    def __init__(self, *observers: Observer) -> None:
        super().__init__()
        self.observers = observers

    def on_test_batch_end(  # noqa: PLR0917  # Lightning's signature
        self,
        trainer: lightning.Trainer,
        pl_module: lightning.LightningModule,
        outputs: Any,  # noqa: ANN401
        batch: Any,  # noqa: ANN401
        batch_idx: int,
        dataloader_idx: int = 0,
    ) -> None:
        """Pass the batch and the prediction that `test_step` returned on."""
        if self.observers:
            batch, prediction = batch.to("cpu"), outputs.to("cpu")
            for observer in self.observers:
                observer(batch, prediction)


class ConstantHand:
    """Scores of one hand as the prediction for every test sample.

    Args:
        hand: The mean training hand: landmarks and, where known, vertices, metres.
        names: The scores that are kept: a constant hand has no meaningful others.
    """

    def __init__(self, hand: HandPoints, names: tuple[str, ...]) -> None:
        self.hand, self.names = hand, names
        self.metric = HandMetrics()

    def __call__(self, batch: HandBatch, prediction: HandPrediction | None = None) -> None:
        """Add a batch; batches without 3D ground truth are left out."""
        if batch.landmarks_3d is None:
            return
        vertices = None
        if batch.vertices is not None and self.hand.vertices is not None:
            vertices = self.hand.vertices.expand(len(batch), -1, -1)
        self.metric.update(
            HandPoints(self.hand.landmarks.expand(len(batch), -1, -1), vertices),
            HandPoints(batch.landmarks_3d, None if vertices is None else batch.vertices),
            batch.index,
        )

    def scores(self) -> dict[str, float]:
        """Mean of each score over the hands of all processes; empty without any ground truth."""
        if not process_group.in_any_process(self.metric.update_called):
            return {}
        return {name: value for name, value in self.metric.compute().items() if name in self.names}
