"""Writes the hands of a file as files of other programs."""

import logging
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from omegaconf import DictConfig, open_dict

from hand_recon.command_line.resolvers import MANO_HAND
from hand_recon.fitting.hands_file import read_hands
from hand_recon.formats.by_name import FORMATS, check, write
from hand_recon.formats.exported_hands import ExportedHands, exported_hands
from hand_recon.formats.new_file import refuse_existing
from hand_recon.hand.model import HandModel
from hand_recon.runs.configuration import build_hand, configure_process
from hand_recon.runs.lifters import DEFAULT
from hand_recon.runs.unfinished import make_folder, results_folder

logger = logging.getLogger(__name__)


def export(config: DictConfig) -> dict[str, Any]:
    """Write hands in one format or several: all files, or after an error none.

    Args:
        config: `conf/export.yaml` composed.

    Returns:
        The number of hands, unless a network was written, and the files.

    Raises:
        FileExistsError: A file exists in the folder of the results.
        FileNotFoundError: There is no file of hands.
        ModuleNotFoundError: A format needs a package that is not installed.
        ValueError: A format is unknown or cannot hold these hands, or the file is no file of hands.
    """
    names = format_names(config.format)
    if ONNX in names:
        return _export_network(config, names)
    unknown = [name for name in names if name not in FORMATS]
    if unknown:
        raise ValueError(
            f"Unknown format {unknown[0]!r}; expected one or more of {', '.join(FORMATS)}, or {ONNX} for a "
            "network."
        )
    formats = [FORMATS[name] for name in names]
    configure_process(config.threads)
    hands = exported_hands(read_hands(_source(config.source)), export_hand(config))
    for one in formats:
        check(one, hands)
    folder = results_folder(config)
    files = _write_all(names, hands, folder)
    shown = [str(path.relative_to(folder)) for path in files[:_SHOWN]]
    more = [f"and {len(files) - _SHOWN} more"] if len(files) > _SHOWN else []
    logger.info("Wrote to %s: %s", folder, ", ".join([*shown, *more]))
    return {"hands": sum(1 for _ in hands), "files": [str(path) for path in files]}


ONNX: Final = "onnx"
"""Format that holds a network, and no hands."""

_SHOWN: Final = 20
"""Files that are listed; sequences of meshes have a file for each frame."""


def format_names(given: str | Sequence[str]) -> list[str]:
    """Names of formats, each once.

    Args:
        given: A list, or a text with commas between the names.

    Raises:
        ValueError: There is no name.
    """
    words = given.split(",") if isinstance(given, str) else [str(word) for word in given]
    names = list(dict.fromkeys(word.strip() for word in words if word.strip()))
    if not names:
        raise ValueError(f"No format was given; expected one or more of {', '.join(FORMATS)}.")
    return names


def _source(given: str) -> Path:
    """The file of hands; refuse folders and networks with the name to give."""
    path = Path(given).expanduser()
    if path.is_dir():
        files = [path / f"hands{suffix}" for suffix in (".json", ".jsonl")]
        found = next((file for file in files if file.is_file()), None)
        raise FileNotFoundError(
            f"{path} is a folder; expected a file of hands. "
            + (f"Give {found}." if found else "For the ONNX file of a run, add format=onnx.")
        )
    if given == DEFAULT and not path.exists():
        raise FileNotFoundError(
            f"{DEFAULT} is the packaged lifter, a network; expected a file of hands. For its ONNX file, add "
            "format=onnx."
        )
    return path


def _export_network(config: DictConfig, names: Sequence[str]) -> dict[str, Any]:
    """Write a network; see `hand_recon.runs.onnx_run`."""
    if len(names) > 1:
        raise ValueError(
            f"Found format={','.join(names)}. {ONNX} holds a network, and the others hands: give it in a "
            "command of its own."
        )
    # Only this format needs networks.
    from hand_recon.runs.onnx_run import export_onnx

    return {"files": [str(path) for path in export_onnx(config)]}


def export_hand(config: DictConfig) -> HandModel:
    """Build the hand model, with fingertips of its mesh, whatever landmarks the hands were fitted to.

    Args:
        config: `conf/export.yaml` composed.
    """
    config = config.copy()
    with open_dict(config):
        config.hand.landmark_set = "mano" if config.hand._target_ == MANO_HAND else "knuckle"
    return build_hand(config)


def _write_all(names: Sequence[str], hands: ExportedHands, folder: Path) -> list[Path]:
    """Write all formats beside the results, and move them there if nothing is replaced."""
    is_new = not folder.exists()
    make_folder(folder)
    try:
        return _write_and_move(names, hands, folder)
    finally:
        # After an error a new folder is empty.
        if is_new and not any(folder.iterdir()):
            folder.rmdir()


def _write_and_move(names: Sequence[str], hands: ExportedHands, folder: Path) -> list[Path]:
    """Write all formats into a folder in the results' own, and then move them out of it."""
    with tempfile.TemporaryDirectory(prefix=".export-", dir=folder) as made:
        parts = [path.relative_to(made) for name in names for path in write(name, hands, made)]
        refuse_existing(folder / part for part in parts)
        for part in parts:
            (folder / part).parent.mkdir(parents=True, exist_ok=True)
            (Path(made) / part).rename(folder / part)
    return [folder / part for part in parts]
