"""Members of a sweep that fail or are killed are told with their errors, and the others go on."""

import json
import os
import signal
import threading
import time
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import yaml

from hand_recon.sweeps import member_process
from hand_recon.sweeps.launching import launch, run_by_submitit, run_locally, table
from hand_recon.sweeps.member_process import Ended, end_all, run_member, wait_for_all
from hand_recon.sweeps.places import Place
from hand_recon.tables.member_record import ERROR_FILE, State, read_member
from tests.support.member_scripts import finished_run, member, scripts

ROOT = Path(__file__).resolve().parents[2]

ENDS = """
if "fail" in words:
    Path(call["error"]).write_text("ValueError: no such thing\\n\\nTraceback ...")
    sys.exit(1)
if "crash" in words:
    print("the last words", flush=True)
    sys.exit(7)
if "kill" in words:
    os.kill(os.getpid(), 9)
(folder / "metrics.json").write_text("{}")
"""
"""Ends as its overrides say."""

LOCALLY = partial(run_locally, free=[Place((0,)), Place((0,))])


def test_failed_and_killed_members_do_not_end_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scripts(monkeypatch, ENDS)
    members = [member(tmp_path, f"{i}", word) for i, word in enumerate(("fail", "kill", "a", "b"))]
    ended = launch(members, LOCALLY)
    assert [one.state for one in ended] == ["failed", "killed", "finished", "finished"]
    assert ended[0].told == "ValueError: no such thing"
    assert ended[1].told == "ended by SIGKILL"
    assert [one.good for one in ended] == [False, False, True, True]
    assert table(ended).title == "1 failed, 1 killed, 2 finished"
    record = read_member(tmp_path / "1")
    assert record is not None
    assert (record.state, record.status, record.overrides) == (State.KILLED, -9, ("kill",))


def test_an_error_without_a_traceback_has_the_last_lines_of_the_output(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scripts(monkeypatch, ENDS)
    ended = run_member(member(tmp_path, "0", "crash"), Place())
    assert (ended.state, ended.told) == ("failed", "exit status 7")
    assert "the last words" in (tmp_path / "0" / ERROR_FILE).read_text()


def test_run_again_the_finished_are_skipped_and_the_failed_repeated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scripts(monkeypatch, ENDS)
    members = [member(tmp_path, "0", "fail"), member(tmp_path, "1", "fine")]
    launch(members, LOCALLY)
    began = (tmp_path / "1" / "member.json").stat().st_mtime_ns
    scripts(monkeypatch, "(folder / 'metrics.json').write_text('{}')")
    assert [one.state for one in launch(members, LOCALLY)] == ["finished", "skipped"]
    assert (tmp_path / "1" / "member.json").stat().st_mtime_ns == began
    assert [one.state for one in launch(members, LOCALLY)] == ["skipped", "skipped"]


def test_members_at_once_are_on_different_cores(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scripts(
        monkeypatch, "import time; time.sleep(0.1); (folder / 'c').write_text(str(call['cores']))"
    )
    free = [Place((10,)), Place((11,))]
    members = [member(tmp_path, f"{i}", "x") for i in range(2)]
    launch(members, partial(run_locally, free=free))
    assert {(tmp_path / name / "c").read_text() for name in "01"} == {"[10]", "[11]"}


def test_a_member_that_cannot_even_begin_is_a_failed_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scripts(monkeypatch, ENDS)
    (tmp_path / "0").write_text("a file in the place of its folder")
    ended = launch([member(tmp_path, "0", "a"), member(tmp_path, "1", "b")], LOCALLY)
    assert [one.state for one in ended] == ["failed", "finished"]


def test_sigterm_reaches_the_members_and_no_more_are_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(member_process, "_ending", threading.Event())
    waits = "(folder / 'begun').touch()\nimport time\ntime.sleep(60)"
    scripts(monkeypatch, waits)
    begun = tmp_path / "0" / "begun"

    def end() -> None:
        while not begun.exists():
            time.sleep(0.01)
        os.kill(os.getpid(), signal.SIGTERM)

    ender = threading.Thread(target=end)
    ender.start()
    members = [member(tmp_path, "0", "x"), member(tmp_path, "1", "x")]
    with pytest.raises(SystemExit) as stopped:
        run_locally(members, [Place()])
    ender.join()
    assert stopped.value.code == 143
    first, second = (read_member(tmp_path / name) for name in "01")
    assert first is not None
    assert second is not None
    assert (first.state, first.status) == (State.KILLED, -signal.SIGTERM)
    assert second.state == State.KILLED
    assert not (tmp_path / "1" / "begun").exists()


# submitit's debugging executor leaves its logs open.
@pytest.mark.filterwarnings("ignore::ResourceWarning")
@pytest.mark.filterwarnings("ignore:Exception ignored in:pytest.PytestUnraisableExceptionWarning")
def test_jobs_of_submitit_end_as_processes_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("submitit")
    scripts(monkeypatch, ENDS)
    # Without processes of its own, in which the scripts would not be known.
    by_jobs = partial(
        run_by_submitit, cluster="debug", folder=str(tmp_path / "jobs"), parameters={}
    )
    members = [member(tmp_path, "0", "fail"), member(tmp_path, "1", "fine")]
    assert [one.state for one in launch(members, by_jobs)] == ["failed", "finished"]


def test_a_job_that_is_to_end_ends_its_member_and_is_submitted_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    submitit = pytest.importorskip("submitit")
    from hand_recon.sweeps.job import MemberJob

    monkeypatch.setattr(member_process, "_ending", threading.Event())
    one = member(tmp_path, "0", "x")
    again = MemberJob(one).checkpoint()
    assert isinstance(again, submitit.helpers.DelayedSubmission)
    assert member_process.is_ending()
    finished_run(one.folder)
    (one.folder / "member.json").write_text(
        json.dumps({"state": "finished", "overrides": [], "settings": one.settings})
    )
    assert MemberJob(one)() == Ended("0", "finished", one.folder)


def test_end_all_without_members_is_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(member_process, "_ending", threading.Event())
    end_all()
    assert member_process.is_ending()


def test_a_handler_can_wait_for_members_that_others_wait_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As submitit's handler does, while the interrupted code waits for the same process."""
    monkeypatch.setattr(member_process, "_ending", threading.Event())
    scripts(monkeypatch, "(folder / 'begun').touch()\nimport time\ntime.sleep(60)")
    begun = tmp_path / "0" / "begun"
    waited: list[bool] = []

    def handle(number: int, frame: object) -> None:
        waited.append(wait_for_all(0.1))
        end_all()
        waited.append(wait_for_all(30))

    def send() -> None:
        while not begun.exists():
            time.sleep(0.01)
        os.kill(os.getpid(), signal.SIGUSR2)

    before = signal.signal(signal.SIGUSR2, handle)
    sender = threading.Thread(target=send)
    sender.start()
    ended = run_member(member(tmp_path, "0", "x"), Place())
    sender.join()
    signal.signal(signal.SIGUSR2, before)
    assert waited == [False, True]
    assert (ended.state, ended.told) == ("killed", "ended by SIGTERM")


def test_the_settings_for_slurm_are_submitits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    submitit = pytest.importorskip("submitit")
    text = (ROOT / "conf/hydra/launcher/slurm.yaml").read_text(encoding="utf-8")
    settings = {k: v for k, v in yaml.safe_load(text).items() if v is not None and k[0] != "_"}
    settings |= {"name": "train"}
    del settings["cluster"], settings["submitit_folder"]
    begun: list[Any] = []

    def stop(executor: object) -> None:
        begun.append(executor)
        raise InterruptedError

    # As on a machine that has srun; no job is submitted.
    monkeypatch.setattr(submitit.SlurmExecutor, "affinity", classmethod(lambda _: 2))
    monkeypatch.setattr(submitit.AutoExecutor, "batch", stop)
    with pytest.raises(InterruptedError):
        run_by_submitit([], "slurm", str(tmp_path), settings)
    assert begun[0]._executor.max_num_timeout == settings["slurm_max_num_timeout"]
    assert begun[0]._executor.parameters["time"] == settings["timeout_min"]
