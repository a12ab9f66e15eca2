"""Hydra's configuration files: where they are, and which names a verb's file knows."""

from functools import cache
from pathlib import Path
from typing import Final

import yaml

PACKAGE: Final = Path(__file__).resolve().parents[1]
"""The folder of `hand_recon`."""

CONF: Final = str(PACKAGE / "conf" if (PACKAGE / "conf").is_dir() else PACKAGE.parent / "conf")
"""Folder of the configuration: inside the package in a wheel, beside it in a checkout. Absolute,
because Hydra would look for a package of that name when a console script starts it."""


@cache
def known_names(config_name: str) -> frozenset[str]:
    """Names that a command line may set, up to their first dot: top-level keys and groups.

    Args:
        config_name: A file of `conf`, without its ending.
    """
    keys = {str(key) for key in _content(config_name)}
    for group in groups(config_name):
        for member in (Path(CONF) / group).glob("*.yaml"):
            text = member.read_text(encoding="utf-8")
            # Members such as recipes write into the root.
            if "@package _global_" in text.partition("\n")[0]:
                keys |= {str(key) for key in yaml.safe_load(text) or ()}
    return frozenset(keys - {"defaults"}) | groups(config_name)


@cache
def groups(config_name: str) -> frozenset[str]:
    """Groups in a file's defaults list."""
    return frozenset(_chosen(_content(config_name)))


def booleans(config_name: str) -> frozenset[str]:
    """Top-level keys that are true or false."""
    content = _content(config_name)
    return frozenset(str(key) for key, value in content.items() if isinstance(value, bool))


def _content(config_name: str) -> dict[str, object]:
    """A configuration file with what it inherits from files of its own folder."""
    content = yaml.safe_load((Path(CONF) / f"{config_name}.yaml").read_text(encoding="utf-8"))
    inherited: dict[str, object] = {}
    defaults: list[object] = []
    for entry in content.get("defaults", []):
        if isinstance(entry, str) and entry != "_self_":
            other = _content(entry)
            defaults += other.get("defaults", [])  # type: ignore[arg-type]  # a list in every file
            inherited |= other
        else:
            defaults.append(entry)
    return inherited | content | {"defaults": defaults}


def _chosen(content: dict[str, object]) -> set[str]:
    """Groups of a defaults list."""
    defaults = content.get("defaults", [])
    entries = defaults if isinstance(defaults, list) else []
    return {
        str(key).removeprefix("optional ").removeprefix("override ").split("@")[-1].split("/")[0]
        for entry in entries
        if isinstance(entry, dict)
        for key in entry
    }
