"""What may stand in one table: runs that differ in nothing but the method and the seed."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from hand_recon.tables.paper import TABLE_1, is_papers
from hand_recon.tables.runs import METRICS_FILE, FinishedRun, LeftOut

Setting = tuple[str, str]
"""A setting's dotted name, and its value as text."""


@dataclass(frozen=True)
class Compared:
    """How settings are read: by the beginning of their dotted name, up to a dot; `*` is any one part."""

    method: tuple[str, ...]
    """What makes a row: the prior, the data term, the supervision."""
    ignored: tuple[str, ...]
    """What changes no result, or is averaged over."""

    def method_of(self, run: FinishedRun) -> frozenset[Setting]:
        """The settings that make the run's row."""
        return frozenset(item for item in run.settings.items() if _begins(item[0], self.method))

    def study_of(self, run: FinishedRun) -> frozenset[Setting]:
        """The settings that make the run's table: all that is neither method nor ignored."""
        apart = (*self.method, *self.ignored)
        settings = {item for item in run.settings.items() if not _begins(item[0], apart)}
        tested = {(name, str(run.facts[name])) for name in ("data", "test_hands", "landmarks") if
                  name in run.facts}  # fmt: skip
        return frozenset(settings | tested)


@dataclass(frozen=True)
class Experiment:
    """Runs of one method in one study: one row."""

    name: str
    """As the runs call it."""
    label: str
    """The name; with what was set otherwise, where a study has several methods of that name."""
    method: dict[str, str]
    """The settings that make the row."""
    runs: tuple[FinishedRun, ...]
    """One per seed, by seed."""
    in_table: bool
    """Whether it stands for a row of Table 1."""


@dataclass(frozen=True)
class Study:
    """Runs that were given the same model, data and budget: one table."""

    settings: dict[str, str]
    """What its runs have in common, method apart."""
    differs: dict[str, str]
    """Those that another study in the same report has otherwise."""
    experiments: tuple[Experiment, ...]
    """Rows of Table 1 first, in its order; then others by name."""

    def row(self, name: str) -> Experiment | None:
        """The experiment that stands for a row of Table 1."""
        return next((one for one in self.experiments if one.in_table and one.name == name), None)

    @property
    def runs(self) -> tuple[FinishedRun, ...]:
        """All of its runs."""
        return tuple(run for experiment in self.experiments for run in experiment.runs)


def group(
    runs: Iterable[FinishedRun], compared: Compared
) -> tuple[tuple[Study, ...], tuple[LeftOut, ...]]:
    """Sort runs into studies, and those into rows.

    Of several runs with the same settings and seed the newest counts: seeds are averaged over, and none
    may count twice.

    Returns:
        The studies, those with most rows of Table 1 first; and the runs that newer ones replace.
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
        common = frozenset.intersection(*methods)
        for method, members in methods.items():
            own = ", ".join(f"{key}={value}" for key, value in sorted(method - common))
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


def _standing_for(
    name: str, variants: dict[str, dict[frozenset[Setting], list[FinishedRun]]]
) -> frozenset[Setting] | None:
    """Of the methods that runs of one name had, the one that stands for that row of Table 1.

    It has the row's knowledge and the paper's data term; of several such, it shares most settings with the
    other rows, so that a sweep over one row's weight leaves that row with the weight that the others have;
    then it has most seeds.
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
        # The text last: a choice that does not depend on any order.
        return *is_papers(dict(method), row), shared, len(methods[method]), sorted(method)

    return max(methods, key=merit)


def _importance(study: Study) -> tuple[int, int, str]:
    rows = sum(experiment.in_table for experiment in study.experiments)
    return -rows, -len(study.runs), str(study.settings)


def _begins(name: str, prefixes: Iterable[str]) -> bool:
    """Whether a dotted name begins with one of some others, in which `*` is any one part."""
    parts = name.split(".")
    return any(
        len(wanted) <= len(parts)
        and all(one in ("*", part) for one, part in zip(wanted, parts[: len(wanted)], strict=True))
        for wanted in (prefix.split(".") for prefix in prefixes)
    )
