"""Labels the hands of a folder of images with the detector, and marks doubtful ones (decision 70)."""

import logging
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from omegaconf import DictConfig, ListConfig, OmegaConf

from hand_recon import __version__
from hand_recon.data.photos.listing import photo_files
from hand_recon.data.progress import with_progress
from hand_recon.fitting.in_parts import PART
from hand_recon.runs.configuration import check_extra, configure_process, plain
from hand_recon.runs.fit_run import adapted_to_data
from hand_recon.runs.labelling.cvat_export import ANNOTATIONS, TASK, write_cvat
from hand_recon.runs.labelling.label_files import (
    DOUBTFUL,
    KEEP,
    LABELS,
    PROGRESS,
    TABLE,
    pairs_of,
    recording,
    write_labels,
    write_table,
)
from hand_recon.runs.labelling.label_records import LabelledImage
from hand_recon.runs.labelling.label_sheets import draw_sheets
from hand_recon.runs.labelling.label_studio_export import INTERFACE, TASKS, write_label_studio
from hand_recon.runs.labelling.label_summary import show_summary, summary_of
from hand_recon.runs.labelling.labeller import Labeller
from hand_recon.runs.looking import LookedAt
from hand_recon.runs.unfinished import (
    MARK,
    claim_or_resume,
    file_state,
    finish,
    results_folder,
    settings_of,
)

logger = logging.getLogger(__name__)

IMAGES_AT_ONCE: Final = 32
"""Most images that are finished together; an interruption loses no more."""

SHEETS: Final = "sheets"
"""Folder of the pages to look at."""

EXPORTS: Final = ("cvat", "label_studio")
"""Tools that files are written for."""

PRODUCTS: Final = (
    LABELS, DOUBTFUL, TABLE, PROGRESS, SHEETS, "config.yaml", ANNOTATIONS, TASK, TASKS, INTERFACE,
)  # fmt: skip
"""Files and folders of the command; a folder that holds one of them is not written to."""

_AT_THE_END: Final = ("keep", "export", "sheets", "max_damaged", "source", "task")
"""Options that may differ when an interrupted command goes on."""

_FILES: Final = ("detector.landmarks", "detector.boxes", "lifter", "hand.path")


def label_images(config: DictConfig) -> dict[str, Any]:
    """`prepare labels images=<folder>`: label the hands of images with the detector.

    Args:
        config: `conf/prepare_labels.yaml` composed.

    Returns:
        Numbers of images, hands and marks.

    Raises:
        ValueError: An option is wrong, there are no images, too many are damaged, or no hand is kept.
        FileExistsError: The folder of the results holds something else.
    """
    configure_process(config.threads)
    config = adapted_to_data(config)
    exports = _exports(config)
    root = _folder_of_images(config)
    if config.sheets:
        check_extra("matplotlib")
    labeller = Labeller(config, root)
    folder = results_folder(config)
    files = [path for path in photo_files([root]) if not _is_result(path, folder)]
    settings = settings_of(config, _FILES)
    settings["options"] = {
        key: value for key, value in settings["options"].items() if key not in _AT_THE_END
    }
    settings["images"] = [file_state(path) for path in files]
    claim_or_resume(folder, PRODUCTS, settings)
    OmegaConf.save(OmegaConf.create(plain(config)), folder / "config.yaml")
    logger.info("Labelling %d images into %s", len(files), folder)
    images = _labelled(labeller, files, folder / PROGRESS, config.max_damaged)
    summary = _write(config, folder, root, images, exports)
    (folder / PROGRESS).unlink()
    finish(folder)
    show_summary(summary, folder, root)
    _check(summary, config.keep)
    return summary


def _exports(config: DictConfig) -> list[str]:
    """Names of the tools to write for; checks `keep` and `export` before anything is computed.

    Raises:
        ValueError: One of them is unknown.
    """
    if config.keep not in KEEP:
        raise ValueError(f"Unknown keep={config.keep}; choose one of {list(KEEP)}.")
    given = config.export
    names = list(given) if isinstance(given, ListConfig) else [] if given is None else [given]
    for name in names:
        if name not in EXPORTS:
            raise ValueError(
                f"Unknown export={name}; choose cvat, label_studio or [cvat,label_studio]."
            )
    return names


def _folder_of_images(config: DictConfig) -> Path:
    """The folder of the images.

    Raises:
        ValueError: It is not named, or is no folder.
    """
    if config.images in (None, ""):
        raise ValueError(
            "No folder of images is named: type hand-recon prepare labels <folder>, or images=<folder>."
        )
    root = Path(str(config.images)).expanduser().absolute()
    if not root.is_dir():
        raise ValueError(f"{root} is no folder; expected one that holds images.")
    return root


def _is_result(path: Path, folder: Path) -> bool:
    """True for what this command drew: files in its folder, and sheets beside labels."""
    drawn = path.parent.name == SHEETS and any(
        (path.parent.parent / name).exists() for name in (LABELS, DOUBTFUL, MARK)
    )
    return drawn or folder in path.absolute().parents


def _labelled(
    labeller: Labeller, files: Sequence[Path], progress: Path, most_damaged: int
) -> list[LabelledImage]:
    """Label the images that are not done yet; all images in the order of the files.

    Raises:
        ValueError: More images than allowed cannot be read.
    """
    with recording(progress) as (images, add):
        _check_damaged(images, most_damaged)
        done = {image.name for image in images}
        if done:
            logger.info("%d images are done already.", len(done))
        rest = [
            (number, path)
            for number, path in enumerate(files)
            if labeller.name_of(path) not in done
        ]
        for batch in _batches(labeller, rest):
            finished = labeller.label(batch)
            add(finished)
            images += finished
            _check_damaged(images, most_damaged)
    return images


def _batches(labeller: Labeller, rest: Sequence[tuple[int, Path]]) -> Iterator[list[LookedAt]]:
    """Images with their hands, some at a time."""
    batch: list[LookedAt] = []
    for number, path in with_progress(rest, len(rest), f"Labelling {len(rest)} images"):
        batch.append(labeller.look(number, path))
        if len(batch) == IMAGES_AT_ONCE or sum(len(one.hands) for one in batch) >= PART:
            yield batch
            batch = []
    if batch:
        yield batch


def _check_damaged(images: Sequence[LabelledImage], most: int) -> None:
    damaged = [image.name for image in images if image.error is not None]
    if len(damaged) > most:
        raise ValueError(
            f"{len(damaged)} images cannot be used, more than max_damaged={most}: {', '.join(damaged)}. "
            "Repair or remove them and name another folder with output=…, or raise max_damaged to go on "
            "without them."
        )


def _write(
    config: DictConfig,
    folder: Path,
    root: Path,
    images: Sequence[LabelledImage],
    exports: Sequence[str],
) -> dict[str, Any]:
    """Write all files; numbers of images, hands and marks."""
    pairs = pairs_of(images)
    doubtful = [pair for pair in pairs if not pair[1].is_sure]
    kept = pairs if config.keep == "all" else [pair for pair in pairs if pair[1].is_sure]
    about = {
        "made_by": f"hand_recon {__version__} prepare labels",
        "copies": config.copies,
        "fit": config.fit,
        "limits": OmegaConf.to_container(config.limits),
        "keep": config.keep,
    }
    if kept:
        write_labels(folder / LABELS, kept, about)
    if doubtful:
        write_labels(folder / DOUBTFUL, doubtful, about)
    write_table(folder / TABLE, images)
    # Those that need correction come first.
    by_doubt = sorted(images, key=lambda image: all(hand.is_sure for hand in image.hands))
    written: list[Path] = []
    if "cvat" in exports:
        written += write_cvat(folder, by_doubt)
    if "label_studio" in exports:
        written += write_label_studio(folder, by_doubt, root)
    if config.sheets:
        written += draw_sheets(folder / SHEETS, root, pairs, config.sheets)
    return summary_of(images, len(kept), written)


def _check(summary: dict[str, Any], keep: str) -> None:
    if not summary["hands"]:
        raise ValueError(
            f"No hand was found in {summary['images']} images. Hands may be too small, cut off or blurred; "
            "detector.min_palm_score=0.3 looks less strictly, and detector=whole takes each image for one "
            "hand."
        )
    if not summary["kept"]:
        raise ValueError(
            f"All {summary['hands']} hands are doubtful, so that there is no {LABELS} with keep={keep}; "
            f"{DOUBTFUL} has them with the reasons. keep=all, or wider limits such as limits.max_sigma=0.1, "
            "keep more."
        )
