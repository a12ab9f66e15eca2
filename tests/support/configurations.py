"""Configurations as the commands compose them, with the folders of a test."""

from pathlib import Path

from hydra import compose, initialize_config_dir
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, open_dict

from hand_recon.command_line.configuration_files import CONF
from hand_recon.command_line.resolvers import register_resolvers


def composed(*overrides: str, name: str = "train") -> DictConfig:
    """A command's configuration with Hydra's part; `name` is its file in `conf/`."""
    register_resolvers()
    with initialize_config_dir(CONF, version_base="1.3"):
        # Outside a run of Hydra there is no folder of the run to interpolate.
        config = compose(name, [*overrides, "++paths.run=/nowhere"], return_hydra_config=True)
        HydraConfig.instance().set_config(config)
    return config


def settings(cache: Path, folder: Path, *overrides: str, name: str = "train") -> DictConfig:
    """A command's configuration without Hydra's part, writing into `folder` and caching in `cache`."""
    config = composed(*overrides, name=name)
    with open_dict(config):
        config.paths = {"cache": str(cache), "output": str(folder), "run": str(folder)}
        del config["hydra"]
    return config
