"""Draws the paper's Fig. 3 and 4 from trained rows of Table 1."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import cv2
import numpy as np
import torch
from jaxtyping import Float, UInt8
from omegaconf import DictConfig

from hand_recon.data.augment import to_float
from hand_recon.data.dataset import load_batch
from hand_recon.data.selection import evenly_spaced
from hand_recon.evaluation.scores import LANDMARK_SCORES, HandPoints, landmark_scores
from hand_recon.runs.building import build_data
from hand_recon.runs.checkpoints import load_trained
from hand_recon.runs.configuration import check_extra, configure_process, use_cache
from hand_recon.runs.training_progress import quiet_libraries
from hand_recon.schema import HandBatch, HandPrediction
from hand_recon.tables.collection import collect
from hand_recon.tables.paper import TABLE_1
from hand_recon.tables.runs import FinishedRun
from hand_recon.tables.studies import Compared, Study
from hand_recon.visualization.paper_figures import (
    before_after,
    likelihood_effect,
    mean_sigma,
    rank_by_uncertainty,
)

logger = logging.getLogger(__name__)

NAMES: Final = ("fig3.png", "fig4a.png", "fig4b.png")
"""Files that are written: knowledge, likelihood, ranking."""

_MILLIMETRES: Final = 1000.0


@dataclass(frozen=True)
class Rows:
    """Predictions of the rows of Table 1 for the same test hands."""

    titles: tuple[str, ...]
    """Titles of the rows as in Fig. 3."""
    predictions: tuple[HandPrediction, ...]
    """Predictions of each row for the whole pool."""
    uncertain: bool
    """True if the last row has learnt σ."""
    batch: HandBatch
    """Pool of test hands."""
    faces: torch.Tensor
    """Triangles of the hand."""
    errors: Float[np.ndarray, "row hand"]
    """E_J, millimetres; NaN where there is no ground truth."""

    def of(self, hands: Sequence[int], first: int = 0) -> "Rows":
        """Select some of the hands, and the rows from `first` on."""
        chosen = torch.tensor(list(hands))
        predictions = tuple(prediction.select(chosen) for prediction in self.predictions)
        return replace(
            self,
            titles=self.titles[first:],
            predictions=predictions[first:],
            batch=self.batch.select(chosen),
            errors=self.errors[first:, list(hands)],
        )

    @property
    def columns(self) -> list[tuple[str, HandPrediction]]:
        """Titles with predictions."""
        return list(zip(self.titles, self.predictions, strict=True))


def figures(config: DictConfig) -> dict[str, str]:
    """Draw the figures that the runs allow.

    Args:
        config: `conf/figures.yaml` composed.

    Returns:
        The files that were written, by name without ending.

    Raises:
        ValueError: No row of Table 1 is among the runs, or none with the seed that was asked for.
        FileExistsError: The output folder holds such figures.
    """
    check_extra("matplotlib", "jinja2")
    quiet_libraries()
    configure_process(config.threads)
    folder = Path(config.output).absolute()
    taken = [name for name in NAMES if (folder / name).exists()]
    if taken:
        raise FileExistsError(
            f"{folder} already holds {taken[0]}, and nothing is overwritten. Leave `output` to its "
            "default, or name another folder."
        )
    rows = _predict(_rows_to_draw(config), config)
    shown = rows.of(_hands_by_gain(rows, config))
    drawn = {
        "fig3": before_after(shown.columns, shown.batch, shown.faces, shown.errors, config.panel)
    }
    if rows.uncertain:
        pair = rows.of(_spread(mean_sigma(rows.predictions[-1]), config.examples), first=-2)
        drawn["fig4a"] = likelihood_effect(
            pair.columns, pair.batch, pair.faces, pair.errors, config.panel
        )
        drawn["fig4b"] = rank_by_uncertainty(
            rows.batch, rows.predictions[-1], config.ranked, config.panel
        )
    else:
        logger.warning("No row with the NLL is among the runs: there is no σ to draw (Fig. 4).")
    folder.mkdir(parents=True, exist_ok=True)
    return {name: _save(folder / f"{name}.png", image) for name, image in drawn.items()}


def _rows_to_draw(config: DictConfig) -> list[tuple[str, FinishedRun, bool]]:
    """Select one run per row of Table 1, all of one seed: title, run, and whether σ was learnt."""
    compared = Compared(tuple(config.method), tuple(config.ignored))
    found = collect(config.runs, Path(config.paths.output), compared)
    if not found.studies or not any(found.studies[0].row(paper.name) for paper in TABLE_1):
        raise ValueError(
            f"No finished row of Table 1 below {', '.join(found.sources)}. Train some: "
            "`python -m hand_recon.train -m +experiment=ablation_row1,ablation_row2,…`."
        )
    if len(found.studies) > 1:
        logger.warning(
            "The runs differ in more than the method; of %d studies, the one with most rows is drawn.",
            len(found.studies),
        )
    return _with_one_seed(found.studies[0], config.seed)


def _with_one_seed(study: Study, seed: int | None) -> list[tuple[str, FinishedRun, bool]]:
    experiments = [(paper, study.row(paper.name)) for paper in TABLE_1]
    run = [(paper, one) for paper, one in experiments if one is not None]
    common = set.intersection(*({run.seed for run in one.runs} for _, one in run))
    wanted = min(common, default=None) if seed is None else seed
    if wanted not in common:
        raise ValueError(
            f"No seed {'' if seed is None else seed} that all rows were run with; they share "
            f"{sorted(common) or 'none'}. Give seed=<one of these>, or fewer rows with runs=…"
        )
    return [
        (paper.title, next(each for each in one.runs if each.seed == wanted), paper.knowledge[-1])
        for paper, one in run
    ]


@torch.no_grad()
def _predict(chosen: list[tuple[str, FinishedRun, bool]], config: DictConfig) -> Rows:
    loaded = []
    for title, run, _ in chosen:
        logger.info("%s: %s", title, run.folder)
        loaded.append(load_trained(run.folder))
    settings = loaded[0].config
    use_cache(settings.data, config.paths.cache)
    dataset = build_data(settings).dataset("test")
    batch = to_float(load_batch(dataset, _pool(len(dataset), config)))
    predictions = [trained.module(batch) for trained in loaded]
    return Rows(
        titles=tuple(title for title, _, _ in chosen),
        predictions=tuple(predictions),
        uncertain=chosen[-1][2],
        batch=batch,
        faces=loaded[0].module.regressor.hand.faces,
        errors=np.stack([_errors(batch, prediction) for prediction in predictions]),
    )


def _pool(size: int, config: DictConfig) -> list[int]:
    """Positions of the hands that are looked at: those asked for, and others evenly over the test set."""
    asked = [int(hand) for hand in config.hands or []]
    if outside := [hand for hand in asked if not 0 <= hand < size]:
        raise ValueError(f"There are {size} test hands, numbered from 0: no {outside}.")
    return [*asked, *(index for index in evenly_spaced(size, config.pool) if index not in asked)]


def _errors(batch: HandBatch, prediction: HandPrediction) -> Float[np.ndarray, " hand"]:
    errors = np.full(len(batch), np.nan)
    if batch.landmarks_3d is not None:
        known = batch.landmarks_3d.isfinite().flatten(1).all(dim=1)
        truth, predicted = batch.landmarks_3d[known], prediction.landmarks_3d[known]
        scores = landmark_scores(HandPoints(truth), HandPoints(predicted))
        column = LANDMARK_SCORES.index("E_J")
        errors[known.numpy()] = scores[:, column].numpy() * _MILLIMETRES
    return errors


def _hands_by_gain(rows: Rows, config: DictConfig) -> list[int]:
    """The hands asked for, else from those that gained most to those that gained least, evenly."""
    if config.hands:
        return list(range(len(config.hands)))
    return _spread(rows.errors[0] - rows.errors[-1], config.count)


def _spread(values: Float[np.ndarray, " hand"], count: int) -> list[int]:
    """Positions of values at evenly spaced ranks, 5 % away from either end, largest first."""
    order = np.argsort(-np.nan_to_num(values, nan=-np.inf), kind="stable")
    ranks = np.linspace(0.05, 0.95, count) * (len(order) - 1)
    return list(dict.fromkeys(order[ranks.round().astype(int)].tolist()))


def _save(path: Path, image: UInt8[np.ndarray, "height width 3"]) -> str:
    cv2.imwrite(str(path), cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    logger.info("Open %s", path)
    return str(path)
