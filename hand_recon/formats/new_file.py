"""Files that are written once and never replaced."""

from collections.abc import Iterable
from pathlib import Path


def write_new(path: str | Path, content: bytes) -> Path:
    """Write a file that does not exist yet; folders are made.

    Args:
        path: The file.
        content: All of its bytes.

    Raises:
        FileExistsError: There is a file or folder of that name.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        with path.open("xb") as stream:
            stream.write(content)
    except FileExistsError as error:
        raise FileExistsError(_exists(path)) from error
    return path


def free_place(path: str | Path) -> Path:
    """Check that nothing stands at the place of a file that another library will write, and make its folder.

    Args:
        path: The file.

    Raises:
        FileExistsError: There is a file or folder of that name.
    """
    path = Path(path)
    refuse_existing([path])
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


def refuse_existing(paths: Iterable[Path]) -> None:
    """Check that nothing stands at the places of files that another library will write.

    Args:
        paths: The files.

    Raises:
        FileExistsError: There is a file or folder of one of these names.
    """
    for path in paths:
        # A link to nowhere is a file of the user, too.
        if path.exists() or path.is_symlink():
            raise FileExistsError(_exists(path))


def _exists(path: Path) -> str:
    return f"{path} exists and is not overwritten; name another file or remove it."
