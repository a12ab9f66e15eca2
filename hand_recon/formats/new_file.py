"""Files that are written once and never replaced."""

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
        raise FileExistsError(
            f"{path} exists and is not overwritten; name another file or remove it."
        ) from error
    return path
