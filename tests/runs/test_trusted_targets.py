"""Targets that a configuration may call, and checkpoints, whose configuration is not trusted."""

import re
from pathlib import Path

import pytest
import torch
from omegaconf import OmegaConf

from hand_recon.command_line.configuration_files import CONF
from hand_recon.runs.checkpoints import CONFIG_KEY, read_checkpoint
from hand_recon.runs.configuration import TRUSTED, instantiate, refuse_untrusted
from tests.support.configurations import composed


@pytest.mark.parametrize(
    "config",
    [
        {"outer": [{"_target_": "os.system", "command": "true"}]},
        {"_target_": "torch.utils.collect_env.run", "command": "true"},
        {"part": "${elsewhere}", "elsewhere": {"_target_": "os.system", "command": "true"}},
    ],
)
def test_a_checkpoint_may_not_call_what_is_not_trusted(
    config: dict[str, object], monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ValueError, match=r"x.ckpt asks to call .* not among the targets"):
        refuse_untrusted(OmegaConf.create(config), "x.ckpt")
    trusted = "os.system,torch.utils.collect_env.run"
    monkeypatch.setenv("HAND_RECON_TRUSTED", trusted)
    refuse_untrusted(OmegaConf.create(config), "x.ckpt")


@pytest.mark.parametrize(("version", "told"), [(None, "0.1"), ("0.7.1", "0.7.1")])
def test_a_checkpoint_of_another_version_says_which(version: str | None, told: str) -> None:
    config = OmegaConf.create({"model": {"_target_": "hand_recon.reconstructor.Reconstructor"}})
    with pytest.raises(ValueError, match=rf"does not have: it was written by hand_recon {told}\."):
        refuse_untrusted(config, "x.ckpt", version)


def test_what_a_user_composes_may_call_anything_that_hydra_allows() -> None:
    """Lightning's own callbacks and those of other packages."""
    config = composed(
        "+callbacks.stopping._target_=lightning.pytorch.callbacks.EarlyStopping",
        "+callbacks.stopping.monitor=val/loss",
        "+callbacks.mine._target_=collections.OrderedDict",
    )
    assert instantiate(config.callbacks.stopping).monitor == "val/loss"
    assert instantiate(config.callbacks.mine) == {}


def test_every_target_of_the_configuration_may_be_called() -> None:
    # Those of Hydra itself, such as launchers, are in no checkpoint.
    files = (path for path in Path(CONF).rglob("*.yaml") if "hydra" not in path.parts)
    texts = [path.read_text() for path in files]
    named = {target for text in texts for target in re.findall(r"_target_: (\S+)", text)}
    assert named <= TRUSTED
    assert "hand_recon.regressor.error_feedback.Regressor" in named


def test_a_checkpoint_of_something_else_is_refused(tmp_path: Path) -> None:
    torch.save({"state_dict": {}}, tmp_path / "other.ckpt")
    with pytest.raises(ValueError, match="no configuration of hand_recon"):
        read_checkpoint(tmp_path / "other.ckpt")


def test_a_missing_checkpoint_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"best\.ckpt"):
        read_checkpoint(tmp_path)


def test_a_checkpoint_gives_its_configuration_back(tmp_path: Path) -> None:
    torch.save({"state_dict": {}, CONFIG_KEY: {"seed": 7}}, tmp_path / "a.ckpt")
    assert read_checkpoint(tmp_path / "a.ckpt")[1].seed == 7
