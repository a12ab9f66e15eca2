"""Writes and reads checkpoints with their configuration, so that they rebuild themselves."""

import copy
import pickle
import struct
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import lightning
import torch
from hydra.errors import InstantiationException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from hand_recon import __version__
from hand_recon.evaluation.scores import HandPoints
from hand_recon.reading.archives import refuse_packed
from hand_recon.regressor.lifter_file import fingerprint
from hand_recon.runs.building import build_module
from hand_recon.runs.checkpoint_files import checkpoint_at
from hand_recon.runs.configuration import refuse_untrusted, targets
from hand_recon.runs.sigma_calibration import SIGMA_FACTOR_KEY
from hand_recon.training.module import HandReconstruction

CONFIG_KEY: Final = "hand_recon_config"
"""Key of the resolved configuration in a checkpoint, as plain data."""

MEAN_POSE_KEY: Final = "hand_recon_mean_pose"
"""Key of the mean training hand: `landmarks` and, where known, `vertices`, metres."""

VERSION_KEY: Final = "hand_recon_version"
"""Key of the version of hand_recon that wrote the checkpoint; 0.1 wrote none."""

HAND_KEY: Final = "hand_recon_hand"
"""Key of the fingerprint of the hand that the model was trained with."""

_NO_PICKLE: Final = (
    pickle.UnpicklingError, EOFError, RuntimeError, LookupError, ValueError, TypeError, AttributeError,
    struct.error, OverflowError, AssertionError, NotImplementedError, zipfile.BadZipFile,
)  # fmt: skip
"""Errors of reading bytes that are no pickle: their first letters are taken for its instructions."""

_NOT_OURS: Final = (
    OmegaConfBaseException, InstantiationException, RuntimeError, KeyError, TypeError, AttributeError,
)  # fmt: skip
"""Errors of building a network from a configuration, or filling it with weights, that are not its own."""

_NO_MEMORY: Final = ("can't allocate memory", "not enough memory")
"""Texts in PyTorch's RuntimeError about memory that the system does not give."""

_GROUPS: Final = ("hand", "model", "prior")
"""Parts of a configuration whose settings are changed before they are built."""

MOST_LEVELS: Final = 50
"""Levels of a checkpoint's configuration; those of this project have fewer than ten."""

MOST_VALUES: Final = 100_000
"""Keys and values of a checkpoint's configuration, each counted as often as it is referred to."""

BUILT: Final = ("hand", "model", "prior", "data_term", "supervision", "data")
"""Parts of a checkpoint's configuration that are built again when it is loaded or evaluated."""


class ConfigInCheckpoint(lightning.Callback):
    """Write into every checkpoint what it takes to rebuild and to evaluate it.

    The version of hand_recon; the resolved configuration; a fingerprint of the hand, since the same weights
    on another hand are another model; and the mean training hand, the constant predictor that a model is
    compared with.
    """

    def __init__(
        self, config: dict[str, Any], mean_pose: Callable[[], dict[str, torch.Tensor]]
    ) -> None:
        super().__init__()
        self.config = config
        self.mean_pose = mean_pose

    def on_save_checkpoint(
        self,
        trainer: lightning.Trainer,
        pl_module: lightning.LightningModule,
        checkpoint: dict[str, Any],
    ) -> None:
        """Add the entries."""
        checkpoint[VERSION_KEY] = __version__
        checkpoint[CONFIG_KEY] = self.config
        checkpoint[HAND_KEY] = fingerprint(pl_module.regressor.hand)  # type: ignore[union-attr, arg-type]
        # Asked for only now: the mean hand needs all training hands, which may still be rendered before.
        checkpoint[MEAN_POSE_KEY] = self.mean_pose()


def read_checkpoint(path: str | Path) -> tuple[dict[str, Any], DictConfig]:
    """Read a checkpoint's contents and its configuration.

    Args:
        path: A `.ckpt` file of this project, or the folder of a run (its best checkpoint is taken).

    Raises:
        FileNotFoundError: There is no such checkpoint.
        ValueError: The file is not a checkpoint of this project.
    """
    file = checkpoint_at(path)
    if not file.is_file():
        raise FileNotFoundError(
            f"No checkpoint at {file}. Give a run's folder, or a file such as "
            "outputs/train/<time>/checkpoints/best.ckpt."
        )
    checkpoint = _loaded(file)
    if CONFIG_KEY not in checkpoint:
        raise ValueError(
            f"{file} has no configuration of hand_recon in it (it has {sorted(checkpoint)}). "
            "Only checkpoints that hand_recon.train wrote can be read."
        )
    if not isinstance(checkpoint[CONFIG_KEY], dict):
        raise ValueError(
            f"{file} has a {type(checkpoint[CONFIG_KEY]).__name__} in place of its configuration; expected a "
            "checkpoint that hand_recon.train wrote."
        )
    _refuse_strange(checkpoint[CONFIG_KEY], file)
    try:
        return checkpoint, OmegaConf.create(checkpoint[CONFIG_KEY])
    except OmegaConfBaseException as error:
        raise ValueError(
            f"{file} has a configuration that is none ({error}). Take another copy, or train again."
        ) from error


def _loaded(file: Path) -> dict[str, Any]:
    """Contents of a checkpoint.

    Raises:
        ValueError: The file is none, is compressed, or is damaged.
        MemoryError: There is not enough memory for a file that is whole.
    """
    refuse_packed(file)
    try:
        checkpoint = torch.load(file, map_location="cpu", weights_only=True)
    except (*_NO_PICKLE, MemoryError) as error:
        # The members of an archive are no larger than the file; other files can announce any size.
        if _lacks_memory(error) and zipfile.is_zipfile(file):
            raise MemoryError(f"{file} has {file.stat().st_size:,} bytes") from error
        raise ValueError(
            f"{file} is no checkpoint, or a damaged one. Give a run's folder, or a file such as "
            "outputs/train/<time>/checkpoints/best.ckpt."
        ) from error
    if not isinstance(checkpoint, dict):
        raise ValueError(
            f"{file} holds a {type(checkpoint).__name__}; expected a checkpoint that hand_recon.train wrote."
        )
    return checkpoint


def _lacks_memory(error: Exception) -> bool:
    return isinstance(error, MemoryError) or any(text in str(error) for text in _NO_MEMORY)


def _refuse_strange(configuration: object, file: Path) -> None:
    """Refuse a configuration with references of OmegaConf's, or one that it would never finish to read.

    Raises:
        ValueError: A reference occurs in a key or a value, however deep; or there are more levels than
            `MOST_LEVELS`, as in a value that holds itself, or more values than `MOST_VALUES`.
    """
    left, count = [(configuration, 1)], 0
    while left:
        node, level = left.pop()
        count += 1
        if level > MOST_LEVELS or count > MOST_VALUES:
            raise ValueError(
                f"{file} has a configuration of more than {MOST_LEVELS} levels or {MOST_VALUES:,} values, or "
                "one that holds itself; hand_recon writes fewer than ten levels. It is not read."
            )
        if isinstance(node, str) and "${" in node:
            raise ValueError(
                f"{file} has a configuration with references (${{...}}) in it, which hand_recon never writes "
                "and which could hide what would be called. It is not read."
            )
        if isinstance(node, Mapping):
            left += [(one, level + 1) for one in (*node.keys(), *node.values())]
        elif isinstance(node, list | tuple):
            left += [(one, level + 1) for one in node]


@dataclass(frozen=True)
class Trained:
    """A trained module with its configuration."""

    module: HandReconstruction
    """With the trained weights, in evaluation mode."""
    config: DictConfig
    """The configuration that it was trained with."""
    mean_pose: HandPoints | None
    """The mean training hand; none where the training data have no 3D."""
    sigma_factor: float = 1.0
    """Factor of the predicted σ that the validation hands gave."""


def load_trained(
    path: str | Path, landmark_set: str | None = None, composed: DictConfig | None = None
) -> Trained:
    """Rebuild a checkpoint's module with its weights; see `read_checkpoint`.

    Args:
        path: Checkpoint, or folder of a run.
        landmark_set: Landmark set to predict in place of the one that was trained, for data whose
            annotators put the landmarks elsewhere: the hand is the same.
        composed: The configuration of the run that has just written the checkpoint: its targets are trusted.

    Raises:
        ValueError: It names a target that is not trusted, or was trained with another version of the hand.
    """
    checkpoint, config = read_checkpoint(path)
    _refuse_other_groups(path, config)
    try:
        return _rebuilt(path, checkpoint, config, landmark_set, composed)
    except _NOT_OURS as error:
        raise ValueError(
            f"{path} cannot be rebuilt: its configuration or its weights are not those of a network that "
            f"hand_recon.train wrote ({error}). Take another copy, or train again."
        ) from error


def _refuse_other_groups(path: str | Path, config: DictConfig) -> None:
    """Check that the parts that are changed before they are built are groups of settings.

    Raises:
        ValueError: One is missing, or is something else.
    """
    for name in _GROUPS:
        found = config.get(name)
        if not isinstance(found, DictConfig):
            raise ValueError(
                f"{path} has {name}: {'null' if found is None else repr(found)[:60]} in its configuration; "
                "expected the group of settings that hand_recon train writes. Take another copy, or train "
                "again."
            )


def _rebuilt(
    path: str | Path,
    checkpoint: dict[str, Any],
    config: DictConfig,
    landmark_set: str | None,
    composed: DictConfig | None,
) -> Trained:
    if landmark_set is not None:
        config.hand.landmark_set = landmark_set
    # The weights are in the checkpoint, so ImageNet weights are not downloaded.
    built = copy.deepcopy(config)
    built.start_from = "none"
    if "weights" in built.model.encoder:
        built.model.encoder.weights = "none"
    # The prior is not evaluated, and its table may exist only on the machine that trained.
    if built.prior.get("range_of_motion") is not None:
        built.prior.range_of_motion.ranges = "literature"
    # Nothing is trained, so an optimizer of the user's own need not be importable.
    built.optimizer = {"_target_": "torch.optim.Adam", "_partial_": True, "schedule": None}
    refuse_untrusted(
        OmegaConf.masked_copy(built, [name for name in BUILT if name in built]),
        str(path),
        checkpoint.get(VERSION_KEY),
        frozenset() if composed is None else frozenset(targets(composed)),
    )
    module = build_module(built)
    hand = fingerprint(module.regressor.hand)
    if hand != checkpoint.get(HAND_KEY):
        raise ValueError(
            f"{path} was trained with the hand {checkpoint.get(HAND_KEY)!r}, but this version has "
            f"{hand!r}. Angles and shapes of the two do not correspond: use the version that it was "
            "trained with, or train again."
        )
    module.load_state_dict(checkpoint["state_dict"], strict=True)
    points = checkpoint.get(MEAN_POSE_KEY)
    mean = HandPoints(**points) if points else None
    return Trained(module.eval(), config, mean, float(checkpoint.get(SIGMA_FACTOR_KEY, 1.0)))
