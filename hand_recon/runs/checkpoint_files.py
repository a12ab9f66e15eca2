"""Places of checkpoints. Apart from their reader, which imports Lightning."""

from pathlib import Path


def checkpoint_at(path: str | Path) -> Path:
    """File of a checkpoint, which need not exist: the path itself, or the best checkpoint of a run's folder.

    Args:
        path: A file, or a run's folder.
    """
    path = Path(path).expanduser()
    return path / "checkpoints" / "best.ckpt" if path.is_dir() else path
