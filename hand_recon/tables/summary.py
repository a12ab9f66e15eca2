"""Numbers of a table: means over seeds, changes from the row above, intervals over hands."""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from jaxtyping import Float

from hand_recon.tables.intervals import Bootstrap, Interval, interval
from hand_recon.tables.paper import COMPARED, TABLE_1, PaperRow, knowledge_of
from hand_recon.tables.runs import FinishedRun, PerHand
from hand_recon.tables.studies import Experiment, Study

BOOTSTRAPPED: Final = ("E_J", "E_V")
"""Errors with an interval over hands."""


@dataclass(frozen=True)
class Spread:
    """Mean and standard deviation of a score over seeds."""

    mean: float
    """Mean over seeds."""
    sd: float | None
    """Sample standard deviation over seeds; none for one seed."""


@dataclass(frozen=True)
class Change:
    """Change of a score from the row above."""

    absolute: float
    """This row minus the one above, in the score's unit."""
    percent: float | None
    """The same in percent of the row above; none where that is zero."""


@dataclass(frozen=True)
class Row:
    """One row of a table."""

    label: str
    """Name of the row."""
    knowledge: tuple[bool, ...] | None
    """Check marks of `hand_recon.tables.paper.KNOWLEDGE`; none where they are unknown."""
    paper: PaperRow | None
    """Row of the paper; none for experiments that its table does not have."""
    scores: dict[str, Spread]
    """Scores by name; empty where the row was not run."""
    seeds: tuple[int, ...] = ()
    """Seeds that were averaged over."""
    changes: dict[str, Change] = field(default_factory=dict)
    """Changes from the row above by score; empty without one."""
    intervals: dict[str, Interval] = field(default_factory=dict)
    """Intervals over hands of the mean over seeds; empty where the hands' errors are unknown."""
    change_intervals: dict[str, Interval] = field(default_factory=dict)
    """Intervals over hands of the change from the row above, paired hand by hand."""


@dataclass(frozen=True)
class Ratio:
    """Ratio of an earlier row's E_J to a later row's."""

    rows: tuple[int, int]
    """Numbers of the earlier and the later row."""
    paper: float
    """Ratio in the paper."""
    ours: float
    """Ratio of our means over seeds."""
    interval: Interval | None
    """Interval over hands of our ratio; none where the hands' errors are unknown."""


@dataclass(frozen=True)
class Summary:
    """One study in numbers."""

    study: Study
    """Study that is summarised."""
    table: tuple[Row, ...]
    """The five rows of Table 1, whether run or not."""
    others: tuple[Row, ...]
    """Rows of all other experiments."""
    mean_pose: dict[str, Spread]
    """Scores of the mean pose on the same test hands; empty without 3D ground truth."""
    ratios: tuple[Ratio, ...]
    """Ratios of row 1 to the rows with full knowledge."""


def summarise(study: Study, bootstrap: Bootstrap) -> Summary:
    """Average a study over its seeds and compare its rows."""
    table: list[Row] = []
    above: Experiment | None = None
    for paper in TABLE_1:
        experiment = study.row(paper.name)
        table.append(_row(experiment, above, paper, bootstrap))
        above = experiment
    others = [
        _row(experiment, None, None, bootstrap)
        for experiment in study.experiments
        if not experiment.in_table
    ]
    return Summary(
        study=study,
        table=tuple(table),
        others=tuple(others),
        mean_pose={
            # Every run has the same training hands, so that there is no spread over seeds.
            name: Spread(spread.mean, None)
            for name, spread in spreads([run.mean_pose for run in study.runs]).items()
        },
        ratios=tuple(_ratios(study, bootstrap)),
    )


def spreads(scores: list[dict[str, float]]) -> dict[str, Spread]:
    """Mean and sample standard deviation of every score, over the runs that have it."""
    spread = {}
    for name in dict.fromkeys(name for one in scores for name in one):
        values = np.array([one[name] for one in scores if name in one])
        sd = float(values.std(ddof=1)) if len(values) > 1 else None
        spread[name] = Spread(float(values.mean()), sd)
    return spread


def _row(
    experiment: Experiment | None,
    above: Experiment | None,
    paper: PaperRow | None,
    bootstrap: Bootstrap,
) -> Row:
    label = f"{paper.number} {paper.title}" if paper else ""
    if experiment is None:
        return Row(label, paper.knowledge if paper else None, paper, {})
    # The knowledge of a run without settings is known by its name alone.
    knowledge = knowledge_of(experiment.method) if experiment.method else None
    scores = spreads([run.scores for run in experiment.runs])
    before = {} if above is None else spreads([run.scores for run in above.runs])
    intervals, change_intervals = _intervals(experiment, above, bootstrap)
    return Row(
        label=label or experiment.label,
        knowledge=knowledge or (paper.knowledge if paper else None),
        paper=paper,
        scores=scores,
        seeds=tuple(run.seed for run in experiment.runs),
        changes={
            name: _change(scores[name].mean, before[name].mean)
            for name in COMPARED
            if name in scores and name in before
        },
        intervals=intervals,
        change_intervals=change_intervals,
    )


def _change(value: float, before: float) -> Change:
    return Change(value - before, 100 * (value - before) / before if before else None)


def _intervals(
    experiment: Experiment, above: Experiment | None, bootstrap: Bootstrap
) -> tuple[dict[str, Interval], dict[str, Interval]]:
    own, paired = {}, {}
    for name in BOOTSTRAPPED:
        alone = hand_means(name, experiment)
        if alone is not None:
            own[name] = interval(bootstrap.means(alone)[:, 0])
        both = None if above is None else hand_means(name, experiment, above)
        if both is not None:
            draws = bootstrap.means(both)
            paired[name] = interval(draws[:, 0] - draws[:, 1])
    return own, paired


def hand_means(name: str, *experiments: Experiment) -> Float[np.ndarray, "hand column"] | None:
    """Mean error over seeds of every hand, one column per experiment.

    Args:
        name: Name of the error.
        experiments: Experiments whose hands are matched by index; hands that some run lacks are left out.

    Returns:
        Errors in millimetres; none where a run has no such errors, or no hand is common to all.
    """
    errors: list[list[PerHand]] = []
    for experiment in experiments:
        known = [run.per_hand for run in experiment.runs if _knows(run, name)]
        if len(known) < len(experiment.runs):
            return None
        errors.append([per_hand for per_hand in known if per_hand is not None])
    common = errors[0][0].index
    for per_hand in (one for row in errors for one in row):
        finite = per_hand.index[np.isfinite(per_hand.errors[name])]
        common = np.intersect1d(common, finite)
    if len(common) == 0:
        return None
    columns = [
        np.mean([one.errors[name][np.searchsorted(one.index, common)] for one in row], axis=0)
        for row in errors
    ]
    return np.stack(columns, axis=1)


def _knows(run: FinishedRun, name: str) -> bool:
    return run.per_hand is not None and name in run.per_hand.errors


def _ratios(study: Study, bootstrap: Bootstrap) -> list[Ratio]:
    first = study.row(TABLE_1[0].name)
    ratios = []
    for paper in TABLE_1[3:]:
        later = study.row(paper.name)
        if first is None or later is None:
            continue
        scores = [spreads([run.scores for run in one.runs]) for one in (first, later)]
        if any("E_J" not in score for score in scores):
            continue
        hands = hand_means("E_J", first, later)
        draws = None if hands is None else bootstrap.means(hands)
        ratios.append(
            Ratio(
                rows=(TABLE_1[0].number, paper.number),
                paper=TABLE_1[0].scores["E_J"] / paper.scores["E_J"],
                ours=scores[0]["E_J"].mean / scores[1]["E_J"].mean,
                interval=None if draws is None else interval(draws[:, 0] / draws[:, 1]),
            )
        )
    return ratios
