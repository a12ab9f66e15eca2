"""A Lightning module that keeps every batch, and the trainer that runs it."""

import lightning
import torch

from hand_recon.schema import HandBatch


class BatchRecorder(lightning.LightningModule):
    """Module that learns nothing and keeps every batch of each split."""

    def __init__(self) -> None:
        super().__init__()
        self.weight = torch.nn.Parameter(torch.zeros(()))
        self.seen: dict[str, list[HandBatch]] = {"train": [], "val": [], "test": []}

    def training_step(self, batch: HandBatch, batch_index: int) -> torch.Tensor:
        self.seen["train"].append(batch)
        return self.weight * batch.image.mean()

    def validation_step(self, batch: HandBatch, batch_index: int) -> None:
        self.seen["val"].append(batch)

    def test_step(self, batch: HandBatch, batch_index: int) -> None:
        self.seen["test"].append(batch)

    def configure_optimizers(self) -> torch.optim.Optimizer:
        return torch.optim.SGD(self.parameters(), lr=0.0)


def trainer(epochs: int = 1) -> lightning.Trainer:
    """A trainer on the CPU that writes and prints nothing."""
    return lightning.Trainer(
        max_epochs=epochs,
        accelerator="cpu",
        logger=False,
        enable_checkpointing=False,
        enable_progress_bar=False,
        enable_model_summary=False,
        num_sanity_val_steps=0,
    )
