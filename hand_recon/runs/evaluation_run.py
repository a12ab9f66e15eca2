"""Tests a checkpoint on its own test hands or on another dataset's (Sec. 4.1)."""

import logging
from functools import partial
from pathlib import Path
from typing import Any, Final

import lightning
import torch
from omegaconf import DictConfig, OmegaConf, open_dict

from hand_recon.command_line.launched import Place
from hand_recon.data.datamodule import HandDataModule
from hand_recon.protocols.benchmark_predictions import (
    BenchmarkPredictions,
    TestedHands,
    benchmark_of,
    predict_test,
)
from hand_recon.protocols.benchmarks import Protocol, protocol_named
from hand_recon.protocols.scoring import print_scores, submit
from hand_recon.protocols.submission import rooted
from hand_recon.runs.building import build_data, check_input
from hand_recon.runs.checkpoints import load_trained
from hand_recon.runs.configuration import check_extra, claim_folder, configure_process, use_cache
from hand_recon.runs.results import Run, finish_run, write_json
from hand_recon.runs.training_progress import quiet_libraries
from hand_recon.runs.working_together import (
    first_of_each_machine,
    from_first,
    joined,
    place_of,
)

logger = logging.getLogger(__name__)

TASK: Final = f"{__name__}:evaluate"
"""This command's function, for its other processes."""


def evaluate(config: DictConfig) -> dict[str, Any]:
    """Test a checkpoint.

    Args:
        config: `conf/evaluate.yaml` composed.

    Returns:
        What `metrics.json` holds.

    Raises:
        ValueError: No checkpoint was given.
    """
    if OmegaConf.is_missing(config, "ckpt"):
        raise ValueError(
            "No checkpoint was given. Type hand-recon evaluate <file or folder of a run>, for example "
            "outputs/train/<time>; predictions of another system are scored by hand-recon score."
        )
    check_extra("matplotlib", "jinja2")
    quiet_libraries()
    place = place_of(config)
    threads = configure_process(config.threads, place.local_count)
    with joined(place, config, TASK, threads):
        return _evaluate(config, place)


def _evaluate(config: DictConfig, place: Place) -> dict[str, Any]:
    other_data = config.get("data") is not None
    loaded = load_trained(config.ckpt, config.data.landmark_set if other_data else None)
    trained = loaded.config
    lightning.seed_everything(trained.seed, workers=True, verbose=False)
    folder = from_first(place, partial(claim_folder, config.paths.run))
    with open_dict(trained):
        trained.paths, trained.report, trained.name = config.paths, config.report, config.name
        trained.paths.run = str(folder)
        if other_data:
            trained.data = config.data
        use_cache(trained.data, config.paths.cache)
        trained.trainer = config.trainer
    # The mean hand of the training data is no baseline for another dataset.
    mean = None if other_data else loaded.mean_pose
    facts = {"checkpoint": str(config.ckpt)}
    data = build_data(trained)
    check_input(loaded.module, data)
    protocol = None if config.protocol is None else protocol_named(config.protocol)
    if protocol is not None:
        # Checked before minutes of prediction.
        benchmark_of(data, protocol)
    hand = loaded.module.regressor.hand.name
    collected = BenchmarkPredictions(hand)
    observers = () if protocol is None else (collected,)
    first_of_each_machine(place, partial(data.setup, "test"))
    run = Run(trained, folder, loaded.module, data, mean, facts, observers, place)
    metrics = finish_run(run)
    if protocol is not None and place.rank == 0:
        if place.count == 1:
            tested = collected.tested(data)
        else:
            tested = predict_test(loaded.module, data, hand, _device(config))
        metrics["official"] = _submit(tested, hand, data, protocol, folder)
        write_json(folder / "metrics.json", metrics)
    return metrics


def _device(config: DictConfig) -> str:
    """Device to predict on: a GPU if there is one and the trainer does not exclude it."""
    allowed = config.trainer.get("accelerator", "auto") != "cpu"
    return "cuda" if allowed and torch.cuda.is_available() else "cpu"


def _submit(
    tested: TestedHands, hand: str, data: HandDataModule, protocol: Protocol, folder: Path
) -> dict[str, Any]:
    """Write the files for the benchmark's server; score them, too, if the ground truth is known."""
    benchmark = benchmark_of(data, protocol)
    ids = None if benchmark.ids is None else torch.from_numpy(benchmark.ids)
    wrists = None if benchmark.wrists is None else torch.from_numpy(benchmark.wrists)
    # Rooted once, so that what is scored is what is written.
    points = rooted(tested.prediction, wrists)
    if points.vertices is None and protocol.scores_vertices:
        logger.warning(
            "The hand %r is not MANO: the file has no surfaces, and the server's scores of surfaces mean "
            "nothing.", hand,
        )  # fmt: skip
    submit(protocol.name, points.landmarks, points.vertices, folder / "submission", ids=ids)
    if tested.ground_truth is None:
        logger.warning("%s has no ground truth of its test hands: no scores.", data.name)
        return {}
    official = protocol.scores(tested.ground_truth, points)
    print_scores(official)
    return official
