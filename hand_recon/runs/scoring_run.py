"""Scores a file of predictions as its benchmark would (Sec. 4.1)."""

from pathlib import Path
from typing import Any

import torch
from omegaconf import DictConfig, OmegaConf

from hand_recon.protocols.benchmarks import PROTOCOLS, Protocol, protocol_named
from hand_recon.protocols.scoring import Request, score_predictions, submit
from hand_recon.runs.configuration import claim_folder, configure_process


def score(config: DictConfig) -> dict[str, Any]:
    """Score a file of predictions.

    Args:
        config: `conf/score.yaml` composed.

    Returns:
        What `scores.json` holds.

    Raises:
        ValueError: The predictions, the protocol or the ground truth were not given.
    """
    if OmegaConf.is_missing(config, "predictions"):
        raise ValueError(
            "No predictions were given. Type hand-recon score <pred.json> protocol=<name> "
            "ground_truth=<folder>."
        )
    if config.protocol is None or (config.ground_truth is None and config.get("data") is None):
        raise ValueError(
            "Predictions need protocol=<name> and ground_truth=<folder with evaluation_xyz.json>, or for "
            "DexYCB, which has no such file, data=dexycb data.root=<folder>; protocols are "
            f"{', '.join(PROTOCOLS)}."
        )
    configure_process(config.threads)
    protocol = protocol_named(config.protocol)
    folder = claim_folder(config.paths.run)
    if config.ground_truth is None:
        config.ground_truth = str(_written_ground_truth(config, protocol, folder / "ground_truth"))
    wanted = () if config.output is None else (Path(config.output),)
    outputs = (*wanted, folder / "scores.json")
    paths = Path(config.predictions), Path(config.ground_truth)
    return score_predictions(Request(paths[0], protocol, paths[1], outputs))


def _written_ground_truth(config: DictConfig, protocol: Protocol, folder: Path) -> Path:
    """Write the ground truth of a dataset's test hands in the form of the benchmark's files."""
    # Datasets need Lightning, which takes seconds to import; most predictions are scored without one.
    from hand_recon.data.annotated_dataset import AnnotatedImages
    from hand_recon.protocols.benchmark_predictions import benchmark_of
    from hand_recon.runs.building import build_data

    data = build_data(config)
    benchmark, dataset = benchmark_of(data, protocol), data.dataset("test")
    if not isinstance(dataset, AnnotatedImages) or dataset.hands.landmarks_3d is None:
        raise ValueError(f"{data.name} has no ground truth of its test hands.")
    landmarks = torch.from_numpy(dataset.hands.landmarks_3d[dataset.rows]).double()
    ids = None if benchmark.ids is None else torch.from_numpy(benchmark.ids)
    paths = submit(protocol.name, landmarks, None, folder, ids=ids)
    return paths[0]
