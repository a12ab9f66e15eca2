"""Writes a lifter or a network for images as one ONNX file, with the hand model inside (decision 85).

hand-recon export default format=onnx
hand-recon export outputs/train/<time> format=onnx --output my_network.onnx
"""

import hashlib
import logging
from pathlib import Path
from typing import Final

from omegaconf import DictConfig, OmegaConf

from hand_recon import __version__
from hand_recon.formats.new_file import refuse_existing, write_new
from hand_recon.formats.onnx_file import VERSION_ENTRY, check_installed, to_onnx
from hand_recon.formats.onnx_graphs import CropGraph, LifterGraph, NetworkGraph
from hand_recon.hand.model import HandModel
from hand_recon.regressor.landmark_encoder import LandmarkEncoder
from hand_recon.runs.checkpoint_files import checkpoint_at
from hand_recon.runs.configuration import build_hand, configure_process
from hand_recon.runs.lifters import DEFAULT, SUFFIX, lifter_path, load_named
from hand_recon.runs.photo_crops import crop_policy
from hand_recon.runs.unfinished import results_folder

logger = logging.getLogger(__name__)

ENDING: Final = ".onnx"
"""Ending of the files."""

_OPEN: Final = "open"
"""Name of the hand model that may be passed on."""


def export_onnx(config: DictConfig) -> list[Path]:
    """Write a network as an ONNX file, and compare it with PyTorch before.

    Args:
        config: `conf/export.yaml` composed; `source` is `default` (the packaged lifter), a lifter's file, a
            run's folder or a checkpoint; `output` a folder or the name of the file.

    Returns:
        The file.

    Raises:
        FileExistsError: The file exists.
        FileNotFoundError: There is no such network.
        ModuleNotFoundError: The extra `onnx` is not installed.
        ValueError: The source is no network, or ONNX's runtime gives other numbers than PyTorch.
    """
    check_installed()
    configure_process(config.threads)
    source = _source(config)
    graph, about = load_graph(source, build_hand(config))
    path = _file(config, graph.kind)
    refuse_existing([path])
    logger.info("Translating the network to ONNX takes up to a minute.")
    write_new(path, to_onnx(graph, about))
    size = path.stat().st_size / 1e6
    logger.info("%s: %.1f MB; inputs %s", path, size, ", ".join(graph.inputs))
    if graph.regressor.hand.name != _OPEN:
        logger.warning("The file holds the hand model. %s", about["licence"])
    return [path]


def load_graph(source: str, hand: HandModel) -> tuple[NetworkGraph, dict[str, str]]:
    """Load a network as ONNX will hold it, and entries of the file's metadata about it.

    Args:
        source: `default`, a lifter's file, a run's folder or a checkpoint.
        hand: Hand model of a lifter's file, if it is not the open hand.
    """
    if source == DEFAULT or source.endswith(SUFFIX):
        file = lifter_path(source)
        graph: NetworkGraph = LifterGraph(load_named(source, hand))
        crop: dict[str, str] = {}
    else:
        file = _checkpoint(source)
        graph, crop = _of_checkpoint(file)
    with file.open("rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
    licence = _licence(graph.regressor.hand, packaged=source == DEFAULT)
    about = {
        VERSION_ENTRY: __version__,
        "checkpoint": file.name,
        "checkpoint_sha256": digest,
        "licence": licence,
    }
    return graph, about | crop


def _of_checkpoint(file: Path) -> tuple[NetworkGraph, dict[str, str]]:
    """Network of a checkpoint, and the crops that it was trained on."""
    # Checkpoints need Lightning, which takes seconds to import.
    from hand_recon.runs.checkpoints import load_trained

    trained = load_trained(file)
    regressor = trained.module.regressor
    if isinstance(regressor.encoder, LandmarkEncoder):
        return LifterGraph(regressor), {}
    policy = crop_policy(trained.config)
    crop = {
        "crop_size": str(policy.size),
        "crop_around": policy.around,
        "crop_expansion": f"{policy.expansion:g}",
    }
    return CropGraph(regressor, policy.size, trained.sigma_factor), crop


def _source(config: DictConfig) -> str:
    if OmegaConf.is_missing(config, "source"):
        raise ValueError(
            "No network was given. Type hand-recon export default format=onnx for the packaged lifter, or "
            "name a run's folder or a checkpoint in place of default."
        )
    return str(config.source)


def _checkpoint(source: str) -> Path:
    """File of a checkpoint: itself, or the best one of a run's folder."""
    file = checkpoint_at(source)
    if file.suffix.startswith(".json"):
        raise ValueError(
            f"format=onnx writes networks, and {file} is a file of hands. Give default (the packaged "
            "lifter), a run's folder or a checkpoint, or another format."
        )
    if not file.is_file():
        raise FileNotFoundError(
            f"No network at {file}. Give default (the packaged lifter), a lifter's {SUFFIX} file, a run's "
            "folder or a checkpoint."
        )
    return file


def _file(config: DictConfig, kind: str) -> Path:
    """The file to write: `output` itself if it ends as ONNX files do, else in the folder of the results."""
    if config.output and str(config.output).endswith(ENDING):
        return Path(config.output).expanduser().absolute()
    return results_folder(config) / f"{kind}{ENDING}"


def _licence(hand: HandModel, *, packaged: bool) -> str:
    """Terms of a file: those of the weights and those of the hand model's arrays."""
    if hand.name != _OPEN:
        return (
            f"Holds arrays of the hand model {hand.name!r}, whose licence each user accepts with its "
            "authors: do not pass the file on."
        )
    if packaged:
        return "Apache-2.0, as hand_recon (LICENSE, NOTICE)."
    return (
        "Hand model: Apache-2.0, as hand_recon (LICENSE, NOTICE). Weights: as whoever trained them decides, "
        "within the licences of their data."
    )
