"""The study of a search: Optuna's journal in the search's folder, and the settings that it belongs to."""

import importlib
import json
import logging
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from hand_recon.data.whole_files import replaced_when_whole
from hand_recon.runs.configuration import instantiate

SEARCH_FILE: Final = "search.json"
"""File of the settings of a search."""

JOURNAL_FILE: Final = "study.journal"
"""File of Optuna's journal, to which lines are only added."""

PRUNED: Final = "pruned_at_epoch"
"""Attribute of a trial that was ended early."""

ERROR: Final = "error"
"""Attribute of a trial that failed."""


@dataclass(frozen=True)
class Searched:
    """Settings of a search, on which the trials depend."""

    space: dict[str, Any]
    """The search space."""
    objective: str
    """Score of the validation hands, `val/<name>`."""
    direction: str
    """`minimize` or `maximize`."""
    seed: int
    """Seed of the sampler."""
    sampler: dict[str, Any]
    """Settings of the sampler."""
    pruner: dict[str, Any] | None
    """Settings of the pruner; none lets all trials go on."""
    overrides: tuple[str, ...]
    """Overrides that all trials share."""

    def __post_init__(self) -> None:
        if not self.objective.startswith("val/"):
            raise ValueError(
                f"search.objective={self.objective}; expected a score of the validation hands such as "
                "val/E_2D or val/E_J. Settings that are chosen by scores of the test hands make these "
                "scores too good."
            )
        given = {word.lstrip("+~").partition("=")[0] for word in self.overrides}
        if both := sorted(given & self.space.keys()):
            raise ValueError(
                f"{', '.join(both)} is given, and is in the search space, too. Leave it out of one of them."
            )


def check_optuna() -> None:
    """Check that Optuna is installed.

    Raises:
        ModuleNotFoundError: It is not.
    """
    if importlib.util.find_spec("optuna") is None:
        raise ModuleNotFoundError(
            "A search needs optuna, which is not installed. Install the extra: pip install "
            "'hand_recon[sweeps]'."
        )


def claim(folder: Path, searched: Searched) -> None:
    """Write the settings of a new search, or check that those of an earlier one are the same.

    Raises:
        FileExistsError: The folder has a search with other settings.
    """
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / SEARCH_FILE
    now = json.loads(json.dumps(asdict(searched)))
    if file.exists():
        before = json.loads(file.read_text(encoding="utf-8"))
        changed = sorted(key for key in now if before.get(key) != now[key])
        if changed:
            told = "; ".join(f"{key} was {before.get(key)}, is {now[key]}" for key in changed)
            raise FileExistsError(
                f"{folder} has a search with other settings ({told}). Repeat that command to go on with it, "
                "or name another folder."
            )
        return
    with replaced_when_whole(file) as unfinished:
        unfinished.write_text(json.dumps(now, indent=1) + "\n", encoding="utf-8")


def open_study(folder: Path) -> Any:  # noqa: ANN401  # Optuna's
    """The study of a search's folder, with its pruner.

    Args:
        folder: One with `search.json`.
    """
    optuna = importlib.import_module("optuna")
    backend = importlib.import_module("optuna.storages.journal").JournalFileBackend
    optuna.logging.set_verbosity(logging.WARNING)
    settings = json.loads((folder / SEARCH_FILE).read_text(encoding="utf-8"))
    pruner = settings["pruner"]
    return optuna.create_study(
        study_name="search",
        storage=optuna.storages.JournalStorage(backend(str(folder / JOURNAL_FILE))),
        direction=settings["direction"],
        load_if_exists=True,
        pruner=optuna.pruners.NopPruner() if pruner is None else built(pruner),
    )


def trial_of(study: Any, number: int) -> Any:  # noqa: ANN401  # Optuna's
    """A trial that is going on, by its number, in any process."""
    optuna = importlib.import_module("optuna")
    # Optuna has no public way from a number to its identity in the storage.
    identity = study.get_trials(deepcopy=False)[number]._trial_id
    return optuna.trial.Trial(study, identity)


def built(settings: dict[str, Any], **more: Any) -> Any:  # noqa: ANN401  # a sampler or pruner
    """A sampler or a pruner from its settings."""
    from omegaconf import OmegaConf

    return instantiate(OmegaConf.create(settings), **more)


def states(study: Any) -> list[Any]:  # noqa: ANN401  # Optuna's
    """All trials of a study, in their order."""
    return list(study.get_trials(deepcopy=False))
