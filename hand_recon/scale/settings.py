"""Settings of workers as plain dictionaries, which any process can be sent."""

from collections.abc import Sequence
from typing import Any, Final

from omegaconf import DictConfig, OmegaConf

from hand_recon.command_line.composing import composed
from hand_recon.runs.fit_landmarks import COMMAND_ONLY as FIT_ALONE
from hand_recon.runs.fit_landmarks import check_overrides
from hand_recon.runs.fit_run import adapted_to_data

COMMAND_ONLY: Final = {
    "predict": frozenset(
        {"batch", "column", "engine", "input", "json", "motion", "name", "output", "part", "rank", "ray",
         "results", "strict", "threads", "workers"}
    ),
    "fit": FIT_ALONE,
    "audit": frozenset(
        {"files", "fps", "name", "output", "repair", "sequence", "strict", "threads", "worst"}
    ),
}  # fmt: skip
"""Settings of each verb that only the command reads."""

_FUNCTIONS: Final = {
    "predict": "reconstruct_hands", "fit": "fit_hands", "audit": "audit_hands",
}  # fmt: skip
_OF_THE_COMMAND: Final = ("hydra", "paths", "input", "files", "motion", "results")
_GIVEN: Final = {"predict": ["input=[]"], "fit": [], "audit": ["files=[]"]}


def plain_settings(verb: str, overrides: Sequence[str]) -> dict[str, Any]:
    """Compose the configuration of a verb.

    Args:
        verb: `predict`, `fit` or `audit`.
        overrides: In Hydra's grammar.

    Raises:
        ValueError: A setting is the command's own, or needs all hands at once.
    """
    check_overrides(overrides, COMMAND_ONLY[verb], _FUNCTIONS[verb])
    return worker_settings(composed(verb, [*_GIVEN[verb], *overrides]))


def worker_settings(config: DictConfig) -> dict[str, Any]:
    """Settings of a worker from a composed configuration.

    Args:
        config: Configuration of `predict`, `fit` or `audit`.

    Raises:
        ValueError: A setting needs all hands at once.
    """
    if config.get("same_person"):
        raise ValueError(
            "Found same_person=true, which needs all hands at once; a column is worked on in parts. Leave it "
            "out, or run hand-recon predict without engine=daft."
        )
    adapted = config if "files" in config else adapted_to_data(config)
    kept = [str(key) for key in adapted if key not in _OF_THE_COMMAND]
    # Node by node: folders of a run are not known outside of one.
    return {key: _resolved(adapted, key) for key in kept}


def _resolved(config: DictConfig, key: str) -> Any:  # noqa: ANN401  # any plain value
    value = config[key]
    return OmegaConf.to_container(value, resolve=True) if OmegaConf.is_config(value) else value
