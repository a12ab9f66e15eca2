"""Search spaces: settings by dotted name, with the values that a trial may take."""

import importlib
from collections.abc import Mapping
from typing import Any

from hand_recon.command_line.words import quoted


def distributions(space: Mapping[str, Any]) -> dict[str, Any]:
    """Optuna's distributions of a search space.

    Args:
        space: By dotted name, `{low, high}` with `log` or `step`, or `{choices}`.

    Raises:
        ValueError: The space is empty, or a setting has neither.
    """
    if not space:
        raise ValueError(
            "The search space is empty. Name one with search=learning_rate or search=knowledge, or write a "
            "file like theirs into conf/search."
        )
    return {name: _distribution(name, given) for name, given in space.items()}


def _distribution(name: str, given: Any) -> Any:  # noqa: ANN401  # Optuna's
    kinds = importlib.import_module("optuna.distributions")
    if isinstance(given, Mapping) and given.keys() == {"choices"}:
        return kinds.CategoricalDistribution(tuple(given["choices"]))
    allowed = {"low", "high", "log", "step"}
    if not isinstance(given, Mapping) or not {"low", "high"} <= given.keys() <= allowed:
        raise ValueError(
            f"search.space has {given!r} for {name}; expected {{low, high}} with log: true or step, or "
            "{choices: […]}."
        )
    whole = all(isinstance(given[key], int) for key in ("low", "high"))
    kind = kinds.IntDistribution if whole else kinds.FloatDistribution
    options = {key: given[key] for key in ("log", "step") if key in given}
    return kind(given["low"], given["high"], **options)


def overrides(values: Mapping[str, Any]) -> tuple[str, ...]:
    """Values of a trial in Hydra's grammar.

    >>> overrides({"optimizer.lr": 0.001, "hand.path": None, "prior": "full", "compile": True})
    ('optimizer.lr=0.001', 'hand.path=null', "prior='full'", 'compile=true')
    """
    return tuple(f"{name}={_written(value)}" for name, value in values.items())


def _written(value: object) -> str:
    if value is None:
        return "null"
    if isinstance(value, bool):
        return str(value).lower()
    return quoted(value) if isinstance(value, str) else repr(value)
