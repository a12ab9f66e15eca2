"""A run is repeated with its own settings, and its losses are compared with those it had."""

import csv
import json
import shutil
from pathlib import Path

import pytest
import yaml
from omegaconf import DictConfig

from hand_recon.runs import repeating as repeating_module
from hand_recon.runs.provenance.record import read_provenance
from hand_recon.runs.recorded_training import train_recorded
from hand_recon.runs.repeating import Repeat, compare, settings_to_repeat
from tests.support.configurations import settings
from tests.support.killed_training import LIFTER
from tests.support.small_runs import LIGHTNING_WARNINGS

pytestmark = LIGHTNING_WARNINGS

SHORT = (*LIFTER, "trainer.max_epochs=1", "trainer.check_val_every_n_epoch=1", "seed=3")


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(scope="module")
def run(cache: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("earlier") / "run"
    train_recorded(settings(cache, folder, *SHORT))
    return folder


def repeating(cache: Path, folder: Path, run: Path, *overrides: str) -> DictConfig:
    """Configuration of a command with `from_run`, whose other settings are the defaults."""
    return settings(cache, folder, f"from_run={run}", *overrides)


def test_a_run_has_its_provenance(run: Path) -> None:
    found = read_provenance(run)
    assert found is not None
    assert found.keys() == {"code", "data", "hardware", "used"}
    assert found["hardware"]["threads"] == 1
    assert found["used"]["wall_seconds"] > 0
    # Rendered hands come from the seed and the code.
    assert found["data"] == {}


def test_a_repeated_run_is_the_same_bit_for_bit_also_from_memory(
    run: Path, cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(repeating_module, "_given", lambda: {"from_run", "data.keep"})
    # The checkout may be changed by others while the tests run.
    config = repeating(cache, tmp_path / "again", run, "allow_differences=true", "data.keep=memory")
    metrics = train_recorded(config)
    assert metrics["test"] == json.loads((run / "metrics.json").read_text())["test"]
    told = json.loads((tmp_path / "again" / "repeat.json").read_text())
    assert told["same"]
    assert told["of"] == str(run)
    # Five steps of losses, a validation, the learning rates, and the test scores.
    assert told["values"] > 50
    assert (tmp_path / "again" / "checkpoints" / "best.ckpt").is_file()
    assert "keep: memory" in (tmp_path / "again" / "config.yaml").read_text()


def test_the_settings_are_the_runs_own_with_other_folders(
    run: Path, cache: Path, tmp_path: Path
) -> None:
    config = repeating(cache, tmp_path / "new", run, "allow_differences=true")
    repeated = settings_to_repeat(config).config
    assert repeated.seed == 3
    assert repeated.trainer.max_epochs == 1
    assert repeated.model.width == 32
    assert repeated.paths.run == str(tmp_path / "new")
    assert repeated.callbacks.checkpoint.dirpath == str(tmp_path / "new" / "checkpoints")
    assert str(run) not in str(repeated)


def test_other_losses_are_an_error_that_says_from_which_step(run: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    shutil.copytree(run, other)
    log = other / "csv" / "metrics.csv"
    with log.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    row = next(row for row in rows if row["train/loss"])
    row["train/loss"] = repr(float(row["train/loss"]) + 0.5)
    with log.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    repeat = Repeat(DictConfig({"paths": {"run": str(other)}}), run, [], [])
    with pytest.raises(
        ValueError, match=rf"Not the same: from step {row['step']} on, where train/loss was"
    ):
        compare(repeat)
    assert not json.loads((other / "repeat.json").read_text())["same"]


def test_other_code_is_refused_and_listed_unless_that_is_allowed(
    run: Path, cache: Path, tmp_path: Path
) -> None:
    changed = tmp_path / "changed"
    shutil.copytree(run, changed)
    file = changed / "provenance.json"
    content = json.loads(file.read_text())
    content["code"]["packages"]["torch"] = "1.0"
    content["hardware"]["processor"] = "an abacus"
    file.write_text(json.dumps(content))
    with pytest.raises(ValueError, match=r"cannot be repeated exactly: .*torch was 1\.0, is"):
        settings_to_repeat(repeating(cache, tmp_path / "new", changed))
    allowed = repeating(cache, tmp_path / "new", changed, "allow_differences=true")
    repeat = settings_to_repeat(allowed)
    assert any("torch was 1.0" in told for told in repeat.counting)
    assert any("an abacus" in told for told in repeat.others)


def test_a_run_whose_settings_call_something_else_is_refused(
    run: Path, cache: Path, tmp_path: Path
) -> None:
    evil = tmp_path / "evil"
    shutil.copytree(run, evil)
    file = evil / "config.yaml"
    content = yaml.safe_load(file.read_text())
    content["callbacks"]["evil"] = {"_target_": "os.system", "command": "true"}
    file.write_text(yaml.safe_dump(content))
    with pytest.raises(ValueError, match=r"asks to call 'os\.system'"):
        settings_to_repeat(repeating(cache, tmp_path / "new", evil))
    content["callbacks"]["evil"] = "${oc.env:HOME}"
    file.write_text(yaml.safe_dump(content))
    with pytest.raises(ValueError, match="no resolved configuration of a training"):
        settings_to_repeat(repeating(cache, tmp_path / "new", evil))


def test_without_provenance_and_without_a_run_it_says_so(
    run: Path, cache: Path, tmp_path: Path
) -> None:
    old = tmp_path / "old"
    shutil.copytree(run, old)
    (old / "provenance.json").unlink()
    with pytest.raises(ValueError, match=r"has no provenance\.json"):
        settings_to_repeat(repeating(cache, tmp_path / "new", old))
    with pytest.raises(FileNotFoundError, match=r"No run at .*nowhere: it has no config\.yaml"):
        settings_to_repeat(repeating(cache, tmp_path / "new", tmp_path / "nowhere"))
