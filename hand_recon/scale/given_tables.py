"""Parquet files of an input; results of this program in its folders are no input."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from hand_recon.data.photos.formats import PHOTO_SUFFIXES, kind_of_file, shown
from hand_recon.data.photos.listing import natural_order
from hand_recon.runs.unfinished import MARK
from hand_recon.scale.parts import MANIFEST, PARTS

_TABLE: Final = ".parquet"
_OURS: Final = '"rows_of_a_part"'
"""Entry that tells `manifest.json` of this program from those of others."""


def given_tables(inputs: Sequence[Path], output: Path | None) -> list[Path]:
    """Find the Parquet files of an input.

    In folders, hidden files, those whose names begin with `_`, and folders of results of this program are
    left out.

    Args:
        inputs: Files and folders.
        output: Folder of the results of this command; None if there is none.

    Returns:
        The files, in natural order within each input; none if the input is photographs.

    Raises:
        ValueError: There are photographs, too.
    """
    tables = [file for path in inputs for file in _tables_of(path, output)]
    photo = next((file for path in inputs for file in _others_of(path)), None) if tables else None
    if photo is not None:
        raise ValueError(
            f"Found the Parquet file {shown(tables[0])} and {shown(photo)}; expected either Parquet files "
            "or photographs, since their results are different tables. Run the command for each, and name "
            "the Parquet file itself, or the photographs by a pattern such as 'photos/*.jpg'."
        )
    return tables


def _tables_of(path: Path, output: Path | None) -> list[Path]:
    if not path.is_dir():
        return [path] if path.suffix.lower() == _TABLE else []
    found = [
        file
        for file in _below(path)
        if file.suffix.lower() == _TABLE and not file.name.startswith("_")
    ]
    results = {folder for file in found for folder in file.parents if _is_below(folder, path)}
    left_out = {folder for folder in results if _has_results(folder)}
    if output is not None:
        left_out |= {folder for folder in results if folder.absolute() == output / PARTS}
    return sorted(
        (file for file in found if not left_out.intersection(file.parents)), key=natural_order
    )


def _others_of(path: Path) -> Iterator[Path]:
    """Photographs, and whatever else is named."""
    if not path.is_dir():
        if path.suffix.lower() != _TABLE:
            yield path
        return
    yield from (file for file in _below(path) if _is_photo(file))


def _below(folder: Path) -> Iterator[Path]:
    """Files of a folder that are not hidden, in no order."""
    for file in folder.rglob("*"):
        hidden = any(part.startswith(".") for part in file.relative_to(folder).parts)
        if not hidden and not file.is_dir():
            yield file


def _is_below(folder: Path, above: Path) -> bool:
    return folder != above and folder.is_relative_to(above)


def _has_results(folder: Path) -> bool:
    """True for a folder of results of this program, complete or not."""
    if (folder / MARK).is_file():
        return True
    manifest = folder / MANIFEST
    return manifest.is_file() and _OURS in manifest.read_text(encoding="utf-8", errors="replace")


def _is_photo(file: Path) -> bool:
    suffix = file.suffix.lower()
    if suffix == _TABLE or not file.is_file():
        return False
    if suffix in PHOTO_SUFFIXES:
        return True
    try:
        return kind_of_file(file).is_photo
    except OSError:
        return False
