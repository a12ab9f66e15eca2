"""Composes a configuration inside any program, also one that Hydra has started."""

import threading
from collections.abc import Sequence
from typing import Final

import hydra
from hydra.core.global_hydra import GlobalHydra
from omegaconf import DictConfig

from hand_recon.command_line.configuration_files import CONF
from hand_recon.command_line.resolvers import register_resolvers

_LOCK: Final = threading.Lock()
"""Hydra has one state per process."""


def composed(config_name: str, overrides: Sequence[str] = ()) -> DictConfig:
    """Compose a configuration, and leave Hydra's state as it was.

    Args:
        config_name: A file of `conf`, without its ending.
        overrides: In Hydra's grammar.
    """
    register_resolvers()
    with _LOCK:
        before = GlobalHydra.get_state()
        GlobalHydra.instance().clear()
        try:
            with hydra.initialize_config_dir(CONF, version_base="1.3"):
                return hydra.compose(config_name, list(overrides))
        finally:
            GlobalHydra.set_state(before)
