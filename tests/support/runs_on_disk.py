"""Folders of finished runs with known scores, and the configuration of a report on them."""

import json
from pathlib import Path
from typing import Any

import yaml
from omegaconf import DictConfig, OmegaConf, open_dict

from tests.support.configurations import composed


def write_run(
    folder: Path,
    config: dict[str, Any],
    test: dict[str, float],
    per_hand: list[float] | None = None,
) -> Path:
    """Write a run's folder as `finish_run` does."""
    folder.mkdir(parents=True)
    (folder / "config.yaml").write_text(yaml.safe_dump(config))
    metrics = {
        "name": config["name"], "data": "synthetic", "landmarks": "knuckle", "test_hands": 4,
        "test": test, "mean_pose": {"E_J": 18.0, "E_V": 17.0}, "environment": {"python": "3"},
    }  # fmt: skip
    (folder / "metrics.json").write_text(json.dumps(metrics))
    if per_hand is not None:
        lines = [f"{index},{error}" for index, error in enumerate(per_hand)]
        (folder / "per_hand.csv").write_text("\n".join(["index,E_J", *lines]) + "\n")
    return folder


def report_config(runs: Path | list[Path] | None, output: Path, **more: object) -> DictConfig:
    """The configuration of a report on runs, with a bootstrap of 400 resamples, without Hydra's part."""
    config = composed(name="report")
    with open_dict(config):
        del config["hydra"]
    config.runs = [str(run) for run in runs] if isinstance(runs, list) else runs and str(runs)
    config.output = str(output)
    config.bootstrap.resamples = 400
    for name, value in more.items():
        OmegaConf.update(config, name, value)
    return config
