"""Repeats a run: its own settings in a new folder, with what it was made with, compared before and after."""

import logging
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import yaml
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf, open_dict

from hand_recon.runs.configuration import plain, refuse_untrusted, use_cache
from hand_recon.runs.logged_scalars import LogComparison, compare_logs
from hand_recon.runs.provenance.record import differences, provenance, read_provenance
from hand_recon.runs.results import write_json

logger = logging.getLogger(__name__)

REPEAT_FILE: Final = "repeat.json"
"""File of a repeated run: which one it repeats, what else was different, and whether the losses are."""

OF_THE_LOADER: Final = ("workers", "data.keep")
"""Settings of loading on which no loss depends."""

BESIDE: Final = frozenset({"from_run", "allow_differences", *OF_THE_LOADER})
"""Settings that may be given beside `from_run`; folders may be, too."""


@dataclass(frozen=True)
class Repeat:
    """A run that repeats another one."""

    config: DictConfig
    """Its settings."""
    before: Path
    """Folder of the earlier run."""
    counting: list[str]
    """Differences that losses may depend on."""
    others: list[str]
    """Other differences, such as the machine's."""


def settings_to_repeat(config: DictConfig) -> Repeat:
    """Settings of an earlier run, with the folders of this one, after a check of what else has changed.

    Args:
        config: `conf/train.yaml`, composed, with `from_run`.

    Raises:
        FileNotFoundError: There is no such run.
        ValueError: Its settings name untrusted targets, or other settings were given, or code, packages or
            data are not the same and `allow_differences` is false.
    """
    _refuse_others(_given())
    folder = Path(config.from_run).expanduser().absolute()
    earlier = _settings(folder)
    refuse_untrusted(earlier, str(folder / "config.yaml"))
    known = read_provenance(folder)
    repeated = OmegaConf.create(
        _moved(plain(earlier), str(earlier.paths.run), str(config.paths.run))
    )
    with open_dict(repeated):
        for name in config:
            # Settings that the version of the earlier run did not have.
            if name not in repeated:
                repeated[name] = config[name]
        repeated.paths = config.paths
        # A run that was interrupted and continued has the losses of one that was not.
        repeated.resume = repeated.from_run = None
        for name in OF_THE_LOADER:
            if name in _given():
                OmegaConf.update(repeated, name, OmegaConf.select(config, name))
        if known is not None:
            repeated.threads = known["hardware"]["threads"]
    use_cache(repeated, config.paths.cache)
    counting, others = _what_changed(known, repeated)
    for told in others:
        logger.info("Other than in %s: %s.", folder, told)
    _refuse_differences(counting, folder, allowed=bool(config.allow_differences))
    return Repeat(repeated, folder, counting, others)


def compare(repeat: Repeat) -> LogComparison:
    """Compare the losses of a repeated run with those of the earlier one, and write `repeat.json`.

    Raises:
        ValueError: They are not the same.
    """
    folder = Path(repeat.config.paths.run)
    found = compare_logs(repeat.before, folder)
    told = {"of": str(repeat.before), **found.entries()}
    differing = {"differences": repeat.counting, "other_differences": repeat.others}
    write_json(folder / REPEAT_FILE, told | differing)
    if not found.same:
        raise ValueError(f"{folder} repeats {repeat.before}. {found.told()}")
    logger.info("%s repeats %s. %s", folder, repeat.before, found.told())
    return found


def _given() -> set[str]:
    """Names of the settings of the command line; none outside of a command."""
    if not HydraConfig.initialized():
        return set()
    words = HydraConfig.get().overrides.task
    return {word.lstrip("+~").partition("=")[0] for word in words}


def _refuse_others(given: Iterable[str]) -> None:
    others = sorted(name for name in given if name not in BESIDE and not name.startswith("paths."))
    if others:
        raise ValueError(
            f"from_run repeats a run with the settings that it had, and {', '.join(others)} was given "
            f"besides. Leave that out ({', '.join(sorted(BESIDE - {'from_run'}))} and paths may be "
            "given), or train without from_run."
        )


def _settings(folder: Path) -> DictConfig:
    """Resolved configuration of a run.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It is no configuration, or has references, which hand_recon never writes.
    """
    file = folder / "config.yaml"
    if not file.is_file():
        raise FileNotFoundError(
            f"No run at {folder}: it has no config.yaml. Give the folder of a run, such as "
            "outputs/train/<time>."
        )
    text = file.read_text(encoding="utf-8")
    try:
        content = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise ValueError(f"{file} cannot be read ({error}). Give another run.") from error
    paths = content.get("paths") if isinstance(content, Mapping) else None
    if "${" in text or not isinstance(paths, Mapping) or "run" not in paths:
        raise ValueError(
            f"{file} is no resolved configuration of a training, as `hand-recon train` writes it: it has "
            "references (${…}), or no paths.run. Give another run."
        )
    return OmegaConf.create(dict(content))


def _moved(node: Any, before: str, now: str) -> Any:  # noqa: ANN401  # any configuration
    """The same with another folder for the run's."""
    if isinstance(node, Mapping):
        return {key: _moved(value, before, now) for key, value in node.items()}
    if isinstance(node, list):
        return [_moved(value, before, now) for value in node]
    if isinstance(node, str) and (node == before or node.startswith(f"{before}/")):
        return now + node[len(before) :]
    return node


def _what_changed(
    known: Mapping[str, Any] | None, config: DictConfig
) -> tuple[list[str], list[str]]:
    if known is None:
        return ["its folder has no provenance.json, so that nothing is known of it"], []
    now, _ = provenance(plain(config))
    now["hardware"]["threads"] = known["hardware"]["threads"]
    return differences({**known, "used": {}}, now)


def _refuse_differences(counting: list[str], folder: Path, *, allowed: bool) -> None:
    if not counting:
        return
    told = "; ".join(counting)
    if not allowed:
        raise ValueError(
            f"{folder} cannot be repeated exactly: {told}. Restore these, or give allow_differences=true to "
            "see how much they change."
        )
    logger.warning("Other than in %s, and losses may depend on it: %s.", folder, told)
