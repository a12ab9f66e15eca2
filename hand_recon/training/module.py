"""Training: the data term and the prior over a regressor (Sec. 3.4)."""

import logging
import math
from collections.abc import Callable, Iterable
from typing import Final

import lightning
import torch
from jaxtyping import Float
from lightning.pytorch.utilities.types import OptimizerLRScheduler
from torch import Tensor, nn

from hand_recon.camera import REFERENCE_SIZE
from hand_recon.data.datamodule import HandDataModule
from hand_recon.evaluation.hand_scores import Scores
from hand_recon.knowledge.prior import Prior
from hand_recon.regressor.error_feedback import Regressor
from hand_recon.schema import HandBatch, HandPrediction
from hand_recon.training.supervision import Landmarks3D
from hand_recon.uncertainty import DataTerm

logger = logging.getLogger(__name__)

STAGE_LEFT: Final = 1e6
"""What a stage that is still to come adds to the number by which the best checkpoint is chosen."""

REAL_HANDS: Final = 50_000
"""At most so many hands are shown to a prior that learns from 3D: 11 MB, and more than FreiHAND has."""

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
    """Trains a regressor from 2D landmarks: L = L_data + L_prior (Sec. 3.4).

    Args:
        regressor: Crop → hand.
        prior: Knowledge, every term by name.
        data_term: Residuals of the projected landmarks → one value per hand, perhaps in stages.
        scores: What is measured of validation and test hands.
        optimizer: Makes the optimizer from the parameters.
        scheduler: Makes a learning-rate schedule from the optimizer and `total_steps`; none keeps the
            rate, as the paper does.
        supervision: 3D labels for some hands; none for the paper's own setting.
    """

    def __init__(
        self,
        regressor: Regressor,
        prior: Prior,
        data_term: DataTerm,
        *,
        scores: Callable[[], Scores],
        optimizer: OptimizerFactory,
        scheduler: SchedulerFactory | None = None,
        supervision: Landmarks3D | None = None,
    ) -> None:
        super().__init__()
        self.regressor = regressor
        self.prior = prior
        self.data_term = data_term
        self.optimizer = optimizer
        self.scheduler = scheduler
        self.supervision = supervision
        self.validation = scores()
        self.test = scores()

    def forward(self, batch: HandBatch) -> HandPrediction:
        """Reconstruct every hand of a batch."""
        prediction: HandPrediction = self.regressor(batch)
        return prediction

    def losses(self, batch: HandBatch, prediction: HandPrediction) -> dict[str, Tensor]:
        """Every term as a mean over the batch: raw under its name, weighted under `weighted/`."""
        # Mixed precision is for the backbone alone: half a pixel of 200 is lost in bfloat16.
        with torch.autocast(self.device.type, enabled=False):
            return self._losses(batch, prediction)

    def _losses(self, batch: HandBatch, prediction: HandPrediction) -> dict[str, Tensor]:
        data = self.data_term(
            reference_residual(batch, prediction),
            prediction.log_sigma,
            batch.labelled,
            prediction.correlation,
        ).mean()
        raw = {name: value.mean() for name, value in self.prior(prediction).items()}
        weighted = self.prior.weighted(raw)
        # A mixture that learns from 3D labels may be validated on a part that has none.
        if self.supervision is not None and (self.training or batch.landmarks_3d is not None):
            raw["landmarks_3d"] = self.supervision(batch, prediction).mean()
            weighted["landmarks_3d"] = self.supervision.weight * raw["landmarks_3d"]
        total = data + sum(weighted.values())
        return {"loss": total, "data": data, **raw} | {
            f"weighted/{name}": value for name, value in weighted.items()
        }

    def on_fit_start(self) -> None:
        """Show real hands to a prior that learns from them (Table 3a).

        Raises:
            ValueError: The data do not know any hand's pose and shape.
        """
        adversary = self.prior.adversary
        if adversary is None:
            return
        datamodule: HandDataModule | None = getattr(self.trainer, "datamodule", None)
        source = adversary.source or datamodule
        real = None if source is None else source.train_parameters(REAL_HANDS)
        if real is None:
            raise ValueError(
                f"prior=adversarial learns from the pose and shape of real hands in 3D, and "
                f"{'there is no datamodule' if source is None else f'{source.name} has none'}. Use data that "
                "know them, such as synthetic hands or FreiHAND; name other data whose hands are the real "
                "ones as prior.adversary.real (conf/experiment/table3a_adversarial.yaml does); or use "
                "prior=full, which needs no 3D."
            )
        adversary.meet(real)

    def training_step(self, batch: HandBatch, batch_index: int) -> Tensor:
        """One step of Sec. 3.4.

        Raises:
            FloatingPointError: The loss is not finite.
        """
        prediction = self(batch)
        if self._stage_begins():
            self._start_sigma_at_the_residual(prediction)
            prediction = self(batch)
        self.data_term.observe(reference_residual(batch, prediction), batch.labelled)
        # Before it judges: between a judgement and its gradient, the judge's weights may not change.
        learnt = self._train_adversary(prediction)
        losses = self.losses(batch, prediction) | learnt
        self._refuse_non_finite(losses, batch)
        self._log("train", losses, len(batch))
        return losses["loss"]

    def _train_adversary(self, prediction: HandPrediction) -> dict[str, Tensor]:
        """A step of the discriminator, where there is one."""
        if self.prior.adversary is None:
            return {}
        with torch.autocast(self.device.type, enabled=False):
            return {"discriminator": self.prior.adversary.learn(prediction.parameters)}

    def _stage_begins(self) -> bool:
        """Whether the data term goes to its second stage with this step (Sec. 4.1: MSE, then NLL)."""
        trainer = self._trainer
        if trainer is None or self.data_term.stage == self.data_term.stages - 1:
            return False
        return self.data_term.begin(
            step=trainer.global_step,
            epoch=trainer.current_epoch,
            total_steps=int(trainer.estimated_stepping_batches),
        )

    def _start_sigma_at_the_residual(self, prediction: HandPrediction) -> None:
        """Start σ at the running residual, so that the gradient on the means changes by one factor alone."""
        start = self.data_term.running_log_sigma()
        self.regressor.shift_log_sigma(start - prediction.log_sigma.detach().mean(dim=0))
        logger.info(
            "Step %d: the second stage of the data term begins. σ starts at the running residual, %.1f px "
            "(median over coordinates).",
            self.global_step,
            float(start.exp().median()),
        )

    def validation_step(self, batch: HandBatch, batch_index: int) -> None:
        """Losses and scores on the validation hands."""
        prediction = self(batch)
        losses = self.losses(batch, prediction)
        # Losses of two stages do not compare; any checkpoint of the last is taken before one of the first.
        stages_left = self.data_term.stages - 1 - self.data_term.stage
        losses["selection"] = losses["loss"] + STAGE_LEFT * stages_left
        # Nor do those of two epochs of a discriminator, which has become another judge.
        losses["selection"] = losses["selection"] - losses.get("weighted/adversarial", 0.0)
        self._log("val", losses, len(batch))
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
        # A discriminator's weights are frozen but in its own step, which is not this optimizer's.
        learning = (parameter for parameter in self.parameters() if parameter.requires_grad)
        optimizer = self.optimizer(learning)
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


def reference_residual(
    batch: HandBatch, prediction: HandPrediction
) -> Float[Tensor, "batch landmark=21 2"]:
    """Projection minus label, pixels of a 224-pixel crop; NaN where there is no label."""
    to_reference = REFERENCE_SIZE / batch.crop_size
    return (prediction.landmarks_2d - batch.landmarks_2d) * to_reference
