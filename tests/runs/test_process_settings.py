"""Numbers of processes, and settings that cannot work together."""

from typing import Any

import pytest
import torch
from omegaconf import DictConfig, OmegaConf

from hand_recon.command_line.launched import ALONE, Place
from hand_recon.runs.process_settings import check_together, expected_processes
from hand_recon.runs.trainer_arguments import Together, trainer_arguments


def trainer(**settings: Any) -> DictConfig:  # noqa: ANN401
    return OmegaConf.create({"accelerator": "cpu", "devices": 1, "num_nodes": 1} | settings)


def with_gpus(monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: count > 0)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: count)


@pytest.mark.parametrize(
    ("settings", "count"),
    [
        ({}, 1),
        ({"devices": 3}, 3),
        ({"devices": "3"}, 3),
        ({"devices": 2, "num_nodes": 4}, 8),
        ({"devices": [0, 2, 3]}, 3),
        ({"devices": "0,2"}, 2),
        ({"devices": "auto"}, 1),
        ({"devices": "auto", "accelerator": "gpu"}, 4),
        ({"devices": -1, "accelerator": "auto"}, 4),
    ],
)
def test_there_is_a_process_for_each_device(
    settings: dict[str, Any], count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    with_gpus(monkeypatch, 4)
    assert expected_processes(trainer(**settings)) == count


@pytest.mark.parametrize(
    ("settings", "launched", "message"),
    [
        ({"devices": 0}, ALONE, r"trainer\.devices=0; expected 1 or more, a list .* -1 for all"),
        ({"devices": -2}, ALONE, r"trainer\.devices=-2; expected 1 or more"),
        ({"devices": "-2"}, ALONE, r"trainer\.devices=-2; expected 1 or more"),
        ({"devices": []}, ALONE, r"trainer\.devices=\[\]; expected 1 or more"),
        ({"devices": "two"}, ALONE, r"trainer\.devices=two; expected 1 or more"),
        ({"num_nodes": 0}, ALONE, r"trainer\.num_nodes=0; expected 1 or more\. Give"),
        ({"devices": 2}, Place(0, 0, 4, 4, "torchrun"), r"torchrun started 4 .* are 2\. Give"),
        ({}, Place(0, 0, 4, 4, "srun"), "srun started 4 processes.*without srun"),
        ({"devices": 2, "num_nodes": 2}, ALONE, "started there by torchrun or srun"),
        (
            {"strategy": "fsdp"},
            ALONE,
            "trainer.strategy=fsdp is not supported; expected one of auto",
        ),
        ({"devices": 2, "strategy": "ddp_spawn"}, ALONE, "ddp_spawn is not supported"),
        ({"devices": 2, "sync_batchnorm": True}, ALONE, "sync_batchnorm=true needs GPUs"),
        ({"devices": 2, "accelerator": "mps"}, ALONE, "accelerator=mps has one device"),
        ({"devices": 2, "accelerator": "gpu"}, ALONE, "more GPUs than the 1 of this machine"),
    ],
)
def test_settings_that_cannot_work_are_refused_with_a_remedy(
    settings: dict[str, Any], launched: Place, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with_gpus(monkeypatch, 1)
    with pytest.raises(ValueError, match=message):
        check_together(trainer(**settings), launched)


@pytest.mark.parametrize(
    ("settings", "launched"),
    [
        ({}, ALONE),
        ({"devices": -1}, ALONE),
        ({"strategy": "ddp"}, ALONE),
        ({"sync_batchnorm": True}, ALONE),
        ({"devices": 2}, ALONE),
        ({"devices": 2, "num_nodes": 2}, Place(3, 1, 4, 2, "torchrun")),
        ({"devices": 2, "accelerator": "gpu", "sync_batchnorm": True}, ALONE),
    ],
)
def test_other_settings_are_accepted(
    settings: dict[str, Any], launched: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    with_gpus(monkeypatch, 2)
    check_together(trainer(**settings), launched)


def test_one_process_has_no_strategy_and_several_have_gradients_averaged() -> None:
    assert trainer_arguments(trainer(strategy="ddp"), ALONE)["strategy"] == "auto"
    place = Place(5, 1, 8, 4, "srun")
    arguments = trainer_arguments(trainer(strategy="auto", devices=4, num_nodes=2), place)
    assert arguments["strategy"] == "ddp"
    (environment,) = arguments["plugins"]
    assert isinstance(environment, Together)
    ranks = environment.global_rank(), environment.local_rank(), environment.node_rank()
    assert ranks == (5, 1, 1)
    assert environment.world_size() == 8
