"""What a run did otherwise than the paper (Sec. 4.1), since a number does not say how it came about."""

from collections.abc import Callable, Iterator, Mapping
from typing import Final

from hand_recon.tables.paper import has_papers_likelihood
from hand_recon.tables.published import DATASETS, TEST_HANDS

Settings = Mapping[str, str]
"""A run's settings by dotted name, as text."""

PARTS: Final = {
    "data.setup": "s0",
    "data.version": "v3",
    "data.partial": "False",
    "data.train_every": "1",
    "data.test_every": "1",
}
"""Which part of a dataset the paper trained and tested on, as far as a dataset has such a choice."""

NUMBERS: Final = {
    "crop_size": (224, "{} px"),
    "trainer.max_epochs": (200, "{} epochs"),
    "data.batch_size": (64, "batches of {}"),
    "optimizer.lr": (1e-5, "learning rate {}"),
    "optimizer.weight_decay": (1e-4, "weight decay {}"),
}
"""The paper's values, and how another one is worded."""

KNOWLEDGE: Final = {
    "prior.range_of_motion.weight": "20000.0",
    "prior.range_of_motion.anatomy": "FunctionalAnatomy",
    "prior.non_penetration.weight": "20000.0",
    "prior.shape.weight": "10.0",
    "prior.pose_components.weight": "0.0",
    "prior.adversarial.weight": "0.0",
}
"""The paper's prior: `prior=full`."""

NO_KNOWLEDGE: Final = KNOWLEDGE | {
    "prior.range_of_motion.weight": "0.0",
    "prior.range_of_motion.anatomy": "None",
    "prior.non_penetration.weight": "0.0",
}
"""The shape regularisation alone: `prior=none`."""

_FROM_3D: Final = ("prior.pose_components.weight", "prior.adversarial.weight")
"""Weights of terms that only the priors for comparison have."""


def share_of_3d(settings: Settings) -> float:
    """Share of the training hands whose 3D labels were used.

    >>> share_of_3d({}), share_of_3d({"supervision.fraction": "0.1"})
    (0.0, 0.1)
    """
    return _number(settings.get("supervision.fraction")) or 0.0


def is_adversarial(settings: Settings) -> bool:
    """Whether the prior was a discriminator."""
    return bool(_number(settings.get("prior.adversarial.weight")))


def is_full_knowledge(settings: Settings) -> bool:
    """Whether the prior was the paper's."""
    return not list(_priors(settings, KNOWLEDGE))


def differences(settings: Settings, dataset: str, experiment: str) -> tuple[str, ...]:
    """What is not as in the paper's row, in words; what was not recorded is said to be unknown.

    Args:
        settings: Of a study and of the method.
        dataset: On which the paper measured that row.
        experiment: Name of ours that repeats it, which says what its method is.
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
        yield "2D landmarks in place of pictures"
    elif backbone != "resnet50":
        yield backbone or "unknown backbone"


def _budget(settings: Settings) -> Iterator[str]:
    optimizer = settings.get("optimizer._target_", "unknown.optimizer").rpartition(".")[-1]
    if optimizer != "Adam":
        yield optimizer.replace("_", " ")
    for name, (expected, words) in NUMBERS.items():
        value = _number(settings.get(name))
        if value is None:
            yield words.format("unknown")
        elif value != expected:
            yield words.format(settings[name])
    for name in ("trainer.limit_train_batches", "trainer.max_steps"):
        if settings.get(name) not in (None, "None", "1.0", "-1"):
            yield f"{name}={settings[name]}"


def _method(settings: Settings, experiment: str) -> Iterator[str]:
    if experiment == "table3a_adversarial":
        yield from _discriminator(settings)
    else:
        yield from _priors(settings, NO_KNOWLEDGE if experiment == "table3b_100" else KNOWLEDGE)
    if not has_papers_likelihood(settings):
        yield "another data term than MSE, then NLL"
    share = share_of_3d(settings)
    if share != {"table3b_100": 1.0, "table3b_10": 0.1}.get(experiment, 0.0):
        yield f"3D labels of {100 * share:.3g} %"


def _discriminator(settings: Settings) -> Iterator[str]:
    weight = settings.get("prior.adversarial.weight", "0.0")
    yield from _priors(settings, NO_KNOWLEDGE | {"prior.adversarial.weight": weight})
    real = settings.get("prior.adversarial.real._target_", "")
    if not is_adversarial(settings):
        yield "no discriminator"
    elif "freihand" not in real and settings.get("data") != "freihand":
        yield "real hands of other data than FreiHAND"


def _priors(settings: Settings, expected: Mapping[str, str]) -> Iterator[str]:
    for name, value in expected.items():
        found = _of_prior(settings, name)
        if found != value and (_number(found) is None or _number(found) != _number(value)):
            yield f"{name}={found}"


def _of_prior(settings: Settings, name: str) -> str:
    """A weight or the anatomy of the prior; `unknown` where it was not recorded.

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
    return "0.0" if name in _FROM_3D else "unknown"


def _number(text: str | None) -> float | None:
    try:
        return None if text is None else float(text)
    except ValueError:
        return None
