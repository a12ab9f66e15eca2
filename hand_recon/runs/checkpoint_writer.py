"""Writes checkpoints that are whole or absent, keeps the one before, and recognizes damaged ones."""

import os
import zipfile
from pathlib import Path
from typing import Any, Final

import torch
from lightning.pytorch.plugins.io import TorchCheckpointIO

from hand_recon.data.whole_files import replaced_when_whole

LAST: Final = "last.ckpt"
"""Checkpoint with everything that training needs to go on."""

BEFORE_LAST: Final = "before_last.ckpt"
"""The one before it, for when the last one is damaged."""

METRICS_KEY: Final = "hand_recon_metrics"
"""Key of the scalars logged so far, as the text of `metrics.csv`."""

POSITION_KEY: Final = "hand_recon_position"
"""Key of the epoch and its batches so far."""

FOR_TRAINING: Final = (
    "optimizer_states", "lr_schedulers", "loops", "callbacks", METRICS_KEY, POSITION_KEY,
)  # fmt: skip
"""Entries that only training needs: the best checkpoint has none of them."""


class WholeCheckpoints(TorchCheckpointIO):
    """Lightning's writer of checkpoints, replaced by one that a kill or a power cut cannot leave a half of.

    `last.ckpt` is renamed to `before_last.ckpt` before a new one takes its place; the best checkpoint is
    written without what only training needs.
    """

    def save_checkpoint(
        self,
        checkpoint: dict[str, Any],
        path: str | Path,
        storage_options: Any | None = None,  # noqa: ANN401  # Lightning's signature
    ) -> None:
        """Write a checkpoint."""
        del storage_options
        path = Path(path)
        if path.name.startswith("best"):
            checkpoint = {
                key: value for key, value in checkpoint.items() if key not in FOR_TRAINING
            }
        write_checkpoint(checkpoint, path)


def write_checkpoint(checkpoint: dict[str, Any], path: Path) -> None:
    """Write a checkpoint to the disk, and only then give it its name.

    Args:
        checkpoint: Contents.
        path: The file; one of the same name is replaced, and kept if it is the last checkpoint.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with replaced_when_whole(path) as unfinished:
        with unfinished.open("wb") as file:
            torch.save(checkpoint, file)
            file.flush()
            os.fsync(file.fileno())
        if path.name == LAST and path.exists():
            os.replace(path, path.with_name(BEFORE_LAST))
    _sync_folder(path.parent)


def damage(path: Path) -> str | None:
    """Describe the damage of a checkpoint's file; None if it is whole.

    Every entry of the file has a checksum (CRC-32), which is computed again.

    Args:
        path: A file that `torch.save` wrote.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            broken = archive.testzip()
    except (zipfile.BadZipFile, EOFError, OSError) as error:
        return f"{path.stat().st_size} bytes: {error}"
    return f"the checksum of {broken} is wrong" if broken else None


def _sync_folder(folder: Path) -> None:
    """Write the names of a folder to the disk, where the system can."""
    if os.name != "posix":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
