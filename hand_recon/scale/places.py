"""Images of an input, each by its place: a file, a frame of a video, or a row of a Parquet file.

Places are small: a table of a million of them fits into the memory of the process that plans, and each worker
reads the pixels itself.
"""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hand_recon.data.photos.formats import PhotoError, shown
from hand_recon.data.photos.listing import photo_files
from hand_recon.runs.unfinished import file_state
from hand_recon.scale.extra import arrow_module, parquet_module
from hand_recon.scale.given_tables import given_tables
from hand_recon.scale.lerobot import INFO, LeRobotFrames, frames_of_dataset

IMAGE_COLUMNS = ("image", "image_path", "path", "file", "file_name", "img", "picture")
"""Names by which a Parquet file's column of images is recognised, first to last."""


@dataclass(frozen=True)
class Places:
    """The images of an input, in order."""

    table: Any
    """pyarrow.Table with `path`, `position` and further columns, which the results keep."""
    column: str | None
    """Column of the images in Parquet files; None for other files."""
    files: tuple[Path, ...]
    """All files that are read."""

    def __len__(self) -> int:
        return int(self.table.num_rows)

    def state(self) -> dict[str, Any]:
        """Number and digest of the places and of the states of their files, which tell a changed input."""
        digest = hashlib.sha256()
        for path in self.files:
            digest.update(json.dumps(file_state(path)).encode())
        for batch in self.table.to_batches():
            digest.update(json.dumps(batch.to_pydict()).encode())
        return {"images": len(self), "column": self.column, "digest": digest.hexdigest()}


def places_of(inputs: Sequence[str], column: str | None, output: Path | None = None) -> Places:
    """Find the images of an input.

    Args:
        inputs: Photographs and folders of them, or Parquet files and folders of them, or one folder of a
            LeRobot dataset.
        column: Column of the images of Parquet files, or camera of a LeRobot dataset; None to recognise it.
        output: Folder of the results, whose part files are no input; None if there is none.

    Raises:
        ValueError: There is no image, or the column is not clear, or photographs and tables are mixed.
    """
    paths = [Path(one).expanduser() for one in inputs]
    datasets = [path for path in paths if (path / INFO).is_file()]
    if datasets:
        if len(paths) > 1:
            raise ValueError(
                f"Found the LeRobot dataset {shown(datasets[0])} and {len(paths) - 1} more input(s); "
                "expected one dataset alone. Run the command for each."
            )
        return _of_lerobot(frames_of_dataset(datasets[0], column))
    if tables := given_tables(paths, output):
        return _of_parquet(tables, column)
    if column is not None:
        raise ValueError(
            f"Found column={column} and photographs; expected it beside Parquet files or a LeRobot dataset. "
            "Leave it out."
        )
    return _of_files(photo_files(inputs))


def _of_files(files: Sequence[Path]) -> Places:
    arrow = arrow_module()
    names = [shown(path.absolute()) for path in files]
    table = arrow.table({"path": names, "position": arrow.nulls(len(names), arrow.int64())})
    return Places(table, None, tuple(files))


def _of_parquet(files: Sequence[Path], column: str | None) -> Places:
    arrow = arrow_module()
    paths: list[str] = []
    rows: list[int] = []
    for file in files:
        try:
            known = parquet_module().ParquetFile(file)
        except (OSError, ValueError) as error:
            raise PhotoError(
                f"{shown(file)} cannot be read as Parquet ({error}). Copy it again."
            ) from error
        with known:
            column = _image_column(file, known.schema_arrow, column)
            count = known.metadata.num_rows
        paths += [shown(file.absolute())] * count
        rows += range(count)
    table = arrow.table({"path": paths, "position": arrow.array(rows, arrow.int64())})
    return Places(table, column, tuple(files))


def _image_column(file: Path, schema: Any, column: str | None) -> str:  # noqa: ANN401
    names = list(schema.names)
    known = [name for name in IMAGE_COLUMNS if name in names]
    structs = [
        name
        for name in names
        if arrow_module().types.is_struct(schema.field(name).type)
        and {"bytes", "path"} & {field.name for field in schema.field(name).type}
    ]
    found = column or next(iter([*structs, *known]), None)
    if found is None or found not in names:
        named = "none of the usual names" if column is None else f"no column {column}"
        raise ValueError(
            f"{shown(file)} has the columns {', '.join(names)}, {named}; expected one of images: bytes, "
            "names of files, or structs of bytes and path. Name it with column=<name>."
        )
    return found


def _of_lerobot(frames: LeRobotFrames) -> Places:
    arrow = arrow_module()
    table = arrow.table(
        {
            "path": frames.paths,
            "position": arrow.array(frames.positions, arrow.int64()),
            "episode_index": arrow.array(frames.episodes, arrow.int64()),
            "frame_index": arrow.array(frames.frames, arrow.int64()),
            "timestamp": arrow.array(frames.times, arrow.float64()),
        }
    )
    return Places(table, frames.column, tuple(Path(one) for one in dict.fromkeys(frames.paths)))
