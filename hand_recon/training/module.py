"""The LightningModule that trains a regressor with the data term and the prior (Sec. 3.4)."""

import logging
from collections.abc import Callable, Iterable
from typing import Any, Final

import lightning
import torch
from jaxtyping import Float
from lightning.pytorch.utilities.types import OptimizerLRScheduler
from torch import Tensor, nn

from hand_recon.camera import REFERENCE_SIZE
from hand_recon.data.datamodule import HandDataModule
from hand_recon.evaluation.hand_scores import Scores
from hand_recon.knowledge.adversarial import AdversarialTerm, Adversary
from hand_recon.knowledge.penetration.places import warn_of_left_out
from hand_recon.knowledge.prior import Prior
from hand_recon.processes import process_group
from hand_recon.regressor.error_feedback import Regressor
from hand_recon.schema import HandBatch, HandPrediction
from hand_recon.training.epoch_losses import LOSSES
from hand_recon.training.mean_losses import MeanLosses
from hand_recon.training.non_finite import LossGuard
from hand_recon.training.supervision import Landmarks3D
from hand_recon.uncertainty import DataTerm

logger = logging.getLogger(__name__)

STAGE_LEFT: Final = 1e6
"""Added to `val/selection`, which chooses the best checkpoint, per stage of the data term still to come."""

LABEL_SIGMAS: Final = ("learnt", "given")
"""Sources of the σ of labels."""

REAL_HANDS: Final = 50_000
"""Most real hands that the discriminator is trained with: 11 MB, and more than FreiHAND has."""

OptimizerFactory = Callable[[Iterable[nn.Parameter]], torch.optim.Optimizer]
SchedulerFactory = Callable[..., torch.optim.lr_scheduler.LRScheduler]


class HandReconstruction(lightning.LightningModule):
    """Trains a regressor from 2D landmarks: L = L_data + L_prior (Sec. 3.4).

    Args:
        regressor: Crop → hand.
        prior: The weighted terms of the prior.
        data_term: Residuals of the projected landmarks → one value per hand, perhaps in stages.
        scores: Makes the metrics of validation and test hands.
        optimizer: Makes the optimizer from the parameters.
        scheduler: Makes a learning-rate schedule from the optimizer and `total_steps`; none keeps the
            learning rate, as the paper does.
        supervision: 3D labels for some hands; none for the paper's own setting.
        label_sigma: `learnt`: the labels' noise is part of the predicted σ, as in the paper. `given`: the
            variance of the labels, which the data know, is added to the predicted one, which is then that of
            the network's own error.
        located_weight: Weight of the error of landmarks that a network finds in the image itself, per pixel
            of a 224-pixel crop and coordinate; other networks have no such error.

    Raises:
        ValueError: `label_sigma` is unknown.
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
        label_sigma: str = "learnt",
        located_weight: float = 20.0,
    ) -> None:
        super().__init__()
        if label_sigma not in LABEL_SIGMAS:
            raise ValueError(
                f"label_sigma={label_sigma!r}; expected one of {', '.join(LABEL_SIGMAS)}."
            )
        self.label_sigma = label_sigma
        self.regressor = regressor
        self.prior = prior
        self.data_term = data_term
        self.optimizer = optimizer
        self.scheduler = scheduler
        self.supervision = supervision
        self.located_weight = located_weight
        self.guard = LossGuard()
        self.validation = scores()
        self._validation_losses = MeanLosses()
        self.test = scores()

    @property
    def adversary(self) -> Adversary | None:
        """The discriminator, where the prior has an adversarial term (Table 3a)."""
        terms = self.prior.terms.values()
        return next((term.adversary for term in terms if isinstance(term, AdversarialTerm)), None)

    def forward(self, batch: HandBatch) -> HandPrediction:
        """Reconstruct every hand of a batch."""
        prediction: HandPrediction = self.regressor(batch)
        return prediction

    def losses(self, batch: HandBatch, prediction: HandPrediction) -> dict[str, Tensor]:
        """Every term as a mean over the batch: raw under its name, weighted under `weighted/`."""
        # Mixed precision is for the backbone alone: bfloat16 rounds 200 pixels to the nearest whole one.
        with torch.autocast(self.device.type, enabled=False):
            return self._losses(batch, prediction)

    def _losses(self, batch: HandBatch, prediction: HandPrediction) -> dict[str, Tensor]:
        data = self.data_term(
            reference_residual(batch, prediction),
            self._log_sigma_of_residual(batch, prediction),
            batch.labelled,
            prediction.correlation,
        ).mean()
        terms = self.prior(prediction.parameters, prediction.vertices)
        raw = {name: value.mean() for name, value in terms.items()}
        weighted = self.prior.weighted(raw)
        # A mixture trained with 3D labels may be validated on a part that has none.
        if self.supervision is not None and (self.training or batch.landmarks_3d is not None):
            raw["landmarks_3d"] = self.supervision(batch, prediction).mean()
            weighted["landmarks_3d"] = self.supervision.weight * raw["landmarks_3d"]
        if prediction.located_2d is not None:
            raw["located"] = located_error(batch, prediction.located_2d).mean()
            weighted["located"] = self.located_weight * raw["located"]
        total = data + sum(weighted.values())
        return {"loss": total, "data": data, **raw} | {
            f"weighted/{name}": value for name, value in weighted.items()
        }

    def _log_sigma_of_residual(
        self, batch: HandBatch, prediction: HandPrediction
    ) -> Float[Tensor, "batch landmark=21 2"]:
        """Log σ of projection minus label: the predicted one, with the label's own σ if that is given."""
        if self.label_sigma == "learnt" or batch.label_noise is None:
            return prediction.log_sigma
        noise = batch.label_noise.nan_to_num(0.0) * (REFERENCE_SIZE / batch.crop_size)
        variance = torch.exp(2 * prediction.log_sigma) + noise.square()[..., None]
        return variance.log() / 2

    def on_fit_start(self) -> None:
        """Give real hands to the discriminator, where the prior has one (Table 3a).

        Raises:
            ValueError: The data do not know any hand's pose and shape.
        """
        adversary = self.adversary
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
                "ones as prior.adversarial.real (conf/experiment/table3a_adversarial.yaml does); or use "
                "prior=full, which needs no 3D."
            )
        adversary.set_real_hands(real)

    def training_step(self, batch: HandBatch, batch_index: int) -> dict[str, Any]:
        """One step of Sec. 3.4; every loss, detached, is for callbacks.

        Raises:
            NonFiniteLossError: The loss is not finite; on a GPU, that of the step before.
        """
        prediction = self(batch)
        if self._stage_begins():
            self._start_sigma_at_the_residual(prediction)
            prediction = self(batch)
        self.data_term.observe(reference_residual(batch, prediction), batch.labelled)
        # Before the losses: between a generator loss and its gradient, the weights of D must not change.
        learnt = self._train_adversary(prediction)
        losses = self.losses(batch, prediction) | learnt
        self.guard.watch(losses, batch, self.global_step)
        detached = {name: value.detach() for name, value in losses.items()}
        return {"loss": losses["loss"], LOSSES: detached}

    def on_train_epoch_end(self) -> None:
        """Check the last loss, and say what non-penetration had no place for (decision 99)."""
        self.guard.settle()
        warn_of_left_out(self.prior)

    def on_validation_start(self) -> None:
        """Check the last loss, so that weights that it has changed to no numbers are not scored."""
        self.guard.settle()

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Check the last loss, so that no weights are saved that it has changed to no numbers."""
        self.guard.settle()

    def _train_adversary(self, prediction: HandPrediction) -> dict[str, Tensor]:
        """One step of the discriminator, where there is one; its loss by name."""
        adversary = self.adversary
        if adversary is None:
            return {}
        with torch.autocast(self.device.type, enabled=False):
            return {"discriminator": adversary.learn(prediction.parameters)}

    def _stage_begins(self) -> bool:
        """Start the data term's second stage if it is due (Sec. 4.1: MSE, then NLL); true if it starts."""
        trainer = self._trainer
        if trainer is None or self.data_term.stage == self.data_term.stages - 1:
            return False
        return self.data_term.begin(
            step=trainer.global_step,
            epoch=trainer.current_epoch,
            total_steps=int(trainer.estimated_stepping_batches),
        )

    def _start_sigma_at_the_residual(self, prediction: HandPrediction) -> None:
        """Shift log σ to the running residual, so that the switch scales the gradient of the means only."""
        start = self.data_term.running_log_sigma()
        predicted = process_group.averaged(prediction.log_sigma.detach().mean(dim=0))
        self.regressor.shift_log_sigma(start - predicted)
        logger.info(
            "Step %d: the second stage of the data term begins. σ starts at the running residual, %.1f px "
            "(median over coordinates).",
            self.global_step, float(start.exp().median()),
        )  # fmt: skip

    def validation_step(self, batch: HandBatch, batch_index: int) -> None:
        """Log losses and update the scores of the validation hands."""
        prediction = self(batch)
        losses = self.losses(batch, prediction)
        # Losses of different stages are not comparable: any checkpoint of the last stage is preferred.
        left = self.data_term.stages - 1 - self.data_term.stage
        # Nor are generator losses of different epochs, since the discriminator has changed between them.
        changing = losses.get("weighted/adversarial", 0.0)
        losses["selection"] = losses["loss"] + STAGE_LEFT * left - changing
        detached = {name: value.detach() for name, value in losses.items()}
        self._validation_losses.add(detached, len(batch))
        self.validation.update(batch, prediction)

    def on_validation_epoch_end(self) -> None:
        """Log the validation losses and scores, and reset them."""
        for name, mean in self._validation_losses.means().items():
            self.log(f"val/{name}", mean, prog_bar=name == "loss")
        self._validation_losses.reset()
        self.log_dict({f"val/{name}": value for name, value in self.validation.compute().items()})
        self.validation.reset()

    # Lightning hands any output to callbacks; its annotation allows tensors and mappings only.
    def test_step(self, batch: HandBatch, batch_index: int) -> HandPrediction:  # type: ignore[override]
        """Score the test hands; the prediction is for callbacks."""
        self.test.update(batch, prediction := self(batch))
        return prediction

    def on_test_epoch_end(self) -> None:
        """Log the test scores and reset them."""
        self.log_dict({f"test/{name}": value for name, value in self.test.compute().items()})
        self.test.reset()

    def predict_step(self, batch: HandBatch, batch_index: int) -> HandPrediction:
        """Reconstruct without labels."""
        return self(batch)

    def configure_optimizers(self) -> OptimizerLRScheduler:
        """The injected optimizer, and the schedule stepped every batch."""
        # A discriminator's weights are frozen here: it has an optimizer of its own.
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


def reference_residual(
    batch: HandBatch, prediction: HandPrediction
) -> Float[Tensor, "batch landmark=21 2"]:
    """Projection minus label, pixels of a 224-pixel crop; NaN where there is no label."""
    to_reference = REFERENCE_SIZE / batch.crop_size
    return (prediction.landmarks_2d - batch.landmarks_2d) * to_reference


def located_error(
    batch: HandBatch, located_2d: Float[Tensor, "batch landmark=21 2"]
) -> Float[Tensor, " batch"]:
    """Absolute error of the landmarks that a network found in the image, summed over labelled coordinates.

    Args:
        batch: The labels.
        located_2d: Landmarks found, pixels of the crop.

    Returns:
        Pixels of a 224-pixel crop; absolute, not squared, so that wrong labels do not dominate.
    """
    error = (located_2d - batch.landmarks_2d) * (REFERENCE_SIZE / batch.crop_size)
    return error.masked_fill(~batch.labelled[..., None], 0.0).abs().sum(dim=(-2, -1))
