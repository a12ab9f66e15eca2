"""Trains a model, tests its best checkpoint and writes the results (Sec. 3.4, 4)."""

import logging
import time
from typing import Any

import lightning
from omegaconf import DictConfig, OmegaConf
from torch import Tensor

from hand_recon.evaluation.scores import HandPoints
from hand_recon.runs.building import build_data, build_module, check_input
from hand_recon.runs.checkpoints import ConfigInCheckpoint, load_trained
from hand_recon.runs.configuration import (
    check_extra,
    claim_folder,
    configure_process,
    instantiate,
    plain,
)
from hand_recon.runs.results import Run, finish_run, mean_pose
from hand_recon.runs.resuming import best_checkpoint, earlier_run
from hand_recon.runs.sigma_calibration import SigmaInCheckpoint
from hand_recon.runs.training_progress import is_interactive, progress_callback, quiet_libraries

logger = logging.getLogger(__name__)


def train(config: DictConfig) -> dict[str, Any]:
    """Train, test the best checkpoint, and write metrics, images and a report.

    Args:
        config: `conf/train.yaml` composed, with `paths.run` a folder without a run in it.

    Returns:
        What `metrics.json` holds.
    """
    check_extra("tensorboard", "matplotlib", "jinja2")
    lightning.seed_everything(config.seed, workers=True, verbose=False)
    quiet_libraries()
    threads = configure_process(config.threads)
    earlier = earlier_run(config)
    folder = claim_folder(config.paths.run)
    OmegaConf.save(OmegaConf.create(plain(config)), folder / "config.yaml")
    data, module = build_data(config), build_module(config)
    check_input(module, data)
    parameters = sum(parameter.numel() for parameter in module.parameters())
    logger.info("%s: %.1f M parameters, %d threads", config.name, parameters / 1e6, threads)
    logger.info("If it is interrupted, the same command with resume=%s goes on.", folder)
    # Data are rendered or decoded before the time is taken: the speed is that of training alone.
    data.setup("fit")
    mean = mean_pose(data)
    trainer = build_trainer(config, mean)
    started = time.monotonic()
    trainer.fit(
        module,
        datamodule=data,
        ckpt_path=None if earlier is None else earlier.last,
        weights_only=True,
    )
    seconds = time.monotonic() - started
    best = best_checkpoint(trainer, folder, earlier)
    epochs = trainer.current_epoch - (0 if earlier is None else earlier.epochs)
    images = epochs * trainer.num_training_batches * data.batch_size
    facts = {
        "checkpoint": str(best.relative_to(folder)),
        "parameters": parameters,
        "train_seconds": round(seconds, 1),
        "train_images_per_second": round(images / max(seconds, 1e-9), 1),
        "epochs": trainer.current_epoch,
    }
    return finish_run(
        Run(config, folder, load_trained(best, composed=config).module, data, mean, facts)
    )


def build_trainer(config: DictConfig, mean: HandPoints | None) -> lightning.Trainer:
    """The Lightning trainer of a run.

    Args:
        config: Of the run.
        mean: The mean training hand, for the checkpoints.
    """
    callbacks = [instantiate(callback) for callback in config.callbacks.values()]
    loggers = [instantiate(one) for one in config.logger.values()]
    points: dict[str, Tensor] = {}
    if mean is not None:
        points = {"landmarks": mean.landmarks}
        points |= {} if mean.vertices is None else {"vertices": mean.vertices}
    trainer: lightning.Trainer = instantiate(
        config.trainer,
        callbacks=[
            *callbacks,
            ConfigInCheckpoint(plain(config), points),
            SigmaInCheckpoint(),
            progress_callback(),
        ],
        logger=loggers,
        enable_progress_bar=is_interactive(),
    )
    return trainer
