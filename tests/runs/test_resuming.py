"""Damaged checkpoints, the newest unfinished run, rows of metrics, and batches that are no numbers."""

import os
import pickle
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import lightning
import pytest
import torch
from lightning.pytorch.loggers import CSVLogger
from omegaconf import DictConfig, OmegaConf

from hand_recon.hand.model import HandModel
from hand_recon.runs.checkpoint_writer import WholeCheckpoints, damage, write_checkpoint
from hand_recon.runs.configuration import plain
from hand_recon.runs.last_checkpoint import LastCheckpoint
from hand_recon.runs.offending_batch import save_batch
from hand_recon.runs.resuming import Earlier, adopt, earlier_run, last_whole, repeat_metrics
from hand_recon.runs.unfinished import finish, mark_unfinished
from hand_recon.runs.unfinished_runs import newest_unfinished, training_settings
from hand_recon.training.non_finite import LossGuard, NonFiniteLossError
from tests.support.configurations import settings
from tests.support.views import known_hands, views

STATE: dict[str, Any] = {
    "state_dict": {"weight": torch.arange(4000.0)},
    "optimizer_states": [{"step": 3}],
    "callbacks": {},
}


def checkpoints(run: Path) -> Path:
    return run / "checkpoints"


def test_the_checkpoint_before_the_last_is_kept_and_the_best_has_weights_alone(
    tmp_path: Path,
) -> None:
    writer = WholeCheckpoints()
    for step in (1, 2, 3):
        writer.save_checkpoint(STATE | {"global_step": step}, tmp_path / "last.ckpt")
    writer.save_checkpoint(STATE | {"global_step": 3}, str(tmp_path / "best.ckpt"))
    files = {path.name: torch.load(path, weights_only=True) for path in tmp_path.iterdir()}
    assert {name: content["global_step"] for name, content in files.items()} == {
        "last.ckpt": 3, "before_last.ckpt": 2, "best.ckpt": 3,
    }  # fmt: skip
    assert files["best.ckpt"].keys() == {"state_dict", "global_step"}


def test_a_checkpoint_that_cannot_be_written_leaves_the_last_one(tmp_path: Path) -> None:
    write_checkpoint(STATE, tmp_path / "last.ckpt")
    # Python 3.14 raises the second.
    with pytest.raises((AttributeError, pickle.PicklingError)):
        write_checkpoint({"function": lambda: None}, tmp_path / "last.ckpt")
    assert damage(tmp_path / "last.ckpt") is None
    assert not (tmp_path / "before_last.ckpt").exists()


def test_one_wrong_byte_in_a_weight_is_found(tmp_path: Path) -> None:
    file = tmp_path / "last.ckpt"
    write_checkpoint(STATE, file)
    content = bytearray(file.read_bytes())
    at = content.find(torch.arange(2000.0, 2010.0).numpy().tobytes())
    assert at > 0
    content[at] ^= 1
    file.write_bytes(content)
    assert "checksum of" in (damage(file) or "")
    # torch itself reads it without a word.
    assert torch.load(file, weights_only=True)["state_dict"]["weight"][2000] != 2000


@pytest.mark.parametrize("kept", [0, 100, -1])
def test_the_checkpoint_before_takes_the_place_of_a_cut_one(
    tmp_path: Path, kept: int, caplog: pytest.LogCaptureFixture
) -> None:
    last = checkpoints(tmp_path) / "last.ckpt"
    for _ in range(2):
        write_checkpoint(STATE, last)
    last.write_bytes(last.read_bytes()[:kept])
    with caplog.at_level("WARNING"):
        assert last_whole(tmp_path) == last_whole(last) == last.with_name("before_last.ckpt")
    assert f"{last} is damaged" in caplog.text
    assert "the one before, before_last.ckpt, is used" in caplog.text
    last.with_name("before_last.ckpt").write_bytes(b"x")
    with pytest.raises(ValueError, match=r"damaged, and there is no other.*Continue from an older"):
        last_whole(tmp_path)


def test_a_kill_between_two_renamings_leaves_the_checkpoint_before(tmp_path: Path) -> None:
    write_checkpoint(STATE, checkpoints(tmp_path) / "last.ckpt")
    os.replace(checkpoints(tmp_path) / "last.ckpt", checkpoints(tmp_path) / "before_last.ckpt")
    assert last_whole(tmp_path).name == "before_last.ckpt"


def config(output: Path, *overrides: str) -> DictConfig:
    made = settings(output / "cache", output / "train" / "new", "recipe=lifter", *overrides)
    made.paths.output = str(output)
    return made


def run(output: Path, name: str, *overrides: str, step: int = 5) -> Path:
    """An unfinished run's folder with a checkpoint of a step."""
    folder = output / "train" / name
    folder.mkdir(parents=True)
    made = config(output, *overrides)
    mark_unfinished(folder, {"training": training_settings(made)})
    content = STATE | {"global_step": step, "hand_recon_config": plain(made)}
    write_checkpoint(content, checkpoints(folder) / "last.ckpt")
    os.utime(checkpoints(folder) / "last.ckpt", (step, step))
    return folder


def test_auto_takes_the_newest_unfinished_run_of_the_same_settings(tmp_path: Path) -> None:
    assert newest_unfinished(config(tmp_path)) is None
    run(tmp_path, "older", step=4)
    # One of an earlier version, which did not have the last setting.
    others = ("threads=1", "checkpoint.every_n_steps=7", "data.keep=memory")
    wanted = run(tmp_path, "wanted", *others, "~prior.non_penetration.sizes", step=6)
    run(tmp_path, "of_other_seed", "seed=1", step=9)
    run(tmp_path, "longer", "trainer.max_epochs=30", step=9)
    finish(run(tmp_path, "finished", step=9))
    no_checkpoint = run(tmp_path, "just_begun", step=9)
    (checkpoints(no_checkpoint) / "last.ckpt").unlink()
    (run(tmp_path, "damaged", step=9) / "unfinished.json").write_text("[1]")
    now = config(tmp_path, "resume=auto")
    earlier = earlier_run(now)
    assert now.resume == str(wanted)
    assert earlier is not None
    assert earlier.file == checkpoints(wanted) / "last.ckpt"


def test_other_settings_are_refused_by_name_with_those_that_a_run_lacks(tmp_path: Path) -> None:
    folder = run(tmp_path, "one", "~prior.non_penetration.weight", "trainer.precision=bf16-mixed")
    with pytest.raises(ValueError, match="was trained with other settings") as refused:
        earlier_run(config(tmp_path, f"resume={folder}", "trainer.precision=32-true"))
    said = str(refused.value)
    assert "trainer.precision was bf16-mixed, is 32-true" in said
    assert re.search(
        r"prior\.non_penetration\.weight was absent, is [\d.]+ \(~prior\.non_pen", said
    )
    same = ("~prior.non_penetration.weight", "trainer.precision=bf16-mixed")
    assert earlier_run(config(tmp_path, f"resume={folder}", *same)) is not None


def test_weights_alone_cannot_be_continued(tmp_path: Path) -> None:
    folder = run(tmp_path, "one")
    last = checkpoints(folder) / "last.ckpt"
    content = torch.load(last, weights_only=True)
    WholeCheckpoints().save_checkpoint(content, last.with_name("best.ckpt"))
    with pytest.raises(ValueError, match=r"weights alone.*Continue from last\.ckpt beside it"):
        earlier_run(config(tmp_path, f"resume={last.with_name('best.ckpt')}"))


def test_a_continued_run_has_the_checkpoints_and_the_best_score_from_the_start(
    tmp_path: Path,
) -> None:
    folder, new = run(tmp_path, "one"), tmp_path / "train" / "new"
    last = checkpoints(folder) / "last.ckpt"
    score = torch.tensor(2.5)
    state = {"best_model_score": score, "best_model_path": "gone/best.ckpt", "monitor": "x"}
    content = STATE | {"callbacks": {"ModelCheckpoint{}": state, "Other": {"kept": 1}}}
    write_checkpoint(STATE, last.with_name("best.ckpt"))
    adopted = torch.load(adopt(Earlier(last, content), new), weights_only=True)
    best = checkpoints(new).resolve() / "best.ckpt"
    assert best.is_file()
    moved = adopted["callbacks"]["ModelCheckpoint{}"]
    assert moved["best_k_models"] == {str(best): score}
    assert moved["best_model_path"] == moved["kth_best_model_path"] == str(best)
    assert moved["monitor"] == "x"
    assert adopted["callbacks"]["Other"] == {"kept": 1}
    assert not (folder / "unfinished.json").exists()
    # A damaged best checkpoint is not taken over, nor is its score.
    last.with_name("best.ckpt").write_bytes(b"PK")
    adopted = torch.load(adopt(Earlier(last, content), tmp_path / "third"), weights_only=True)
    assert adopted["callbacks"].keys() == {"Other"}


def test_rows_of_the_earlier_run_are_logged_again_as_they_were(tmp_path: Path) -> None:
    text = "a,epoch,step\r\n1e-05,,0\r\n0.30000000000000004,0,4\r\n-2,1,9\r\n"
    one = CSVLogger(tmp_path, name=None, version="csv")
    repeat_metrics(Earlier(tmp_path / "last.ckpt", {"hand_recon_metrics": text}), [one])
    one.save()
    assert (tmp_path / "csv" / "metrics.csv").read_bytes().decode() == text


def test_a_batch_that_is_no_number_is_saved(tmp_path: Path, hand: HandModel) -> None:
    hands = views(hand, known_hands(hand, 2))
    hands = replace(hands, landmarks_2d=hands.landmarks_2d.clone())
    hands.landmarks_2d[0, 3] = torch.inf
    with pytest.raises(NonFiniteLossError, match="not finite at step 7") as refused:
        LossGuard().watch({"loss": torch.tensor(torch.nan)}, hands, 7)
    saved = torch.load(save_batch(refused.value, tmp_path), weights_only=True)
    assert saved["step"] == 7
    assert torch.equal(saved["landmarks_2d"].nan_to_num(), hands.landmarks_2d.nan_to_num())
    assert saved["source"] == hands.source


@pytest.mark.parametrize("interval", [{"every_n_steps": 0}, {"every_minutes": -1.0}])
def test_intervals_are_positive(tmp_path: Path, interval: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="must be positive, or null"):
        LastCheckpoint(tmp_path, **interval)


def test_weights_that_are_no_numbers_do_not_replace_the_last_good_checkpoint(
    tmp_path: Path,
) -> None:
    saver = LastCheckpoint(tmp_path, every_n_steps=1)
    module = lightning.LightningModule()
    module.weight = torch.nn.Parameter(torch.tensor([1.0, torch.nan]))
    saver._save(lightning.Trainer(logger=False, enable_checkpointing=False), module)
    assert not list(tmp_path.iterdir())


def test_the_settings_of_a_training_leave_out_folders_and_intervals(tmp_path: Path) -> None:
    one = training_settings(config(tmp_path, "checkpoint.every_minutes=3", "workers=2"))
    assert one == training_settings(config(tmp_path / "elsewhere"))
    assert "max_epochs" in one["trainer"]
    assert OmegaConf.create(one).seed == 0
