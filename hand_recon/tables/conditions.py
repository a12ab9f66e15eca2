"""Differences of a run's settings from the paper's (Sec. 4.1)."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import nullcontext
from functools import cache
from typing import Any, Final

from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from omegaconf import OmegaConf

from hand_recon.command_line.configuration_files import CONF
from hand_recon.tables.paper import has_papers_likelihood
from hand_recon.tables.published import DATASETS, TEST_HANDS
from hand_recon.tables.runs import flattened

Settings = Mapping[str, str]
"""Settings by dotted name, as text."""

PARTS: Final = {
    "data.setup": "s0",
    "data.version": "v3",
    "data.partial": "False",
    "data.train_every": "1",
    "data.test_every": "1",
}
"""Part of a dataset that the paper trained and tested on, for datasets with such a choice."""

WORDS: Final = {
    "crop_size": "{} px",
    "trainer.max_epochs": "{} epochs",
    "data.batch_size": "batches of {}",
    "optimizer.lr": "learning rate {}",
    "optimizer.weight_decay": "weight decay {}",
}
"""Numeric settings that are compared with the paper's, and the wording of another value."""

PRIOR: Final = (
    "prior.range_of_motion.weight",
    "prior.range_of_motion.anatomy",
    "prior.non_penetration.weight",
    "prior.shape.weight",
    "prior.natural_pose.weight",
    "prior.pose_components.weight",
    "prior.adversarial.weight",
)
"""Settings of the prior that are compared with the paper's."""

_NOT_IN_PAPER: Final = (
    "prior.natural_pose.weight",
    "prior.pose_components.weight",
    "prior.adversarial.weight",
)
"""Weights of terms that the paper's priors do not have."""


@cache
def paper_settings(prior: str = "full") -> Settings:
    """Settings of the paper (Sec. 4.1), composed from `conf` with `recipe=paper`.

    >>> paper_settings()["prior.shape.weight"]
    '10.0'

    Args:
        prior: Member of the group `prior`: `full` for the paper's, `none` for the shape term alone.
    """
    # A command has initialised Hydra with this folder, and Hydra refuses a second time.
    is_command = GlobalHydra.instance().is_initialized()
    with nullcontext() if is_command else initialize_config_dir(CONF, version_base="1.3"):
        config = compose("train", ["recipe=paper", f"prior={prior}"])
    settings: Any = OmegaConf.to_container(config, resolve=False)
    return flattened(settings)


def share_of_3d(settings: Settings) -> float:
    """Share of the training hands whose 3D labels were used, 0 to 1.

    >>> share_of_3d({}), share_of_3d({"supervision.fraction": "0.1"})
    (0.0, 0.1)
    """
    return _number(settings.get("supervision.fraction")) or 0.0


def is_adversarial(settings: Settings) -> bool:
    """True if the prior has a discriminator."""
    return bool(_number(settings.get("prior.adversarial.weight")))


def is_full_knowledge(settings: Settings) -> bool:
    """True if the prior is the paper's."""
    return not list(_prior(settings, "full"))


def differences(settings: Settings, dataset: str, experiment: str) -> tuple[str, ...]:
    """Differences from a row of the paper, in words; settings that were not recorded are called unknown.

    Args:
        settings: Settings of the study and of the method.
        dataset: Dataset on which the paper measured the row.
        experiment: Name of our experiment that reproduces the row.
    """
    if not any(name.startswith(("model.", "trainer.")) for name in settings):
        return ("all settings but its name are unknown",)
    checks: tuple[Callable[[], Iterator[str]], ...] = (
        lambda: _data(settings, dataset),
        lambda: _model(settings),
        lambda: _budget(settings),
        lambda: _method(settings, experiment),
    )
    return tuple(words for check in checks for words in check())


def _data(settings: Settings, dataset: str) -> Iterator[str]:
    data = settings.get("data", "unknown data")
    if data != dataset:
        yield " ".join(filter(None, ["on", data, settings.get("data.level")]))
        return
    yield from (
        f"{name}={settings[name]}"
        for name, part in PARTS.items()
        if settings.get(name, part) != part
    )
    hands, official = settings.get("test_hands"), TEST_HANDS.get(dataset)
    if official is not None and hands != str(official):
        yield f"{hands or 'unknown number of'} test hands, not {DATASETS[dataset]}'s {official}"


def _model(settings: Settings) -> Iterator[str]:
    hand = settings.get("hand._target_", "unknown.hand").rpartition(".")[-1]
    if not hand.startswith("mano"):
        yield hand.replace("_", " ")
    encoder = settings.get("model.encoder._target_", "")
    backbone = settings.get("model.encoder.backbone")
    if encoder.endswith("LandmarkEncoder"):
        yield "2D landmarks in place of images"
    elif backbone != paper_settings()["model.encoder.backbone"]:
        yield backbone or "unknown backbone"


def _budget(settings: Settings) -> Iterator[str]:
    paper = paper_settings()
    optimizer = settings.get("optimizer._target_", "unknown.optimizer")
    if optimizer != paper["optimizer._target_"]:
        yield optimizer.rpartition(".")[-1].replace("_", " ")
    for name, words in WORDS.items():
        value = _number(settings.get(name))
        if value is None:
            yield words.format("unknown")
        elif value != _number(paper[name]):
            yield words.format(settings[name])
    for name in ("trainer.limit_train_batches", "trainer.max_steps"):
        if settings.get(name) not in (None, "None", "1.0", "-1"):
            yield f"{name}={settings[name]}"


def _method(settings: Settings, experiment: str) -> Iterator[str]:
    if experiment == "table3a_adversarial":
        yield from _discriminator(settings)
    else:
        yield from _prior(settings, "none" if experiment == "table3b_100" else "full")
    if not has_papers_likelihood(settings):
        yield "another data term than MSE, then NLL"
    share = share_of_3d(settings)
    if share != {"table3b_100": 1.0, "table3b_10": 0.1}.get(experiment, 0.0):
        yield f"3D labels of {100 * share:.3g} %"


def _discriminator(settings: Settings) -> Iterator[str]:
    yield from _prior(settings, "none", ignored="prior.adversarial.weight")
    real = settings.get("prior.adversarial.real._target_", "")
    if not is_adversarial(settings):
        yield "no discriminator"
    elif "freihand" not in real and settings.get("data") != "freihand":
        yield "real hands of other data than FreiHAND"


def _prior(settings: Settings, member: str, ignored: str | None = None) -> Iterator[str]:
    """Differences from a member of the group `prior`."""
    paper = paper_settings(member)
    for name in PRIOR:
        if name == ignored:
            continue
        found, value = _of_prior(settings, name), _of_prior(paper, name)
        if found != value and (_number(found) is None or _number(found) != _number(value)):
            yield f"{name}={found}"


def _of_prior(settings: Settings, name: str) -> str:
    """Weight of a term or name of the anatomy; `unknown` where it was not recorded.

    >>> _of_prior({"prior.shape.weight": "10.0"}, "prior.shape.weight")
    '10.0'
    >>> _of_prior({"prior.non_penetration": "None"}, "prior.non_penetration.weight")
    '0.0'
    >>> _of_prior({"prior.range_of_motion": "None"}, "prior.range_of_motion.anatomy")
    'None'
    """
    if name in settings:
        return settings[name]
    if f"{name}._target_" in settings:
        return settings[f"{name}._target_"].rpartition(".")[-1]
    if settings.get(name.rpartition(".")[0]) == "None":
        return "0.0" if name.endswith(".weight") else "None"
    return "0.0" if name in _NOT_IN_PAPER else "unknown"


def _number(text: str | None) -> float | None:
    try:
        return None if text is None else float(text)
    except ValueError:
        return None
