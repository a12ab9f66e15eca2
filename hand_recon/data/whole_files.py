"""Files that are complete or absent, also after a kill."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def replaced_when_whole(path: Path) -> Iterator[Path]:
    """Path to write to in the place of a file, which is replaced at the end of the block.

    After an error, what was written stays there, under the file's name with `.part`.

    Args:
        path: The file.
    """
    unfinished = path.with_name(f"{path.name}.part")
    yield unfinished
    os.replace(unfinished, path)
