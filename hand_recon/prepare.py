"""Gets ready what is licensed, slow or doubtful: MANO, caches, labels.

python -m hand_recon.prepare mano mano_v1_2.zip [folder=data/mano]
python -m hand_recon.prepare cache data=freihand data.root=/path/to/FreiHAND_pub_v2
python -m hand_recon.prepare check data=freihand data.root=/path/to/FreiHAND_pub_v2
"""

import json
import logging
import os
import sys
import zipfile
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Final

import cv2
import hydra
from omegaconf import DictConfig
from rich.console import Console

from hand_recon.data.annotated_dataset import PictureHands
from hand_recon.data.datamodule import HandDataModule, gather
from hand_recon.hand.mano.conversion import prepare_mano
from hand_recon.inspection.caches import crop_maps, stale_maps
from hand_recon.inspection.contact_sheet import contact_sheet
from hand_recon.inspection.labels import LabelReport, examine_labels
from hand_recon.inspection.ranges import examine_poses
from hand_recon.runs.configuration import CONF, build_data, build_hand, claim_folder

logger = logging.getLogger(__name__)

MANO_FOLDER: Final = "data/mano"
"""Where MANO goes, and where conf/hand/mano.yaml looks for it; HAND_RECON_MANO names another."""


def mano(words: Sequence[str]) -> list[Path]:
    """`prepare mano <download> [folder=<folder>]`.

    Args:
        words: The command line after `mano`.

    Raises:
        SystemExit: It cannot be understood.
    """
    sources = [word for word in words if not word.startswith("folder=")]
    folders = [word.removeprefix("folder=") for word in words if word.startswith("folder=")]
    if len(sources) != 1 or len(folders) > 1 or sources[0].startswith("-"):
        raise SystemExit(
            "usage: python -m hand_recon.prepare mano <mano_v1_2.zip | MANO_RIGHT.pkl | MANO_LEFT.pkl> "
            f"[folder={MANO_FOLDER}]"
        )
    folder = Path(folders[0] if folders else os.environ.get("HAND_RECON_MANO", MANO_FOLDER))
    written = prepare_mano(Path(sources[0]).expanduser(), folder.expanduser())
    console = Console(highlight=False, soft_wrap=True)
    for path in written:
        console.print(f"Ready: {path}")
    console.print("Use it with hand=mano. Its licence is yours alone: pass neither file on.")
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
        if isinstance(dataset, PictureHands):
            hands = dataset.hands
            stale |= {
                str(one.folder): one.size
                for one in stale_maps(folder, hands.name, hands.root, hands.fingerprint)
            }
        logger.info("%s %s: %d samples are ready", data.name, split, len(dataset))
    for path, size in stale.items():
        logger.warning(
            "%s holds %.2f GB of crops of a dataset that has changed since: nothing reads them. "
            "rm -r it if you like.", path, size / 1e9,
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
    data, hand = build_data(config), build_hand(config)
    split = config.splits[0]
    dataset = data.dataset_with_surfaces(split)
    logger.info("%s %s: %d samples", data.name, split, len(dataset))
    folder = claim_folder(config.paths.run)
    numbers = gather(dataset, _spread(len(dataset), config.check.numbers))
    report = examine_labels(numbers)
    if split == "train":
        poses = examine_poses(data, hand.rest_angles, config.check.numbers)
        report = replace(report, numbers=report.numbers | poses)
    shown = gather(dataset, _spread(len(dataset), config.check.samples))
    page = contact_sheet(shown, hand.faces)
    cv2.imwrite(str(folder / "samples.png"), page[..., ::-1])
    (folder / "labels.json").write_text(json.dumps(asdict(report), indent=2))
    _show(report, data, folder)
    if report.troubles:
        raise ValueError(
            f"{data.name} is not ready to be trained on:\n- " + "\n- ".join(report.troubles)
        )
    return report


def _spread(length: int, wanted: int) -> list[int]:
    """Positions spread evenly over a dataset."""
    count = min(length, wanted)
    return [index * length // count for index in range(count)]


def _show(report: LabelReport, data: HandDataModule, folder: Path) -> None:
    console = Console(highlight=False, soft_wrap=True)
    console.print(f"[bold]{data.name}[/bold], landmarks as in the set {data.landmarks!r}")
    for name, value in report.numbers.items():
        console.print(f"  {name:36} {value:10.3f}")
    scarce = {name: share for name, share in report.labelled.items() if share < 1}
    if scarce:
        least = sorted(scarce, key=lambda name: scarce[name])[:5]
        told = ", ".join(f"{name} {100 * scarce[name]:.0f} %" for name in least)
        console.print(f"  landmarks that are not always labelled: {told}")
    console.print(f"Look at {folder / 'samples.png'}")


@hydra.main(version_base="1.3", config_path=CONF, config_name="prepare")
def _cache(config: DictConfig) -> None:
    cache(config)


@hydra.main(version_base="1.3", config_path=CONF, config_name="prepare")
def _check(config: DictConfig) -> None:
    check(config)


def main() -> None:
    """The command line: a verb, then what belongs to it.

    Raises:
        SystemExit: There is no such verb, or what `mano` was given cannot be converted.
    """
    verb = sys.argv[1] if len(sys.argv) > 1 else "--help"
    if verb in ("-h", "--help"):
        sys.stdout.write(f"{__doc__}\n")
    elif verb == "mano":
        try:
            mano(sys.argv[2:])
        except (OSError, ValueError, zipfile.BadZipFile) as error:
            # What was given is not what is wanted: where in the program that showed helps nobody.
            raise SystemExit(str(error)) from error
    elif verb in ("cache", "check"):
        # Hydra reads the rest.
        del sys.argv[1]
        (_cache if verb == "cache" else _check)()
    else:
        raise SystemExit(f"Unknown task {verb!r}; choose mano, cache or check.\n{__doc__}")


if __name__ == "__main__":
    main()
