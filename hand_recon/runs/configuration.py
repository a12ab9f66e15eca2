"""From a Hydra configuration to objects, and from a checkpoint back to its configuration."""

import hashlib
import multiprocessing
import os
import re
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, Final

import hydra
import torch
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import MissingMandatoryValue

from hand_recon.data.datamodule import HandDataModule
from hand_recon.evaluation.hand_scores import Scores
from hand_recon.hand.model import HandModel
from hand_recon.knowledge.penetration.non_penetration import NonPenetration
from hand_recon.knowledge.prior import Prior
from hand_recon.knowledge.ranges import load_ranges
from hand_recon.regressor.landmark_encoder import LandmarkEncoder
from hand_recon.training.module import HandReconstruction
from hand_recon.uncertainty import DataTerm

CONF: Final = str(Path(__file__).resolve().parents[2] / "conf")
"""Absolute, because Hydra would look for a package of that name when a console script starts it."""

MANO_HAND: Final = "hand_recon.hand.mano.hand.mano_hand"
"""What makes the hand whose surface the datasets' surfaces are numbered as."""

TRUSTED: Final = frozenset(
    {
        "hand_recon.data.augment.Augmentation",
        "hand_recon.data.crop.CropPolicy",
        "hand_recon.data.crop_reader.ReadingPolicy",
        "hand_recon.data.dexycb.datamodule.DexYcbDataModule",
        "hand_recon.data.freihand.datamodule.FreiHandDataModule",
        "hand_recon.data.ho3d.datamodule.Ho3dDataModule",
        "hand_recon.data.landmarks.datamodule.LandmarkDataModule",
        "hand_recon.data.mixture.MixtureDataModule",
        "hand_recon.data.synthetic.datamodule.SyntheticDataModule",
        "hand_recon.regressor.image_encoder.ImageEncoder",
        "hand_recon.regressor.landmark_encoder.LandmarkEncoder",
        "hand_recon.fitting.results.ResultOptions",
        "hand_recon.fitting.descent.Descent",
        MANO_HAND,
        "hand_recon.hand.open_hand.open_hand",
        "hand_recon.knowledge.adversarial.Adversary",
        "hand_recon.knowledge.functional_anatomy.FunctionalAnatomy",
        "hand_recon.knowledge.prior.Prior",
        "hand_recon.regressor.error_feedback.Regressor",
        "hand_recon.training.supervision.Landmarks3D",
        "hand_recon.training.module.warmup_cosine",
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
        "torch.optim.Adam",
        "torch.optim.AdamW",
        "torch.optim.SGD",
        "torch.optim.lr_scheduler.OneCycleLR",
    }
)
"""Every `_target_` that may be called, one by one: a checkpoint brings its configuration with it, and even
torch has functions that run commands."""

SCORED_RANGES: Final = "literature"
"""The table by which every model's violations are counted, whatever its prior knows."""

LONGEST_NAME: Final = 200
"""Bytes of a folder's name; common file systems allow 255."""


def folder_name(overrides: str) -> str:
    """A run's overrides as the name of its folder, in characters that a later override may contain.

    `+experiment=ablation_row1,seed=2` becomes `experiment-ablation_row1__seed-2`. What file systems find
    too long ends in a digest.
    """
    name = re.sub(r"[^\w.-]+", "-", overrides.replace(",", "__").replace("+", "")).strip("-")
    if len(name.encode()) <= LONGEST_NAME:
        return name
    digest = hashlib.sha256(name.encode()).hexdigest()[:8]
    return f"{name.encode()[: LONGEST_NAME - 9].decode(errors='ignore')}-{digest}"


# Used by the folders of conf/train.yaml, evaluate.yaml and fit.yaml.
OmegaConf.register_new_resolver("folder_name", folder_name, replace=True)
# Used by conf/data: surfaces of a dataset are compared with a hand of the same numbering only.
OmegaConf.register_new_resolver(
    "numbering", lambda target: "mano" if target == MANO_HAND else "open", replace=True
)
OmegaConf.register_new_resolver(
    "either", lambda first, second: second if first is None else first, replace=True
)
# Used by conf/recipe/lifter.yaml.
OmegaConf.register_new_resolver("same", lambda first, second: first == second, replace=True)


def instantiate(config: DictConfig | None, **arguments: Any) -> Any:  # noqa: ANN401  # any object
    """Hydra's `instantiate`, for the targets in `TRUSTED`.

    Raises:
        ValueError: A `_target_` is not among them.
    """
    if config is None:
        return None
    # Resolved, so that nothing hides behind a reference; missing values are the target's business.
    _refuse_strangers(OmegaConf.to_container(config, resolve=True))
    if not arguments:
        return hydra.utils.instantiate(config)
    # Given to Hydra, a dataclass among the arguments would come out as a configuration.
    return hydra.utils.instantiate(config, _partial_=True)(**arguments)


def _refuse_strangers(node: object) -> None:
    if isinstance(node, Mapping):
        target = node.get("_target_")
        if target is not None and target not in TRUSTED:
            raise ValueError(
                f"The configuration asks to call {target!r}, which is not among the targets that are "
                "known to be harmless, and a checkpoint from elsewhere may ask for anything. If it is yours, "
                "add it to TRUSTED in hand_recon/runs/configuration.py."
            )
        for value in node.values():
            _refuse_strangers(value)
    elif isinstance(node, list):
        for value in node:
            _refuse_strangers(value)


if not Path(CONF).is_dir():
    raise ImportError(
        f"hand_recon is an application: its configuration is expected at {CONF}. Install it from a checkout "
        "with `make env` or `pip install -e .`, not as a wheel."
    )


def build_hand(config: DictConfig) -> HandModel:
    """The hand model of a run."""
    hand: HandModel = instantiate(config.hand)
    return hand


def build_data(config: DictConfig) -> HandDataModule:
    """The datamodule of a run.

    Raises:
        ValueError: A mandatory value such as `data.root` was not given.
    """
    try:
        OmegaConf.to_container(config.data, resolve=True, throw_on_missing=True)
    except MissingMandatoryValue as error:
        raise ValueError(
            f"{str(error).splitlines()[0]}. Give it on the command line, for example "
            "`data=freihand data.root=/path/to/FreiHAND_pub_v2` or `data=landmarks data.train=labels.json`; "
            "data/README.md tells where each dataset comes from."
        ) from error
    data: HandDataModule = instantiate(config.data)
    return data


def build_module(config: DictConfig) -> HandReconstruction:
    """The Lightning module of a run, with fresh weights."""
    hand = build_hand(config)
    data_term: DataTerm = instantiate(config.data_term)
    optimizer = {key: value for key, value in config.optimizer.items() if key != "schedule"}
    return HandReconstruction(
        instantiate(config.model, hand=hand, correlated=data_term.needs_correlation),
        build_prior(config.prior, hand),
        data_term,
        scores=partial(Scores, load_ranges(SCORED_RANGES), NonPenetration(hand)),
        optimizer=instantiate(OmegaConf.create(optimizer)),
        scheduler=instantiate(config.optimizer.schedule),
        supervision=instantiate(config.get("supervision") or None),
    )


def build_prior(config: DictConfig, hand: HandModel) -> Prior:
    """The prior that a member of the `prior` group describes."""
    rest = {key: value for key, value in config.items() if key != "ranges"}
    ranges = load_ranges(config.ranges, hand.rest_angles)
    prior: Prior = instantiate(OmegaConf.create(rest), ranges=ranges, hand=hand)
    return prior


def check_input(module: HandReconstruction, data: HandDataModule) -> None:
    """Refuse to show a lifter crops that are not cut as its training's are.

    Raises:
        ValueError: The model looks at landmarks, and the data are not views of upright landmarks.
    """
    lifts = isinstance(module.regressor.encoder, LandmarkEncoder)
    if lifts and data.name != "views":
        raise ValueError(
            f"A lifter is trained and scored on data=views, whose crops are cut about the landmarks with the "
            f"fingers up; {data.name}'s are not. For other landmarks use "
            "`python -m hand_recon.fit landmarks=<file> lifter=<run> descent.steps=0`."
        )


def settle_process(threads: int | None) -> int:
    """Fix the number of compute threads and return it; let the process have processes of its own.

    Without a number, every core that this process may use: more than that is many times slower.
    """
    # Hydra's joblib launcher starts its runs by a method of its own. Their children would hear of it as the
    # default and know nothing of it.
    if multiprocessing.get_start_method() not in multiprocessing.get_all_start_methods():
        multiprocessing.set_start_method("spawn", force=True)
    # Not every system knows affinities; there, all cores are this process's.
    usable = getattr(os, "sched_getaffinity", lambda _: range(os.cpu_count() or 1))
    count = threads or len(usable(0))
    torch.set_num_threads(count)
    return count


def plain(config: DictConfig) -> dict[str, Any]:
    """The configuration with every reference resolved, as plain data."""
    container = OmegaConf.to_container(config, resolve=True)
    return dict(container)  # type: ignore[arg-type]  # the root of a configuration is a mapping


def use_cache(config: DictConfig, folder: str) -> None:
    """Let data use this machine's cache: a checkpoint knows the one where it was trained."""
    for key in list(config):
        if key == "cache_dir":
            config[key] = folder
        elif isinstance(config._get_node(key), DictConfig):
            use_cache(config[key], folder)


def claim_folder(path: str | Path) -> Path:
    """Make a run's folder.

    Raises:
        FileExistsError: It already holds a run.
    """
    folder = Path(path).absolute()
    if (folder / "metrics.json").exists() or (folder / "checkpoints").exists():
        raise FileExistsError(
            f"{folder} already holds a run, and nothing is overwritten. Leave paths.run and hydra.run.dir "
            "to their defaults, or name another folder."
        )
    folder.mkdir(parents=True, exist_ok=True)
    return folder
