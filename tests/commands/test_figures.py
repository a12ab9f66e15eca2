"""`hand_recon.figures` draws what the rows of a sweep say of the same test hands."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from hydra import compose, initialize_config_dir
from omegaconf import DictConfig, OmegaConf

from hand_recon.command_line.configuration_files import CONF
from hand_recon.regressor.lifter_file import fingerprint
from hand_recon.runs.building import build_module
from hand_recon.runs.checkpoints import CONFIG_KEY, HAND_KEY
from hand_recon.runs.configuration import plain
from hand_recon.runs.figures_run import figures
from tests.support.configurations import settings


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


def write_row(folder: Path, row: int, seed: int = 0) -> None:
    """A run's folder with a checkpoint that nothing has trained."""
    config = settings(
        Path("/nowhere"), folder, f"experiment=ablation_row{row}", f"seed={seed}", "synthetic.test=8",
        "crop_size=48", "data.render_workers=1", "model.encoder.backbone=mobilenet_v3_small",
        "model.width=32",
    )  # fmt: skip
    torch.manual_seed(row)
    module = build_module(config)
    (folder / "checkpoints").mkdir(parents=True)
    checkpoint = {
        "state_dict": module.state_dict(),
        CONFIG_KEY: plain(config),
        HAND_KEY: fingerprint(module.regressor.hand),
    }
    torch.save(checkpoint, folder / "checkpoints" / "best.ckpt")
    OmegaConf.save(OmegaConf.create(plain(config)), folder / "config.yaml")
    metrics = {"name": config.name, "data": "synthetic", "test_hands": 8, "test": {"E_J": 10.0}}
    (folder / "metrics.json").write_text(json.dumps(metrics))


def asked(runs: Path, output: Path, cache: Path, **more: object) -> DictConfig:
    """The configuration of the figures of some runs, small."""
    config = settings(cache, output, name="figures")
    config.runs, config.output = str(runs), str(output)
    config.threads, config.panel, config.count, config.examples = 1, 48, 2, 2
    for name, value in more.items():
        config[name] = value
    return config


def test_every_figure_is_drawn_and_none_is_overwritten(tmp_path: Path, cache: Path) -> None:
    write_row(tmp_path / "sweep" / "0", 1)
    write_row(tmp_path / "sweep" / "1", 5)
    drawn = figures(asked(tmp_path / "sweep", tmp_path / "out", cache))
    assert set(drawn) == {"fig3", "fig4a", "fig4b"}
    for path in drawn.values():
        picture = cv2.imread(path)
        assert picture is not None
        assert np.std(picture) > 5
    with pytest.raises(FileExistsError, match=r"already holds fig3\.png"):
        figures(asked(tmp_path / "sweep", tmp_path / "out", cache))


def test_without_a_learnt_sigma_there_is_no_ellipse_to_draw(
    tmp_path: Path, cache: Path, caplog: pytest.LogCaptureFixture
) -> None:
    write_row(tmp_path / "sweep" / "0", 2)
    drawn = figures(asked(tmp_path / "sweep", tmp_path / "out", cache, hands=[3, 0]))
    assert set(drawn) == {"fig3"}
    assert "no σ to draw" in caplog.text


def test_what_cannot_be_drawn_is_said(tmp_path: Path, cache: Path) -> None:
    write_row(tmp_path / "sweep" / "0", 1, seed=0)
    with pytest.raises(ValueError, match=r"8 test hands, numbered from 0: no \[8\]"):
        figures(asked(tmp_path / "sweep", tmp_path / "out", cache, hands=[8]))
    write_row(tmp_path / "sweep" / "1", 2, seed=1)
    with pytest.raises(ValueError, match="they share none"):
        figures(asked(tmp_path / "sweep", tmp_path / "out", cache))
    (tmp_path / "empty").mkdir()
    with pytest.raises(ValueError, match="No finished row of Table 1"):
        figures(asked(tmp_path / "empty", tmp_path / "out", cache))
    assert not (tmp_path / "out").exists()


def test_the_command_composes_with_the_settings_of_the_report() -> None:
    with initialize_config_dir(CONF, version_base="1.3"):
        config = compose("figures", ["runs=here"], return_hydra_config=True)
    assert config.runs == "here"
    assert "prior" in config.method
    assert config.hydra.output_subdir is None
    assert config.hydra.run.dir == config.output
    assert "/figures/" in config.output
