"""Grouping of runs into studies, which differ in method and seed only, and of these into rows."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from hand_recon.tables.paper import TABLE_1, is_papers
from hand_recon.tables.runs import METRICS_FILE, FinishedRun, LeftOut

Setting = tuple[str, str]
"""A setting's dotted name and its value as text."""

_TARGET: Final = "._target_"
"""End of the name of the setting that says what a part is."""


@dataclass(frozen=True)
class Compared:
    """Roles of settings, given by prefixes of their dotted names; `*` stands for any one part."""

    method: tuple[str, ...]
    """Settings that distinguish rows: prior, data term, supervision."""
    ignored: tuple[str, ...]
    """Settings that change no result, or are averaged over."""

    def method_of(self, run: FinishedRun) -> frozenset[Setting]:
        """Settings that determine the run's row."""
        return frozenset(item for item in run.settings.items() if _begins(item[0], self.method))

    def study_of(self, run: FinishedRun) -> frozenset[Setting]:
        """Settings that determine the run's table: all that are neither method nor ignored."""
        apart = (*self.method, *self.ignored)
        settings = {item for item in run.settings.items() if not _begins(item[0], apart)}
        tested = {(name, str(run.facts[name])) for name in ("data", "test_hands", "landmarks") if
                  name in run.facts}  # fmt: skip
        return frozenset(settings | tested)


@dataclass(frozen=True)
class Experiment:
    """Runs of one method in one study, one row of a table."""

    name: str
    """Name of the experiment."""
    label: str
    """Name, with the differing settings where a study has several methods of that name."""
    method: dict[str, str]
    """Settings that determine the row."""
    runs: tuple[FinishedRun, ...]
    """Runs, one per seed, sorted by seed."""
    in_table: bool
    """True if the experiment represents a row of Table 1."""


@dataclass(frozen=True)
class Study:
    """Runs with the same model, data and budget, one table."""

    settings: dict[str, str]
    """Settings that its runs share, without those of the method."""
    differs: dict[str, str]
    """Settings in which another study of the report differs."""
    experiments: tuple[Experiment, ...]
    """Experiments; rows of Table 1 first, in its order, then others by name."""

    def row(self, name: str) -> Experiment | None:
        """Experiment that represents a row of Table 1."""
        return next((one for one in self.experiments if one.in_table and one.name == name), None)

    @property
    def runs(self) -> tuple[FinishedRun, ...]:
        """All runs of the study."""
        return tuple(run for experiment in self.experiments for run in experiment.runs)


def group(
    runs: Iterable[FinishedRun], compared: Compared
) -> tuple[tuple[Study, ...], tuple[LeftOut, ...]]:
    """Group runs into studies, and those into rows.

    Of several runs with the same settings and seed only the newest counts, so that no seed counts twice.

    Returns:
        The studies, those with most rows of Table 1 first; and the runs that newer ones replaced.
    """
    latest: dict[tuple[object, ...], FinishedRun] = {}
    replaced = []
    for run in sorted(runs, key=lambda run: (run.folder / METRICS_FILE).stat().st_mtime):
        key = (compared.study_of(run), compared.method_of(run), run.name, run.seed)
        if key in latest:
            reason = f"repeated with the same settings and seed in {run.folder}"
            replaced.append(LeftOut(latest[key].folder, reason))
        latest[key] = run
    by_study: dict[frozenset[Setting], list[FinishedRun]] = {}
    for run in latest.values():
        by_study.setdefault(compared.study_of(run), []).append(run)
    common = frozenset.intersection(*by_study) if by_study else frozenset()
    studies = [
        Study(
            dict(sorted(settings)), dict(sorted(settings - common)), _experiments(members, compared)
        )
        for settings, members in by_study.items()
    ]
    studies.sort(key=_importance)
    return tuple(studies), tuple(replaced)


def _experiments(runs: Sequence[FinishedRun], compared: Compared) -> tuple[Experiment, ...]:
    variants: dict[str, dict[frozenset[Setting], list[FinishedRun]]] = {}
    for run in runs:
        of_name = variants.setdefault(run.name, {})
        of_name.setdefault(compared.method_of(run), []).append(run)
    experiments = []
    for name, methods in variants.items():
        chosen = _standing_for(name, variants)
        for method, members in methods.items():
            own = ", ".join(own_settings(method, list(methods)))
            experiments.append(
                Experiment(
                    name=name,
                    label=f"{name} ({own or 'without them'})" if len(methods) > 1 else name,
                    method=dict(sorted(method)),
                    runs=tuple(sorted(members, key=lambda run: run.seed)),
                    in_table=method == chosen,
                )
            )
    return tuple(sorted(experiments, key=lambda one: (not one.in_table, one.name, one.label)))


def own_settings(
    method: frozenset[Setting], methods: Sequence[frozenset[Setting]]
) -> tuple[str, ...]:
    """Settings that tell a method from the others, as words.

    A part that is built, such as a term of the prior, is one word, with those of its settings that differ
    among the methods that have it.

    Args:
        method: The settings of the method.
        methods: All methods, this one among them.
    """
    own = method - frozenset.intersection(*methods)
    words: dict[str, str] = {}
    targets = sorted(key for key, _ in own if key.endswith(_TARGET))
    for key in targets:
        part = key.removesuffix(_TARGET)
        if any(part.startswith(f"{outer}.") for outer in words):
            continue
        value = dict(own)[key]
        alike = [other for other in methods if (key, value) in other]
        inner = {setting for setting in own if setting[0].startswith(f"{part}.")}
        words[part] = str(value).rsplit(".", 1)[-1]
        words |= dict(inner - frozenset.intersection(*alike))
        own -= inner
    return tuple(f"{key}={value}" for key, value in sorted((words | dict(own)).items()))


def _standing_for(
    name: str, variants: dict[str, dict[frozenset[Setting], list[FinishedRun]]]
) -> frozenset[Setting] | None:
    """Method that represents a row of Table 1, of all methods whose runs have the row's name.

    Preferred are, in this order: the row's knowledge; the paper's data term; most settings in common with
    the other rows, so that in a sweep over one row's weight the row keeps the others' weight; most seeds.
    """
    row = next((row for row in TABLE_1 if row.name == name), None)
    if row is None:
        return None
    others: Counter[Setting] = Counter()
    for other in {row.name for row in TABLE_1 if row.name != name} & set(variants):
        others.update(setting for method in variants[other] for setting in method)
    methods = variants[name]

    def merit(method: frozenset[Setting]) -> tuple[object, ...]:
        shared = sum(others[setting] for setting in method)
        # The text last, so that ties do not depend on the order of the runs.
        return *is_papers(dict(method), row), shared, len(methods[method]), sorted(method)

    return max(methods, key=merit)


def _importance(study: Study) -> tuple[int, int, str]:
    rows = sum(experiment.in_table for experiment in study.experiments)
    return -rows, -len(study.runs), str(study.settings)


def _begins(name: str, prefixes: Iterable[str]) -> bool:
    """True if a dotted name begins with one of some prefixes, in which `*` stands for any one part."""
    parts = name.split(".")
    return any(
        len(wanted) <= len(parts)
        and all(one in ("*", part) for one, part in zip(wanted, parts[: len(wanted)], strict=True))
        for wanted in (prefix.split(".") for prefix in prefixes)
    )
