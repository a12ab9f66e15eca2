"""Images as columns hold them: files, bytes, arrays, and places in videos and Parquet files."""

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8

from hand_recon.data.photos.formats import PhotoError
from hand_recon.data.photos.photo import Photo, read_photo, read_photo_bytes
from hand_recon.data.video.capture import Capture, grabbed, open_capture, pixels_of
from hand_recon.runs.looking import photo_of_array
from hand_recon.scale.extra import parquet_module


class ImageReader:
    """Reads the images of a column; the video and the Parquet file that were read last stay open."""

    def __init__(self) -> None:
        self.frames = FrameReader()
        self.rows = RowReader()

    def __call__(self, value: object) -> Photo:
        """Read one image.

        Args:
            value: A file's name; the bytes of a file; an RGB array; a struct of `bytes` and `path`, as
                datasets of images have it; or a place: a struct of `path`, `position` and, for a Parquet
                file, `column`.

        Raises:
            ValueError: It is none of these, or cannot be read; the message says what to do.
        """
        if isinstance(value, Mapping):
            return self._of_struct(value)
        if isinstance(value, bytes):
            return read_photo_bytes(value, "The image")
        if isinstance(value, str):
            return read_photo(_local(value))
        if isinstance(value, np.ndarray):
            return photo_of_array(_checked(value))
        found = "null" if value is None else f"of the type {type(value).__name__}"
        raise PhotoError(
            f"The image is {found}; expected a file's name, the bytes of a file, or an RGB array "
            "(df['image'].decode_image(mode='RGB'))."
        )

    def _of_struct(self, value: Mapping[str, Any]) -> Photo:
        path, position = value.get("path"), value.get("position")
        if position is None:
            content = value.get("bytes")
            if content is not None:
                return read_photo_bytes(content, path or "The image")
            return self(path)
        if Path(path or "").suffix.lower() == ".parquet":
            stored = self.rows(Path(str(path)), position, str(value.get("column")))
            if isinstance(stored, str):
                return read_photo(Path(str(path)).parent / _local(stored))
            return self(stored)
        return photo_of_array(self.frames(str(path), position))


def _local(name: str) -> Path:
    """A file of this machine.

    Raises:
        PhotoError: It is an address of another one.
    """
    scheme, mark, rest = name.partition("://")
    if mark and scheme != "file":
        raise PhotoError(
            f"{name} is an address; expected a file of this machine or its bytes. Let Daft fetch it: "
            "df['image'].url.download()."
        )
    return Path(rest if mark else name)


def _checked(pixels: np.ndarray) -> UInt8[np.ndarray, "height width 3"]:
    if pixels.ndim != 3 or pixels.shape[2] != 3 or pixels.dtype != np.uint8 or not pixels.size:
        raise PhotoError(
            f"An image has the shape {pixels.shape} and the type {pixels.dtype}; expected height × width × 3 "
            "in bytes (uint8), RGB: decode it with mode='RGB'."
        )
    return np.ascontiguousarray(pixels)


class FrameReader:
    """Frames of videos by their numbers; those in order are decoded once."""

    def __init__(self) -> None:
        self.path = ""
        self.capture: Capture | None = None
        self.next = 0

    def __call__(self, path: str, number: int) -> UInt8[np.ndarray, "height width 3"]:
        """Decode one frame, RGB.

        Args:
            path: The video.
            number: Number of the frame, from 0.

        Raises:
            ValueError: The video cannot be read, or ends before.
        """
        if self.capture is None or path != self.path or number < self.next:
            self._open(path)
        capture = self.capture
        if capture is None:
            raise AssertionError
        while self.next <= number:
            if not grabbed(capture):
                end = self.next
                self.close()
                raise PhotoError(
                    f"{path} has {end} frames, and frame {number} is asked for; expected one of the first "
                    f"{end}. The video was cut off, or belongs to another table: copy it again."
                )
            self.next += 1
        pixels = pixels_of(capture)
        if pixels is None:
            raise PhotoError(f"Frame {number} of {path} cannot be decoded. Copy the video again.")
        return pixels

    def _open(self, path: str) -> None:
        self.close()
        if not Path(path).is_file():
            raise PhotoError(f"No file at {path}; expected a video. Copy the dataset again.")
        capture = open_capture(path)
        if not capture.isOpened():
            capture.release()
            raise PhotoError(f"{path} has no video track that can be read. Copy the dataset again.")
        self.path, self.capture, self.next = path, capture, 0

    def close(self) -> None:
        """Close the video."""
        if self.capture is not None:
            self.capture.release()
        self.path, self.capture, self.next = "", None, 0


class RowReader:
    """Values of a column of Parquet files by the numbers of their rows, a row group at a time."""

    def __init__(self) -> None:
        self.place: tuple[Path, str] | None = None
        self.file: Any = None
        self.ends: list[int] = []
        self.group = -1
        self.values: Any = None

    def __call__(self, path: Path, row: int, column: str) -> Any:  # noqa: ANN401  # any value
        """Read one value.

        Args:
            path: The file.
            row: Number of the row, from 0.
            column: The column.

        Raises:
            ValueError: The file cannot be read, or has no such row.
        """
        if self.place != (path, column):
            self._open(path, column)
        group = int(np.searchsorted(self.ends, row, side="right"))
        if group >= len(self.ends):
            raise PhotoError(
                f"{path} has {self.ends[-1] if self.ends else 0} rows, and row {row} is asked for. The file "
                "was changed: start again with another folder."
            )
        if group != self.group:
            self.values = self.file.read_row_group(group, columns=[column]).column(0)
            self.group = group
        start = self.ends[group - 1] if group else 0
        return self.values[row - start].as_py()

    def _open(self, path: Path, column: str) -> None:
        if self.file is not None:
            with suppress(OSError):
                self.file.close()
        self.place, self.group = None, -1
        try:
            self.file = parquet_module().ParquetFile(path)
        except (OSError, ValueError) as error:
            raise PhotoError(
                f"{path} cannot be read as Parquet ({error}). Copy it again."
            ) from error
        known = self.file.metadata
        sizes = [known.row_group(group).num_rows for group in range(known.num_row_groups)]
        self.ends = np.cumsum(sizes).astype(int).tolist()
        self.place = (path, column)
