"""Fit, test the best checkpoint, print a table, write pictures and a report (Sec. 3.4, 4).

python -m hand_recon.train
python -m hand_recon.train data=freihand data.root=/path/to/FreiHAND_pub_v2
python -m hand_recon.train -m +experiment=ablation_row1,ablation_row2 seed=0,1,2
"""

import logging
import time
from pathlib import Path
from typing import Any

import hydra
import lightning
from omegaconf import DictConfig, OmegaConf

from hand_recon.configuration import (
    CONF,
    ConfigInCheckpoint,
    build_data,
    build_module,
    instantiate,
    load_module,
    plain,
    read_checkpoint,
    set_threads,
)
from hand_recon.progress import progress_callback, quiet_libraries, somebody_watches
from hand_recon.results import Run, finish_run

logger = logging.getLogger(__name__)

MUST_MATCH = ("seed", "crop_size", "data", "hand", "model", "prior", "data_term", "optimizer")
"""What a continued run must share with the run it continues."""


def train(config: DictConfig) -> dict[str, Any]:
    """Run the main job.

    Args:
        config: `conf/train.yaml` composed, with `paths.run` an existing or new folder.

    Returns:
        What `metrics.json` holds.
    """
    lightning.seed_everything(config.seed, workers=True, verbose=False)
    quiet_libraries()
    threads = set_threads(config.threads)
    folder = Path(config.paths.run).absolute()
    folder.mkdir(parents=True, exist_ok=True)
    resume = _checkpoint_to_resume(config)
    data, module = build_data(config), build_module(config)
    parameters = sum(parameter.numel() for parameter in module.parameters())
    logger.info("%s: %.1f M parameters, %d threads", config.name, parameters / 1e6, threads)
    logger.info("If it is interrupted, the same command with resume=%s goes on.", folder)
    trainer = build_trainer(config)
    # Data are rendered or decoded before the clock starts, so that the speed is the training's.
    data.setup("fit")
    started = time.monotonic()
    trainer.fit(module, datamodule=data, ckpt_path=resume, weights_only=True)
    seconds = time.monotonic() - started
    images = trainer.global_step * data.batch_size
    best = _best_checkpoint(trainer, config)
    module, _ = load_module(best)
    OmegaConf.save(OmegaConf.create(plain(config)), folder / "config.yaml")
    run = Run(
        config=config,
        folder=folder,
        module=module,
        data=data,
        facts={
            "checkpoint": str(best.relative_to(folder)),
            "parameters": parameters,
            "train_seconds": round(seconds, 1),
            "train_images_per_second": round(images / max(seconds, 1e-9), 1),
            "epochs": trainer.current_epoch,
        },
    )
    return finish_run(run, trainer)


def build_trainer(config: DictConfig) -> lightning.Trainer:
    """The Lightning trainer of a run."""
    callbacks = [instantiate(callback) for callback in config.callbacks.values()]
    loggers = [instantiate(one) for one in config.logger.values()]
    trainer: lightning.Trainer = instantiate(
        config.trainer,
        callbacks=[*callbacks, ConfigInCheckpoint(plain(config)), progress_callback()],
        logger=loggers,
        enable_progress_bar=somebody_watches(),
    )
    return trainer


def _best_checkpoint(trainer: lightning.Trainer, config: DictConfig) -> Path:
    """Where the best checkpoint is.

    Raises:
        ValueError: There is none, because nothing was trained.
    """
    best = getattr(trainer.checkpoint_callback, "best_model_path", "")
    if not best:
        raise ValueError(
            f"Nothing was trained: {config.resume or 'this run'} is at epoch {trainer.current_epoch} of "
            f"trainer.max_epochs={config.trainer.max_epochs}. Give more epochs, or score what there is with "
            "python -m hand_recon.evaluate ckpt=…"
        )
    return Path(best)


def _checkpoint_to_resume(config: DictConfig) -> str | None:
    """The checkpoint to continue from, once it is known to belong to the same run.

    Raises:
        FileNotFoundError: There is no such checkpoint.
        ValueError: It was trained with other settings.
    """
    if config.resume is None:
        return None
    path = Path(config.resume).expanduser()
    path = path / "checkpoints" / "last.ckpt" if path.is_dir() else path
    _, saved = read_checkpoint(path)
    now = OmegaConf.create(plain(config))
    changed = [key for key in MUST_MATCH if saved.get(key) != now.get(key)]
    if changed:
        raise ValueError(
            f"{path} was trained with other settings of {changed}. A run is continued with the settings "
            "that it had (its config.yaml lists them); to start from its weights with new settings, "
            "that is another run."
        )
    return str(path)


@hydra.main(version_base="1.3", config_path=CONF, config_name="train")
def main(config: DictConfig) -> None:
    """The command line."""
    train(config)


if __name__ == "__main__":
    main()
