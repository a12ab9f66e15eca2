"""Builds objects from a Hydra configuration, and checks configurations that come from checkpoints."""

import importlib
import importlib.util
import multiprocessing
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import hydra
import torch
from omegaconf import DictConfig, OmegaConf

from hand_recon import __version__
from hand_recon.command_line.processor import default_threads
from hand_recon.command_line.resolvers import MANO_HAND, register_resolvers
from hand_recon.hand.model import HandModel
from hand_recon.knowledge.prior import Prior

register_resolvers()

TRUSTED: Final = frozenset(
    {
        "hand_recon.data.appearance.Appearance",
        "hand_recon.data.augment.Augmentation",
        "hand_recon.data.crop.CropPolicy",
        "hand_recon.data.crop_reader.ReadingPolicy",
        "hand_recon.data.dexycb.datamodule.DexYcbDataModule",
        "hand_recon.data.freihand.datamodule.FreiHandDataModule",
        "hand_recon.data.ho3d.datamodule.Ho3dDataModule",
        "hand_recon.data.landmarks.datamodule.LandmarkDataModule",
        "hand_recon.data.mixture.MixtureDataModule",
        "hand_recon.data.shards.datamodule.ShardDataModule",
        "hand_recon.data.synthetic.datamodule.SyntheticDataModule",
        "hand_recon.detection.boxes.BoxDetector",
        "hand_recon.detection.boxes.WholeImageDetector",
        "hand_recon.detection.mediapipe.MediaPipeDetector",
        "hand_recon.regressor.image_encoder.ImageEncoder",
        "hand_recon.regressor.landmark_encoder.LandmarkEncoder",
        "hand_recon.regressor.photo_encoder.PhotoEncoder",
        "hand_recon.fitting.results.ResultOptions",
        "hand_recon.fitting.descent.Descent",
        MANO_HAND,
        "hand_recon.hand.open_hand.open_hand",
        "hand_recon.knowledge.adversarial.AdversarialTerm",
        "hand_recon.knowledge.functional_anatomy.FunctionalAnatomy",
        "hand_recon.knowledge.natural_pose.NaturalPoseTerm",
        "hand_recon.knowledge.pose_components.PoseComponentsTerm",
        "hand_recon.knowledge.terms.NonPenetrationTerm",
        "hand_recon.knowledge.terms.RangeOfMotionTerm",
        "hand_recon.knowledge.terms.ShapeTerm",
        "hand_recon.regressor.error_feedback.Regressor",
        "hand_recon.runs.clip.options.MotionOptions",
        "hand_recon.runs.last_checkpoint.LastCheckpoint",
        "hand_recon.runs.photo_results.PhotoOptions",
        "hand_recon.runs.provenance.callback.Provenance",
        "hand_recon.training.schedules.warmup_cosine",
        "hand_recon.training.supervision.Landmarks3D",
        "hand_recon.uncertainty.FullCovariance",
        "hand_recon.uncertainty.LaplaceLikelihood",
        "hand_recon.uncertainty.NegativeLogLikelihood",
        "hand_recon.uncertainty.RescaledSquaredError",
        "hand_recon.uncertainty.SquaredError",
        "hand_recon.uncertainty.Staged",
        "lightning.Trainer",
        "lightning.pytorch.callbacks.LearningRateMonitor",
        "lightning.pytorch.callbacks.ModelCheckpoint",
        "lightning.pytorch.loggers.CSVLogger",
        "lightning.pytorch.loggers.TensorBoardLogger",
        "lightning.pytorch.loggers.WandbLogger",
        "optuna.pruners.MedianPruner",
        "optuna.samplers.TPESampler",
        "torch.optim.Adam",
        "torch.optim.AdamW",
        "torch.optim.SGD",
        "torch.optim.lr_scheduler.OneCycleLR",
    }
)
"""Every `_target_` that a checkpoint's configuration may call."""


PRODUCTS: Final = (
    "metrics.json", "checkpoints", "config.yaml", "report.html", "per_hand.csv", "curves.png", "overlays",
    "uncertainty.png", "submission", "scores.json", "samples.png", "labels.json",
)  # fmt: skip
"""Files and folders that runs write; a folder that holds one of them is not written to."""


def instantiate(config: DictConfig | None, **arguments: Any) -> Any:  # noqa: ANN401  # any object
    """Build the object that a part of a configuration describes with Hydra; None for None."""
    if config is None:
        return None
    if not arguments:
        return hydra.utils.instantiate(config)
    # Hydra would turn a dataclass among the arguments into a configuration.
    return hydra.utils.instantiate(config, _partial_=True)(**arguments)


def refuse_untrusted(
    config: DictConfig,
    source: str,
    version: str | None = None,
    trusted: frozenset[str] = frozenset(),
) -> None:
    """Check a configuration that came with a checkpoint before anything in it is called.

    A configuration that its user composed may call anything, but a file from elsewhere may name any
    function of any package, and even torch has functions that run commands.

    Args:
        config: The parts that will be built.
        source: The file, for the message.
        version: Version of hand_recon that wrote it, where the file says.
        trusted: Further targets that may be called.

    Raises:
        ValueError: A `_target_` is neither in `TRUSTED` nor in the environment's HAND_RECON_TRUSTED.
    """
    allowed = TRUSTED | trusted | set(os.environ.get("HAND_RECON_TRUSTED", "").split(","))
    refuse_outdated(config, source, version)
    for target in targets(config):
        if target not in allowed:
            raise ValueError(
                f"{source} asks to call {target!r}, which is not among the targets that are known to be "
                "harmless. If the checkpoint and the target are yours, set "
                f"HAND_RECON_TRUSTED={target} in the environment."
            )


def refuse_outdated(config: DictConfig, source: str, version: str | None = None) -> None:
    """Check that this version has everything of its own that a checkpoint's configuration names.

    Args:
        config: The parts that will be built.
        source: The file, for the message.
        version: Version of hand_recon that wrote it, where the file says.

    Raises:
        ValueError: A `_target_` of hand_recon does not exist.
    """
    for target in targets(config):
        if target.startswith("hand_recon.") and target not in TRUSTED and not _exists(target):
            raise ValueError(
                f"{source} names {target!r}, which hand_recon {__version__} does not have: it was written by "
                f"hand_recon {version or '0.1'}. Use that version, or train again."
            )


def _exists(target: str) -> bool:
    """True if a dotted name of this package can be imported."""
    module, _, name = target.rpartition(".")
    try:
        return hasattr(importlib.import_module(module), name)
    except ImportError:
        return False


def targets(config: DictConfig) -> list[str]:
    """Every `_target_` of a configuration, references resolved; missing values are the target's business."""
    return list(_targets_of(OmegaConf.to_container(config, resolve=True)))


def _targets_of(node: object) -> Iterator[str]:
    if isinstance(node, Mapping):
        if "_target_" in node:
            yield str(node["_target_"])
        for value in node.values():
            yield from _targets_of(value)
    elif isinstance(node, list):
        for value in node:
            yield from _targets_of(value)


def build_hand(config: DictConfig) -> HandModel:
    """Build the hand model of a run."""
    hand: HandModel = instantiate(config.hand)
    return hand


def build_prior(config: DictConfig, hand: HandModel) -> Prior:
    """Build the prior that a member of the `prior` group describes: terms by name, none for null."""
    return Prior(
        {
            str(name): instantiate(term, hand=hand)
            for name, term in config.items()
            if term is not None
        }
    )


def configure_process(threads: int | None, processes: int = 1) -> int:
    """Set the number of compute threads, reset an unsupported start method to spawn, return the number.

    Args:
        threads: Threads; none for every core that is not busy with other processes. More threads than free
            cores are many times slower.
        processes: Processes of this machine that share the cores.
    """
    # The processes of Hydra's joblib launcher have joblib's start method, which their own children
    # do not know.
    if multiprocessing.get_start_method() not in multiprocessing.get_all_start_methods():
        multiprocessing.set_start_method("spawn", force=True)
    count = threads or max(1, default_threads() // processes)
    torch.set_num_threads(count)
    return count


def check_extra(*modules: str) -> None:
    """Check that the packages of the extra `train` are installed, before anything is computed.

    Raises:
        ModuleNotFoundError: One of them is not.
    """
    missing = [name for name in modules if importlib.util.find_spec(name) is None]
    if missing:
        raise ModuleNotFoundError(
            f"Training, reports and figures need {', '.join(missing)}, which is not installed. "
            "Install the extra: pip install 'hand_recon[train]', or in a checkout `make env`."
        )


def plain(config: DictConfig) -> dict[str, Any]:
    """Resolve every reference of a configuration and return it as dictionaries and lists."""
    container = OmegaConf.to_container(config, resolve=True)
    return dict(container)  # type: ignore[arg-type]  # the root of a configuration is a mapping


def use_cache(config: DictConfig, folder: str) -> None:
    """Set every `cache_dir` to this machine's cache folder: a checkpoint has the training machine's."""
    for key in list(config):
        if key == "cache_dir":
            config[key] = folder
        elif isinstance(config._get_node(key), DictConfig):
            use_cache(config[key], folder)


def claim_folder(path: str | Path) -> Path:
    """Make a run's folder.

    Raises:
        FileExistsError: It already holds something that a run writes.
    """
    folder = Path(path).absolute()
    taken = [name for name in PRODUCTS if (folder / name).exists()]
    if taken:
        raise FileExistsError(
            f"{folder} already holds {', '.join(taken)}, and nothing is overwritten. Leave paths.run and "
            "hydra.run.dir to their defaults, or name another folder."
        )
    folder.mkdir(parents=True, exist_ok=True)
    return folder
