"""Score a checkpoint on its own test hands or on another dataset's, or a file of predictions (Sec. 4.1).

python -m hand_recon.evaluate ckpt=outputs/train/<time>
python -m hand_recon.evaluate ckpt=… data=freihand data.root=/path/to/FreiHAND_pub_v2
python -m hand_recon.evaluate ckpt=… data=freihand data.root=… protocol=freihand
python -m hand_recon.evaluate predictions=pred.json protocol=freihand ground_truth=/path/to/folder
"""

import logging
from pathlib import Path
from typing import Any, Final

import hydra
import lightning
import torch
from omegaconf import DictConfig, OmegaConf, open_dict

from hand_recon.data.annotated_dataset import PictureHands
from hand_recon.data.datamodule import HandDataModule
from hand_recon.protocols.benchmark_predictions import benchmark_of, predict_test
from hand_recon.protocols.benchmarks import PROTOCOLS, Protocol, protocol_named
from hand_recon.protocols.scoring import Request, print_scores, score_predictions, submit
from hand_recon.protocols.submission import rooted
from hand_recon.runs.checkpoints import load_trained
from hand_recon.command_line.configuration_files import CONF
from hand_recon.runs.building import build_data, check_input
from hand_recon.runs.configuration import claim_folder, configure_process, use_cache
from hand_recon.runs.results import Run, finish_run, write_json
from hand_recon.runs.training_progress import quiet_libraries
from hand_recon.training.module import HandReconstruction

logger = logging.getLogger(__name__)

STANDING_IN: Final = {
    "crop_size": 224, "seed": 0, "workers": 0, "hand": {"_target_": "hand_recon.hand.open_hand.open_hand"},
}  # fmt: skip
"""What a dataset's configuration refers to, where no model is there to say it and no picture is read."""


def evaluate(config: DictConfig) -> dict[str, Any]:
    """Score a checkpoint, or a file of predictions.

    Args:
        config: `conf/evaluate.yaml` composed.

    Returns:
        What `metrics.json` holds; of predictions, what `scores.json` holds.

    Raises:
        ValueError: Neither checkpoint nor predictions were given, or both.
    """
    if config.predictions is not None:
        return _score_file(config)
    _refuse_stray(config)
    if OmegaConf.is_missing(config, "ckpt"):
        raise ValueError(
            "Which checkpoint? Give ckpt=<file or folder of a run>, "
            "for example ckpt=outputs/train/<time>; or predictions=<file> with protocol and ground_truth."
        )
    quiet_libraries()
    configure_process(config.threads)
    other_data = config.get("data") is not None
    loaded = load_trained(config.ckpt, config.data.landmarks if other_data else None)
    trained = loaded.config
    lightning.seed_everything(trained.seed, workers=True, verbose=False)
    folder = claim_folder(config.paths.run)
    with open_dict(trained):
        trained.paths, trained.report, trained.name = config.paths, config.report, config.name
        if other_data:
            trained.data = config.data
        use_cache(trained.data, config.paths.cache)
        trained.trainer = config.trainer
    # The constant predictor is of the data that the checkpoint was trained on.
    mean = None if other_data else loaded.mean_pose
    facts = {"checkpoint": str(config.ckpt)}
    data = build_data(trained)
    check_input(loaded.module, data)
    protocol = None if config.protocol is None else protocol_named(config.protocol)
    if protocol is not None:
        # Before anything is predicted.
        benchmark_of(data, protocol)
    metrics = finish_run(Run(trained, folder, loaded.module, data, mean, facts))
    if protocol is not None:
        metrics["official"] = _submit(loaded.module, data, protocol, folder, _device(config))
        write_json(folder / "metrics.json", metrics)
    return metrics


def _device(config: DictConfig) -> str:
    """A GPU if there is one and the trainer was not told otherwise."""
    allowed = config.trainer.get("accelerator", "auto") != "cpu"
    return "cuda" if allowed and torch.cuda.is_available() else "cpu"


def _submit(
    module: HandReconstruction,
    data: HandDataModule,
    protocol: Protocol,
    folder: Path,
    device: str,
) -> dict[str, Any]:
    """Write what the benchmark's server takes; its scores as well, if the truth is known here."""
    benchmark = benchmark_of(data, protocol)
    tested = predict_test(module, data, module.regressor.hand.name, device)
    ids = None if benchmark.ids is None else torch.from_numpy(benchmark.ids)
    wrists = None if benchmark.wrists is None else torch.from_numpy(benchmark.wrists)
    # Once: what is scored here is what is written.
    points = rooted(tested.prediction, wrists)
    if points.vertices is None and protocol.scores_vertices:
        logger.warning(
            "The hand %r is not MANO: the file has no surfaces, and the server's scores of surfaces mean "
            "nothing.", module.regressor.hand.name,
        )  # fmt: skip
    submit(protocol.name, points.landmarks, points.vertices, folder / "submission", ids=ids)
    if tested.ground_truth is None:
        logger.warning("%s does not tell the truth of its test hands: no scores.", data.name)
        return {}
    official = protocol.scores(tested.ground_truth, points)
    print_scores(official)
    return official


def _score_file(config: DictConfig) -> dict[str, Any]:
    """Score a file of predictions as its benchmark would."""
    if not OmegaConf.is_missing(config, "ckpt"):
        raise ValueError(
            "Give ckpt=<run> or predictions=<file>, and not both: which is to be scored?"
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
        config.ground_truth = str(_written_truth(config, protocol, folder / "ground_truth"))
    wanted = () if config.output is None else (Path(config.output),)
    outputs = (*wanted, folder / "scores.json")
    paths = Path(config.predictions), Path(config.ground_truth)
    return score_predictions(Request(paths[0], protocol, paths[1], outputs))


def _written_truth(config: DictConfig, protocol: Protocol, folder: Path) -> Path:
    """The truth of a dataset's test hands, in the form of the benchmark's files."""
    described = OmegaConf.create({"data": config.data, "paths": config.paths, **STANDING_IN})
    data = build_data(described)
    benchmark, dataset = benchmark_of(data, protocol), data.dataset("test")
    if not isinstance(dataset, PictureHands) or dataset.hands.landmarks_3d is None:
        raise ValueError(f"{data.name} does not tell the truth of its test hands.")
    landmarks = torch.from_numpy(dataset.hands.landmarks_3d[dataset.rows]).double()
    ids = None if benchmark.ids is None else torch.from_numpy(benchmark.ids)
    paths = submit(protocol.name, landmarks, None, folder, ids=ids)
    return paths[0]


def _refuse_stray(config: DictConfig) -> None:
    """Settings that would be ignored without predictions."""
    stray = [name for name in ("ground_truth", "output") if config[name] is not None]
    if stray:
        raise ValueError(
            f"{', '.join(f'{name}=' for name in stray)} is of predictions=<file>, which was not given."
        )

