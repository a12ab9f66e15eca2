"""Runs a search: asks Optuna for settings, trains with them in a process, tells Optuna the score."""

import json
import logging
import math
import queue
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from hand_recon.command_line.processor import core_numbers
from hand_recon.command_line.words import quoted
from hand_recon.runs.configuration import check_extra, plain
from hand_recon.runs.unfinished import lock
from hand_recon.sweeps.attempts import Member, finished_attempt
from hand_recon.sweeps.launching import ended_by_sigterm
from hand_recon.sweeps.member_process import Ended, end_all, is_ending, run_member
from hand_recon.sweeps.places import Place, places, visible_gpus
from hand_recon.sweeps.search.outcome import Outcome, write_outcome
from hand_recon.sweeps.search.space import distributions, overrides
from hand_recon.sweeps.search.study import (
    ERROR,
    PRUNED,
    Searched,
    built,
    check_optuna,
    claim,
    open_study,
    states,
    trial_of,
)
from hand_recon.tables.member_record import State
from hand_recon.tables.runs import METRICS_FILE

logger = logging.getLogger(__name__)

OWN: tuple[str, ...] = ("search.", "search=", "folder=", "hydra.")
"""Beginnings of overrides that are the search's, not the trials'."""


def search(config: DictConfig) -> dict[str, Any]:
    """Search until there are enough trials, then write and print the table.

    Args:
        config: `conf/search.yaml`, composed.

    Returns:
        The best trial's number, value and overrides, and the number of trials in each state.

    Raises:
        ValueError: The objective or the space is not usable, or no trial has ended well.
    """
    check_optuna()
    check_extra("tensorboard", "matplotlib", "jinja2", "joblib")
    chosen = plain(config.search)
    given = HydraConfig.get().overrides.task if HydraConfig.initialized() else []
    searched = Searched(
        space=chosen["space"], objective=chosen["objective"], direction=chosen["direction"],
        seed=config.seed, sampler=chosen["sampler"], pruner=chosen["pruner"],
        overrides=tuple(word for word in given if not word.lstrip("+").startswith(OWN)),
    )  # fmt: skip
    distributions(searched.space)
    folder = Path(config.folder).expanduser().absolute()
    claim(folder, searched)
    lock(folder)
    session = Session(folder, searched, int(chosen["trials"]))
    free = places(chosen["n_jobs"], core_numbers(), visible_gpus())
    with ended_by_sigterm():
        session.run(free)
    return write_outcome(Outcome(folder, searched, states(session.study)))


class Session:
    """A search as far as this process goes on with it.

    Args:
        folder: Of the search.
        searched: Its settings.
        trials: Trials in all.
    """

    def __init__(self, folder: Path, searched: Searched, trials: int) -> None:
        self.folder, self.searched, self.trials = folder, searched, trials
        self.study = open_study(folder)
        self.lock = threading.Lock()
        self.interrupted = [one.number for one in states(self.study) if one.state.name == "RUNNING"]

    def run(self, free: list[Place]) -> None:
        """Run trials at all places at once until there are enough.

        The first error beside those of trials, such as of a full disk, ends the search: trials that are
        running have a signal to save, and the error is raised after their ends. So does Ctrl-C.
        """
        errors: list[Exception] = []
        waiting: queue.SimpleQueue[Place] = queue.SimpleQueue()
        for place in free:
            waiting.put(place)

        def work() -> None:
            place = waiting.get()
            try:
                for number in self._numbers():
                    self._trial(number, place)
            except Exception as error:  # noqa: BLE001  # raised below
                errors.append(error)
                end_all()

        threads = [threading.Thread(target=work) for _ in free]
        for thread in threads:
            thread.start()
        try:
            _join(threads)
        except KeyboardInterrupt:
            end_all()
            _join(threads)
            raise
        if errors:
            raise errors[0]

    def _numbers(self) -> Iterator[int]:
        """Numbers of trials to run: interrupted ones, then new ones, until there are enough."""
        while not is_ending():
            with self.lock:
                if self.interrupted:
                    number = self.interrupted.pop(0)
                elif len(states(self.study)) < self.trials:
                    number = self._ask()
                else:
                    return
            yield number

    def _ask(self) -> int:
        """A new trial; its proposal depends on its number and on the trials before it alone."""
        seed = self.searched.seed + len(states(self.study))
        self.study.sampler = built(self.searched.sampler, seed=seed)
        trial = self.study.ask(fixed_distributions=distributions(self.searched.space))
        return int(trial.number)

    def _trial(self, number: int, place: Place) -> None:
        params = states(self.study)[number].params
        member = self._member(number, params)
        told = ", ".join(f"{name}={value}" for name, value in params.items())
        logger.info("Trial %d begins: %s", number, told)
        done = finished_attempt(member)
        ended = run_member(member, place) if done is None else Ended("", State.FINISHED, done)
        if is_ending() and not ended.good:
            # It goes on with the search.
            return
        with self.lock:
            self._tell(number, ended)

    def _member(self, number: int, params: dict[str, Any]) -> Member:
        report = (
            "+callbacks.search._target_=hand_recon.sweeps.search.reporting.ReportToSearch",
            f"+callbacks.search.folder={quoted(str(self.folder))}",
            f"+callbacks.search.trial={number}",
        )
        words = (*self.searched.overrides, *overrides(params), "test=false", *report)
        settings = json.loads(json.dumps({"trial": number, "params": params}))
        return Member("train", "train", words, self._folder(number), settings, str(number))

    def _folder(self, number: int) -> Path:
        return self.folder / f"trial_{number:04d}"

    def _tell(self, number: int, ended: Ended) -> None:
        """Tell the study how a trial has ended."""
        failed, pruned = _states()
        value = self._value(ended) if ended.good else None
        attributes = states(self.study)[number].user_attrs
        if value is None:
            told = ended.told or f"no finite {self.searched.objective}"
            trial_of(self.study, number).set_user_attr(ERROR, told)
            self.study.tell(number, state=failed)
            logger.warning("Trial %d failed: %s", number, told)
        elif PRUNED in attributes:
            self.study.tell(number, state=pruned)
            logger.info("Trial %d was ended at epoch %d.", number, attributes[PRUNED])
        else:
            self.study.tell(number, value)
            logger.info("Trial %d: %s %.4g", number, self.searched.objective, value)

    def _value(self, ended: Ended) -> float | None:
        """Objective of the best checkpoint on all validation hands; None if it is not finite."""
        metrics = json.loads((ended.folder / METRICS_FILE).read_text(encoding="utf-8"))
        value = metrics["validation"].get(self.searched.objective.removeprefix("val/"))
        return float(value) if value is not None and math.isfinite(value) else None


def _join(threads: list[threading.Thread]) -> None:
    for thread in threads:
        thread.join()


def _states() -> tuple[Any, Any]:
    import optuna

    return optuna.trial.TrialState.FAIL, optuna.trial.TrialState.PRUNED
