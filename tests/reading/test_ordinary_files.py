"""Text is read from ordinary files, also through a descriptor as `/dev/stdin` is one; never from pipes."""

import os
from pathlib import Path

import pytest

from hand_recon.reading.text import read_bytes, read_text


def test_a_pipe_and_a_device_are_refused_without_reading_them() -> None:
    """A pipe may never end; this one would."""
    reading, writing = os.pipe()
    os.write(writing, b"{}")
    os.close(writing)
    try:
        for path in (Path(f"/dev/fd/{reading}"), Path(os.devnull)):
            with pytest.raises(
                ValueError,
                match=rf"^{path} is a pipe or a device; expected an ordinary file\. Save",
            ):
                read_bytes(path)
        assert os.read(reading, 9) == b"{}"
    finally:
        os.close(reading)


def test_a_file_is_read_through_its_descriptor(tmp_path: Path) -> None:
    """`hand-recon fit /dev/stdin < file` has such a path."""
    (tmp_path / "a.json").write_text("[1]")
    with (tmp_path / "a.json").open() as stream:
        assert read_text(Path(f"/dev/fd/{stream.fileno()}")) == "[1]"
