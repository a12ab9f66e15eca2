"""Training: the data term and the prior over a reconstructor (Sec. 3.4)."""

import math
from collections.abc import Callable, Iterable

import lightning
import torch
from lightning.pytorch.utilities.types import OptimizerLRScheduler
from torch import Tensor, nn

from hand_recon.camera import REFERENCE_SIZE
from hand_recon.evaluation.landmarks_2d import Landmarks2D
from hand_recon.evaluation.metrics import HandMetrics
from hand_recon.evaluation.scores import HandPoints
from hand_recon.knowledge.prior import Prior
from hand_recon.reconstructor import Reconstructor
from hand_recon.schema import HandBatch, HandPrediction

OptimizerFactory = Callable[[Iterable[nn.Parameter]], torch.optim.Optimizer]
SchedulerFactory = Callable[..., torch.optim.lr_scheduler.LRScheduler]


def warmup_cosine(
    optimizer: torch.optim.Optimizer, total_steps: int, warmup_steps: int = 100
) -> torch.optim.lr_scheduler.LambdaLR:
    """A rate that rises linearly, then falls as a cosine to zero at the end.

    The rise is counted in steps, not as a share of the run: a run of few steps must not throw the hand
    out of the picture with its first ones.

    Args:
        optimizer: Its rates are the highest that are reached.
        total_steps: Steps of the run.
        warmup_steps: Steps of the rise.
    """

    def factor(step: int) -> float:
        rise = min(1.0, (step + 1) / warmup_steps)
        return rise * 0.5 * (1 + math.cos(math.pi * min(1.0, step / total_steps)))

    return torch.optim.lr_scheduler.LambdaLR(optimizer, factor)


class HandReconstruction(lightning.LightningModule):
    """Trains a reconstructor from 2D landmarks: L = L_data + L_prior (Sec. 3.4).

    Args:
        reconstructor: Crop → hand.
        prior: Knowledge, every term by name.
        data_term: Residuals of the projected landmarks → one value per hand.
        optimizer: Makes the optimizer from the parameters.
        scheduler: Makes a learning-rate schedule from the optimizer and `total_steps`; none keeps the
            rate, as the paper does.
    """

    def __init__(
        self,
        reconstructor: Reconstructor,
        prior: Prior,
        data_term: nn.Module,
        optimizer: OptimizerFactory,
        scheduler: SchedulerFactory | None = None,
    ) -> None:
        super().__init__()
        self.reconstructor = reconstructor
        self.prior = prior
        self.data_term = data_term
        self.optimizer = optimizer
        self.scheduler = scheduler
        self.validation = _Scores()
        self.test = _Scores()

    def forward(self, batch: HandBatch) -> HandPrediction:
        """Reconstruct every hand of a batch."""
        prediction: HandPrediction = self.reconstructor(batch.image, batch.intrinsics)
        return prediction

    def losses(self, batch: HandBatch, prediction: HandPrediction) -> dict[str, Tensor]:
        """Every term as a mean over the batch: raw under its name, weighted under `weighted/`."""
        # Mixed precision is for the backbone alone: half a pixel of 200 is lost in bfloat16.
        with torch.autocast(self.device.type, enabled=False):
            return self._losses(batch, prediction)

    def _losses(self, batch: HandBatch, prediction: HandPrediction) -> dict[str, Tensor]:
        to_reference = REFERENCE_SIZE / batch.crop_size
        residual = (prediction.landmarks_2d - batch.landmarks_2d) * to_reference
        data = self.data_term(residual, prediction.log_sigma, batch.labelled).mean()
        raw = {name: value.mean() for name, value in self.prior(prediction).items()}
        weighted = self.prior.weighted(raw)
        total = data + sum(weighted.values())
        return {"loss": total, "data": data, **raw} | {
            f"weighted/{name}": value for name, value in weighted.items()
        }

    def training_step(self, batch: HandBatch, batch_index: int) -> Tensor:
        """One step of Sec. 3.4.

        Raises:
            FloatingPointError: The loss is not finite.
        """
        losses = self.losses(batch, self(batch))
        self._refuse_non_finite(losses, batch)
        self._log("train", losses, len(batch))
        return losses["loss"]

    def validation_step(self, batch: HandBatch, batch_index: int) -> None:
        """Losses and scores on the validation hands."""
        prediction = self(batch)
        self._log("val", self.losses(batch, prediction), len(batch))
        self.validation.update(batch, prediction)

    def on_validation_epoch_end(self) -> None:
        """Log the scores, and forget the hands they came from."""
        self.log_dict({f"val/{name}": value for name, value in self.validation.compute().items()})
        self.validation.reset()

    def test_step(self, batch: HandBatch, batch_index: int) -> None:
        """Scores on the test hands."""
        self.test.update(batch, self(batch))

    def on_test_epoch_end(self) -> None:
        """Log the scores, and forget the hands they came from."""
        self.log_dict({f"test/{name}": value for name, value in self.test.compute().items()})
        self.test.reset()

    def predict_step(self, batch: HandBatch, batch_index: int) -> HandPrediction:
        """Reconstruct without labels."""
        return self(batch)

    def configure_optimizers(self) -> OptimizerLRScheduler:
        """The injected optimizer, and the schedule stepped every batch."""
        optimizer = self.optimizer(self.parameters())
        if self.scheduler is None:
            return optimizer
        total = int(self.trainer.estimated_stepping_batches)
        scheduler = self.scheduler(optimizer, total_steps=total)
        return {
            "optimizer": optimizer,
            "lr_scheduler": {"scheduler": scheduler, "interval": "step"},
        }

    def _log(self, stage: str, losses: dict[str, Tensor], batch_size: int) -> None:
        # Lightning averages over an epoch and over devices; the sums stay on the device until then.
        for name, value in losses.items():
            self.log(
                f"{stage}/{name}",
                value.detach(),
                on_step=False,
                on_epoch=True,
                prog_bar=name == "loss",
                batch_size=batch_size,
                sync_dist=True,
            )

    def _refuse_non_finite(self, losses: dict[str, Tensor], batch: HandBatch) -> None:
        if torch.isfinite(losses["loss"]):
            return
        values = {name: float(value.detach()) for name, value in losses.items()}
        raise FloatingPointError(
            f"The loss is not finite at step {self.global_step}: {values}. "
            f"The batch held {list(batch.source[:8])}. Lower the learning rate "
            "(optimizer.lr), or look at these samples."
        )


class _Scores(nn.Module):
    """The scores that a batch's labels allow: 2D always, 3D where there is ground truth."""

    def __init__(self) -> None:
        super().__init__()
        self.in_3d = HandMetrics()
        self.in_2d = Landmarks2D()
        self._has_3d = False

    def update(self, batch: HandBatch, prediction: HandPrediction) -> None:
        self.in_2d.update(
            prediction.landmarks_2d,
            batch.landmarks_2d,
            batch.labelled,
            batch.index,
            crop_size=batch.crop_size,
        )
        if batch.landmarks_3d is not None:
            self._has_3d = True
            vertices = None if batch.vertices is None else prediction.vertices
            self.in_3d.update(
                HandPoints(prediction.landmarks_3d, vertices),
                HandPoints(batch.landmarks_3d, batch.vertices),
                batch.index,
            )

    def compute(self) -> dict[str, float]:
        return (self.in_3d.compute() if self._has_3d else {}) | self.in_2d.compute()

    def reset(self) -> None:
        self.in_3d.reset()
        self.in_2d.reset()
        self._has_3d = False
