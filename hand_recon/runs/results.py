"""Writes the results of a run: scores beside a baseline, images, a report that opens offline."""

import csv
import json
import logging
import platform
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import lightning
import torch
import torchmetrics
from omegaconf import DictConfig, OmegaConf
from rich.console import Console
from rich.table import Table
from torch import Tensor

from hand_recon import __version__
from hand_recon.command_line.launched import ALONE, Place
from hand_recon.data.augment import to_float
from hand_recon.data.datamodule import HandDataModule
from hand_recon.data.dataset import load_batch
from hand_recon.data.selection import evenly_spaced
from hand_recon.evaluation.baseline import mean_pose_baseline
from hand_recon.evaluation.scores import HandPoints
from hand_recon.runs.configuration import instantiate
from hand_recon.runs.observers import ConstantHand, ObservedTest, Observer
from hand_recon.runs.trainer_arguments import trainer_arguments
from hand_recon.runs.training_progress import is_interactive
from hand_recon.runs.validation_scores import untested
from hand_recon.runs.working_together import leave
from hand_recon.schema import HandBatch, HandPrediction
from hand_recon.training.module import HandReconstruction
from hand_recon.visualization.curves import draw_curves
from hand_recon.visualization.overlay import rows
from hand_recon.visualization.paper_figures import rank_by_uncertainty
from hand_recon.visualization.run_report import Report, write_report
from hand_recon.visualization.score_names import heading

logger = logging.getLogger(__name__)

BASELINE_HANDS = 2000
"""Training hands whose mean is the constant predictor: more change it by less than 0.01 mm."""


ALIGNED = tuple(
    name + suffix
    for name in ("E_J", "AUC_J", "E_V", "AUC_V", "F@5", "F@15")
    for suffix in ("", "_proper")
)
"""Scores after alignment; a constant hand has no meaningful others."""


@dataclass(frozen=True)
class Run:
    """A trained module and where its results go."""

    config: DictConfig
    folder: Path
    module: HandReconstruction
    data: HandDataModule
    mean_pose: HandPoints | None
    """Mean training hand, the constant predictor; none if the training data have no 3D labels."""
    facts: dict[str, Any]
    """Further entries of `metrics.json`."""
    observers: tuple[Observer, ...] = ()
    """Called with every test batch and its prediction, if one process sees all of them."""
    place: Place = ALONE
    """Place of this process; all of them test."""


def finish_run(run: Run) -> dict[str, Any]:
    """Test, print the table, and write metrics, images and the report.

    All processes test; then they leave their group, and the first one writes.

    Returns:
        What `metrics.json` holds; in other processes than the first, nothing.
    """
    if not run.config.get("test", True):
        return finish_untested(run)
    constant = None if run.mean_pose is None else ConstantHand(run.mean_pose, ALIGNED)
    scores = _test(run, constant)
    of_constant = {} if constant is None else constant.scores()
    leave()
    if run.place.rank:
        return {}
    metrics: dict[str, Any] = {
        "name": run.config.name,
        "data": run.data.name,
        "landmarks": run.data.landmark_set,
        "test_hands": len(run.data.dataset("test")),
        "test": scores,
        "mean_pose": of_constant,
        **run.facts,
        "environment": environment(),
    }
    write_json(run.folder / "metrics.json", metrics)
    _write_per_hand(run)
    _print_table(scores, metrics["mean_pose"], run.data.name)
    if "E_V" not in scores:
        logger.warning(
            "%s has no ground-truth vertices of this hand: vertex scores are left out.",
            run.data.name,
        )
    _write_report(run, metrics)
    return metrics


def finish_untested(run: Run) -> dict[str, Any]:
    """Score the validation hands in place of the test hands, and write that alone."""
    leave()
    if run.place.rank:
        return {}
    metrics = untested(run, environment())
    write_json(run.folder / "metrics.json", metrics)
    return metrics


def mean_pose(data: HandDataModule) -> HandPoints | None:
    """The mean of the training hands; none where they have no 3D.

    It is for comparison alone: training never sees it.
    """
    truth = data.train_ground_truth(BASELINE_HANDS)
    return None if truth is None else mean_pose_baseline(HandPoints(*truth))


def _test(run: Run, constant: ConstantHand | None) -> dict[str, float]:
    """Scores on the test hands, in single precision whatever the training's was."""
    observers: tuple[Observer, ...] = run.observers if run.place.count == 1 else ()
    if constant is not None:
        observers = (*observers, constant)
    trainer = instantiate(
        run.config.trainer,
        precision="32-true",
        logger=False,
        enable_checkpointing=False,
        enable_progress_bar=is_interactive(),
        callbacks=[ObservedTest(*observers)],
        **trainer_arguments(run.config.trainer, run.place),
    )
    trainer.test(run.module, datamodule=run.data, verbose=False)
    return {
        name.removeprefix("test/"): float(value)
        for name, value in trainer.callback_metrics.items()
        if name.startswith("test/")
    }


def _write_per_hand(run: Run) -> None:
    """Write the 3D scores of each test hand, for intervals and paired comparisons."""
    index, columns = run.module.test.last_per_hand
    if columns:
        write_per_hand(run.folder / "per_hand.csv", index, columns)


def write_per_hand(path: Path, index: Tensor, columns: dict[str, Tensor]) -> None:
    """Write a CSV with one row per hand: its index and its scores, as `HandMetrics.per_hand` has them."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(["index", *columns])
        for place, values in zip(
            index.tolist(), torch.stack(list(columns.values()), dim=1).tolist(), strict=True
        ):
            writer.writerow([place, *(f"{value:.6g}" for value in values)])


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write a JSON file, indented."""
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def _write_report(run: Run, metrics: dict[str, Any]) -> None:
    """Draw overlays and, if there is a log, curves, and write the page that shows them."""
    shown = _shown_hands(run)
    overlays = tuple(_draw_overlays(run, shown)) if shown else ()
    log, curves = run.folder / "csv" / "metrics.csv", run.folder / "curves.png"
    if log.is_file():
        draw_curves(log, curves)
    target = run.folder / "report.html"
    write_report(
        Report(
            title=f"{run.config.name} on {run.data.name}",
            scores=metrics["test"],
            baseline=metrics["mean_pose"],
            facts={key: value for key, value in metrics.items() if not isinstance(value, dict)}
            | metrics["environment"],
            overlays=overlays,
            curves=curves if curves.is_file() else None,
            config=OmegaConf.to_yaml(run.config, resolve=True),
            figures=_draw_ellipses(run, shown) if shown else (),
        ),
        target,
    )
    logger.info("Open %s", target)


@dataclass(frozen=True)
class _Shown:
    """Test hands that the report shows."""

    indices: list[int]
    """Positions in the test set."""
    batch: HandBatch
    """Samples of the dataset."""
    prediction: HandPrediction
    """Predictions for those hands."""


@torch.no_grad()
def _shown_hands(run: Run) -> _Shown | None:
    """Predict test hands spread evenly over the set; None if no image is wanted."""
    dataset = run.data.dataset("test")
    indices = evenly_spaced(len(dataset), int(run.config.report.images))
    if not indices:
        return None
    batch = load_batch(dataset, indices)
    module = run.module.to("cpu").eval()
    return _Shown(indices, batch, module(to_float(batch)))


def _draw_overlays(run: Run, shown: _Shown) -> list[Path]:
    """Draw one row of images per hand, from the smallest error to the largest."""
    error = (shown.prediction.landmarks_2d - shown.batch.landmarks_2d).norm(dim=-1)
    order = torch.nanmean(error, dim=-1).nan_to_num(torch.inf).argsort().tolist()
    images = rows(shown.batch, shown.prediction, run.module.regressor.hand.faces)
    folder = run.folder / "overlays"
    folder.mkdir(exist_ok=True)
    paths = []
    for rank, position in enumerate(order):
        path = folder / f"{rank:02d}_sample{shown.indices[position]}.png"
        cv2.imwrite(str(path), cv2.cvtColor(images[position], cv2.COLOR_RGB2BGR))
        paths.append(path)
    return paths


def _draw_ellipses(run: Run, shown: _Shown) -> tuple[tuple[str, Path], ...]:
    """Draw the hands with the smallest and the largest σ (Fig. 4b), if σ was learnt."""
    if not run.module.data_term.learns_sigma:
        return ()
    path = run.folder / "uncertainty.png"
    count = min(4, len(shown.indices) // 2)
    image = rank_by_uncertainty(shown.batch, shown.prediction, count=count)
    cv2.imwrite(str(path), cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    caption = "Test hands of the largest and the smallest mean σ; ellipses of 1σ and 2σ."
    return ((caption, path),)


def environment() -> dict[str, str]:
    """Versions, the device and the command line."""
    cuda = torch.cuda.get_device_name() if torch.cuda.is_available() else "none"
    return {
        "hand_recon": __version__,
        "python": platform.python_version(),
        "torch": torch.__version__,
        "lightning": lightning.__version__,
        "torchmetrics": torchmetrics.__version__,
        "gpu": cuda,
        "command": " ".join([Path(sys.argv[0]).name, *sys.argv[1:]]),
    }


def _print_table(scores: dict[str, float], baseline: dict[str, float], data_name: str) -> None:
    table = Table(title=f"Test hands of {data_name}")
    table.add_column("score")
    table.add_column("this model", justify="right")
    if baseline:
        table.add_column("mean pose", justify="right")
    for name, value in scores.items():
        row = [heading(name), f"{value:.3f}"]
        if baseline:
            row.append(f"{baseline[name]:.3f}" if name in baseline else "")
        table.add_row(*row)
    Console().print(table)
