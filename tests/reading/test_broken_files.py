"""Every reader of files from elsewhere × every way in which a file can be broken (decision 92).

A cell demands an error that the command line shows without a traceback and that names the file, or, where a
value may be missing, labels without zeros.
"""

import shutil
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
import pytest

from hand_recon.command_line.user_errors import USER_ERRORS
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from tests.support.broken_files import CONTENTS, PLACES, unreadable, with_nan
from tests.support.file_readers import READERS as TEXTS
from tests.support.file_readers import FileReader
from tests.support.label_faults import fault_of_labels, zeros_in
from tests.support.network_readers import READERS as NETWORKS

READERS: Final = TEXTS | NETWORKS
ACCEPTED: Final = {
    ("landmarks, openpose", "1e400"): "a point of the body, which is not read",
    ("landmarks, openpose", "one number less"): "a point of the body",
    ("landmarks, openpose", "NaN"): "a point of the body",
    ("landmarks, deeplabcut", "NaN"): "a landmark that is missing",
    ("landmarks, yolo", "a huge number"): "the box, which is not read",
    ("hands, lines", "empty"): "a clip without hands",
    ("audit, table", "no UTF-8"): "a cell that is no number is a point that is missing",
    ("audit, table", "NaN"): "a point that is missing",
    ("audit, records", "NaN"): "a point that is missing",
    ("audit, lists", "NaN"): "a point that is missing",
    ("metrics", "1e400"): "a score that is not finite, which is left out",
    ("metrics", "NaN"): "a score that is not finite",
    ("settings", "a huge number"): "settings are text in tables",
    ("settings", "1e400"): "text",
    ("settings", "NaN"): "text",
    ("errors", "missing"): "an optional file",
    ("errors", "folder"): "an optional file",
    ("errors", "loop"): "an optional file",
    ("errors", "NaN"): "a hand without this error",
    ("size of an image", "cut off"): "the header is whole",
    ("animation", "cut off"): "the frames that are there are read, with a warning",
}
"""Cells that are read, with the reason."""

UNNAMED: Final = {("HInt", "missing"): "the folder is named, since nothing tells what was in it"}
"""Cells whose error names something else, with the reason."""

CHANGES: Final = {**CONTENTS, "NaN": with_nan}


@pytest.fixture
def folder() -> Iterator[Path]:
    """A folder that every user may look into, unlike pytest's."""
    place = Path(tempfile.mkdtemp())
    place.chmod(0o755)
    yield place
    shutil.rmtree(place)


@cache
def valid(reader: FileReader) -> bytes:
    """Content of a valid file, made once."""
    return reader.content()


def written(reader: FileReader, folder: Path) -> Path:
    """A valid file with all that belongs to it."""
    path = folder / reader.place
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(valid(reader))
    reader.beside(path)
    return path


def outcome(reader: FileReader, path: Path) -> tuple[str, object]:
    """The message of the refusal, or "" and what was read."""
    try:
        return "", reader.read(path)
    except USER_ERRORS as error:
        return str(error), None


def mistakes(reader: FileReader, cell: str, path: Path) -> list[str]:
    """Lines about what is wrong with the outcome of a cell; none if it is as it should be."""
    refusal, found = outcome(reader, path)
    cell_name = f"{reader.name} with {cell}"
    if (reader.name, cell) in ACCEPTED:
        wrong = refusal or fault_of_labels(found)
        return [f"{cell_name}: {wrong}"] if wrong else []
    if not refusal:
        return [f"{cell_name} was read: {found!r:.300}"]
    named = path.name in refusal or (reader.name, cell) in UNNAMED
    return [] if named and len(refusal) < 2000 else [f"{cell_name}: {refusal[:300]}"]


@pytest.mark.parametrize("name", READERS)
def test_a_valid_file_with_an_unusual_name_is_read_and_one_without_permission_is_refused(
    folder: Path, name: str
) -> None:
    reader = READERS[name]
    path = written(reader, folder)
    assert outcome(reader, path)[0] == ""
    if name == "errors":
        return
    with unreadable(path):
        assert not mistakes(reader, "unreadable", path)


@pytest.mark.parametrize("name", READERS)
def test_what_is_in_the_place_of_a_file_is_refused(folder: Path, name: str) -> None:
    found = []
    for place, put in PLACES.items():
        path = written(READERS[name], folder / place)
        put(path)
        found += mistakes(READERS[name], place, path)
    assert not found, "\n".join(found)


@pytest.mark.parametrize("name", READERS)
def test_a_broken_file_is_refused_by_name(tmp_path: Path, name: str) -> None:
    reader = READERS[name]
    changed = {change: make(valid(reader), reader.kind) for change, make in CHANGES.items()}
    found = []
    for change, content in changed.items():
        if content is not None:
            path = written(reader, tmp_path / change.replace(" ", "_"))
            path.write_bytes(content)
            found += mistakes(reader, change, path)
    assert sum(content is not None for content in changed.values()) >= 3
    assert not found, "\n".join(found)


def test_the_tables_of_exceptions_name_cells_that_exist() -> None:
    cells = {(name, cell) for name in READERS for cell in (*PLACES, *CHANGES)}
    assert {*ACCEPTED, *UNNAMED} <= cells


def test_a_label_of_zero_would_be_seen() -> None:
    points = np.random.default_rng(0).uniform(1, 9, (1, 21, 2))
    path = Path(tempfile.mkdtemp()) / "a.json"
    path.write_text(str(points.tolist()))
    found = TEXTS["landmarks"].read(path)
    assert isinstance(found, ImageLandmarks)
    assert fault_of_labels(found) == ""
    found.landmarks_2d[0, 3, 1] = 0
    assert fault_of_labels(found) == "a label of zero"
    assert fault_of_labels(found, zeros_in(b"[1, -0.0, 20, a0, 0.5]")) == ""
    found.labelled[0, 3] = False
    assert fault_of_labels(found, 1) == "a missing label that is a number"
    found.landmarks_2d[0, 3] = np.inf
    assert fault_of_labels(found, 9) == "an infinite label"
