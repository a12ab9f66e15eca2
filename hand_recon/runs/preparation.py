"""Converts MANO, fetches the detector, fills caches, checks labels, writes labels and shards."""

import json
import logging
import zipfile
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import cv2
from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from hand_recon.data.annotated_dataset import AnnotatedImages
from hand_recon.data.datamodule import HandDataModule
from hand_recon.data.dataset import load_batch
from hand_recon.data.selection import evenly_spaced
from hand_recon.detection.model_download import prepare_models
from hand_recon.detection.models import ModelFolder
from hand_recon.hand.mano.conversion import prepare_mano
from hand_recon.inspection.caches import crop_maps, stale_maps
from hand_recon.inspection.contact_sheet import contact_sheet
from hand_recon.inspection.labels import LabelReport, examine_labels
from hand_recon.inspection.ranges import examine_poses
from hand_recon.runs.building import build_data
from hand_recon.runs.configuration import build_hand, check_extra, claim_folder
from hand_recon.runs.labelling.label_run import label_images
from hand_recon.runs.shard_run import prepare_shards

logger = logging.getLogger(__name__)


def prepare(config: DictConfig) -> Any:  # noqa: ANN401  # each task's own result
    """Run the task that was named.

    Args:
        config: `conf/prepare.yaml` composed, or that of the task, such as `conf/prepare_mano.yaml`.

    Raises:
        ValueError: There is no such task.
    """
    tasks = {
        "mano": mano, "detector": detector, "cache": cache, "check": check, "labels": label_images,
        "shards": prepare_shards,
    }  # fmt: skip
    name = None if OmegaConf.is_missing(config, "task") else str(config.task)
    if name not in tasks:
        raise ValueError(
            f"{'No task was given' if name is None else f'Unknown task {name!r}'}: type hand-recon prepare "
            "with mano, detector, cache, check, labels or shards."
        )
    if name not in ("mano", "detector", "labels", "shards") and config.source is not None:
        raise ValueError(
            f"prepare {name} takes no file, found {config.source!r}. Name the data as options, for example "
            f"hand-recon prepare {name} data=freihand data.root=<folder>."
        )
    return tasks[name](config)


def mano(config: DictConfig) -> list[Path]:
    """`prepare mano <download>`: convert MANO's files once.

    Args:
        config: `conf/prepare_mano.yaml` composed.

    Raises:
        SystemExit: No download was given, or it cannot be converted.
    """
    if OmegaConf.is_missing(config, "source"):
        raise SystemExit(
            "No MANO download was given: type hand-recon prepare mano <mano_v1_2.zip | MANO_RIGHT.pkl | "
            "MANO_LEFT.pkl> [folder=data/mano]"
        )
    try:
        written = prepare_mano(Path(config.source).expanduser(), Path(config.folder).expanduser())
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        # The user's file is at fault: a traceback helps nobody.
        raise SystemExit(str(error)) from error
    console = Console(highlight=False, soft_wrap=True)
    for path in written:
        console.print(f"Ready: {path}")
    console.print("Use it with hand=mano. Its licence is yours alone: pass neither file on.")
    return written


def detector(config: DictConfig) -> list[Path]:
    """`prepare detector [<file>]`: put the hand detector's two models into the cache.

    Args:
        config: `conf/prepare_detector.yaml` composed.

    Returns:
        Files that were written; none if everything was there.

    Raises:
        SystemExit: The models cannot be had.
    """
    source = OmegaConf.to_container(config, resolve=True)["source"]  # type: ignore[index,call-overload]
    files = source if isinstance(source, list) else [] if source is None else [source]
    folder = ModelFolder(config.folder)
    try:
        written = prepare_models([Path(str(file)).expanduser() for file in files], folder)
    except OSError as error:
        raise SystemExit(str(error)) from error
    console = Console(highlight=False, soft_wrap=True)
    for path in written:
        console.print(f"Ready: {path}")
    if not written:
        console.print(f"Both models are in {folder.path} already.")
    return written


def cache(config: DictConfig) -> dict[str, Any]:
    """`prepare cache`: build every split, so that its crops are decoded or rendered once.

    Args:
        config: `conf/prepare.yaml` composed.

    Returns:
        Number of samples by split, the maps of crops, and those that nothing reads any more.
    """
    data = build_data(config)
    counts = {}
    folder = Path(config.paths.cache).expanduser()
    stale: dict[str, int] = {}
    for split in config.splits:
        dataset = data.dataset(split)
        counts[split] = len(dataset)
        if isinstance(dataset, AnnotatedImages):
            hands = dataset.hands
            stale |= {
                str(one.folder): one.size
                for one in stale_maps(folder, hands.name, hands.root, hands.fingerprint)
            }
        logger.info("%s %s: %d samples are ready", data.name, split, len(dataset))
    for path, size in stale.items():
        logger.warning(
            "%s holds %.2f GB of crops of a dataset that has changed since: nothing reads them. "
            "Remove the folder to free the space.", path, size / 1e9,
        )  # fmt: skip
    return {
        "samples": counts,
        "maps": [str(one.folder) for one in crop_maps(folder)],
        "stale": stale,
    }


def check(config: DictConfig) -> LabelReport:
    """`prepare check`: a page of samples and the numbers of many, with diagnoses.

    Args:
        config: `conf/prepare.yaml` composed.

    Raises:
        ValueError: The labels cannot be what they are taken for.
    """
    check_extra("matplotlib")
    data, hand = build_data(config), build_hand(config)
    split = config.splits[0]
    dataset = data.dataset_with_surfaces(split)
    logger.info("%s %s: %d samples", data.name, split, len(dataset))
    folder = claim_folder(config.paths.run)
    numbers = load_batch(dataset, evenly_spaced(len(dataset), config.check.numbers))
    report = examine_labels(numbers)
    if split == "train":
        poses = examine_poses(data, hand.rest_angles, config.check.numbers)
        report = replace(report, numbers=report.numbers | poses)
    shown = load_batch(dataset, evenly_spaced(len(dataset), config.check.samples))
    page = contact_sheet(shown, hand.faces)
    cv2.imwrite(str(folder / "samples.png"), page[..., ::-1])
    (folder / "labels.json").write_text(json.dumps(asdict(report), indent=2))
    _show(report, data, folder)
    if report.troubles:
        raise ValueError(
            f"{data.name} is not ready to be trained on:\n- " + "\n- ".join(report.troubles)
        )
    return report


def _show(report: LabelReport, data: HandDataModule, folder: Path) -> None:
    console = Console(highlight=False, soft_wrap=True)
    console.print(f"[bold]{data.name}[/bold], landmarks as in the set {data.landmark_set!r}")
    for name, value in report.numbers.items():
        console.print(f"  {name:36} {value:10.3f}")
    scarce = {name: share for name, share in report.labelled.items() if share < 1}
    if scarce:
        least = sorted(scarce, key=lambda name: scarce[name])[:5]
        told = ", ".join(f"{name} {100 * scarce[name]:.0f} %" for name in least)
        console.print(f"  landmarks that are not always labelled: {told}")
    console.print(f"Look at {folder / 'samples.png'}")
