"""Processes whose threads wait in one way or the other, and the end of those that were started."""

import subprocess

import pytest

from hand_recon.speed import threads
from hand_recon.speed.threads import busy_core, worker


def test_a_worker_runs_once_for_each_call(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        threads, "WORKER",
        "import os, sys\nprint('ready', flush=True)\n"
        "passive = os.environ.get('OMP_WAIT_POLICY') == 'PASSIVE'\n"
        "for line in sys.stdin: print('done' if passive else 'no', flush=True)",
    )  # fmt: skip
    with worker(1, 1, "PASSIVE") as run_once:
        run_once()
        run_once()
    with worker(1, 1, None) as run_once, pytest.raises(RuntimeError, match="answered 'no'"):
        run_once()


def test_a_worker_that_ends_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "WORKER", "print('ready', flush=True)")
    with worker(1, 1, "PASSIVE") as run_once, pytest.raises((RuntimeError, BrokenPipeError)):
        run_once()


def test_the_busy_process_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    begun: list[subprocess.Popen[bytes]] = []
    original = subprocess.Popen

    def remember(*words: object, **options: object) -> "subprocess.Popen[bytes]":
        begun.append(original(*words, **options))  # type: ignore[call-overload]
        return begun[-1]

    monkeypatch.setattr(subprocess, "Popen", remember)
    with busy_core():
        assert begun[0].poll() is None
    assert begun[0].poll() is not None
