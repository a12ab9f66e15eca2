"""Full disks, lacking memory and Ctrl-C end a command with a message; what was finished is kept."""

import errno
import re
import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NoReturn

import pytest
import torch
from omegaconf import OmegaConf

from hand_recon.command_line import hydra_verb
from hand_recon.command_line.run_folder import OVERRIDE, RunFolder
from hand_recon.command_line.user_errors import USER_ERRORS, reason_of, report_of_thread
from hand_recon.data.whole_files import replaced_when_whole
from hand_recon.fitting.hands_file import entries_so_far, hand_entries
from hand_recon.fitting.hands_list import writing_entries
from hand_recon.fitting.records_of_fits import to_records
from hand_recon.hand.model import HandModel
from hand_recon.runs import training_run
from hand_recon.runs.checkpoint_writer import write_checkpoint
from tests.support.configurations import composed
from tests.support.fitted_hands import fitted


def full(*words: object, **more: object) -> NoReturn:
    raise OSError(errno.ENOSPC, "No space left on device", "results/hands.json")


def _write_and_fill(write: Callable[[Any], object], content: object) -> NoReturn:
    """Write something, after which the disk is full."""
    write(content)
    full()


def test_a_full_disk_is_told_with_the_file_and_what_to_do() -> None:
    with pytest.raises(USER_ERRORS) as raised:
        full()
    assert reason_of(raised.value) == (
        "results/hands.json: The disk is full. What was finished until then is kept. Free some space, or "
        "name a folder on another disk."
    )


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (OSError(errno.EROFS, "Read-only", "a"), r"^a: The disk can only be read\. What was finished"),
        (PermissionError(errno.EACCES, "denied", "b"), r"^b: That is not permitted\..* Check the perm"),
        (MemoryError("9 GB"), r"not enough memory \(9 GB\)\. What was finished until then is kept"),
        (FileNotFoundError("No file at x."), r"^No file at x\.$"),
    ],
)  # fmt: skip
def test_errors_of_the_machine_say_what_to_do(error: Exception, said: str) -> None:
    assert isinstance(error, USER_ERRORS)
    assert re.search(said, reason_of(error))


def test_hands_that_were_written_before_the_disk_was_full_are_read_again(
    hand: HandModel, tmp_path: Path
) -> None:
    entries = list(hand_entries(to_records(fitted(hand))))
    with (
        pytest.raises(OSError, match="No space"),
        writing_entries(tmp_path / "hands.json") as write,
    ):
        _write_and_fill(write, entries[:2])
    assert not (tmp_path / "hands.json").exists()
    assert [one["name"] for one in entries_so_far(tmp_path / "hands.json")] == [
        one["name"] for one in entries[:2]
    ]


def test_an_earlier_file_stays_whole_when_the_disk_is_full(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    last = tmp_path / "last.ckpt"
    write_checkpoint({"step": torch.tensor(3)}, last)
    monkeypatch.setattr("torch.save", full)
    with pytest.raises(OSError, match="No space"):
        write_checkpoint({"step": torch.tensor(4)}, last)
    assert int(torch.load(last, weights_only=True)["step"]) == 3
    (tmp_path / "a.json").write_text("old")
    with pytest.raises(OSError, match="No space"), replaced_when_whole(tmp_path / "a.json") as part:
        _write_and_fill(part.write_text, "ne")
    assert (tmp_path / "a.json").read_text() == "old"


def test_ctrl_c_ends_a_command_with_130_and_says_what_is_kept(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(**words: object) -> Any:  # noqa: ANN401
        def run(task: object) -> object:
            def end() -> NoReturn:
                raise KeyboardInterrupt

            return end

        return run

    monkeypatch.setattr("hydra.main", interrupted)
    with pytest.raises(SystemExit) as ended:
        hydra_verb.run_overrides("fit", "fit", [])
    assert ended.value.code == 130
    assert "Interrupted. What was finished until then is kept." in capsys.readouterr().err


@pytest.mark.parametrize(("was_interrupted", "code", "kind"), [
    (True, 1, KeyboardInterrupt), (True, 143, SystemExit), (False, 1, SystemExit),
])  # fmt: skip
def test_ctrl_c_in_a_training_is_ctrl_c_and_not_lightnings_status(
    monkeypatch: pytest.MonkeyPatch, was_interrupted: bool, code: int, kind: type[BaseException]
) -> None:
    def fit(*words: object, **more: object) -> NoReturn:
        raise SystemExit(code)

    monkeypatch.setattr(training_run, "from_first", lambda place, take_over: None)
    trainer = SimpleNamespace(fit=fit, interrupted=was_interrupted)
    unwrapped: Any = getattr(training_run._fit, "__wrapped__", training_run._fit)
    with pytest.raises(kind):
        unwrapped(trainer, None, None, SimpleNamespace(), SimpleNamespace())


def test_a_thread_that_a_full_disk_ends_gives_a_message_and_no_traceback(
    capsys: pytest.CaptureFixture[str],
) -> None:
    error = OSError(errno.ENOSPC, "No space left on device")
    report_of_thread(threading.ExceptHookArgs((OSError, error, None, None)))
    assert capsys.readouterr().err.startswith("error: The disk is full.")
    report_of_thread(threading.ExceptHookArgs((KeyError, KeyError("x"), None, None)))
    assert "KeyError" in capsys.readouterr().err


def test_a_run_folder_that_cannot_be_made_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    config = OmegaConf.create({"hydra": {"run": {"dir": str(tmp_path / "file" / "run")}}})
    with pytest.raises(SystemExit) as ended:
        RunFolder().on_run_start(config)
    assert ended.value.code == 1
    assert str(tmp_path / "file" / "run") in capsys.readouterr().err


def test_a_run_of_a_sweep_may_have_its_folder_checked_twice() -> None:
    config = composed(OVERRIDE, OVERRIDE, name="train")
    assert config.hydra.callbacks.run_folder["_target_"].endswith("RunFolder")
