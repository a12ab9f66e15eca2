"""Images of columns: files, bytes, arrays, frames of videos and rows of Parquet files."""

from pathlib import Path

import numpy as np
import pytest

from hand_recon.data.photos.photo import read_photo, read_photo_bytes
from hand_recon.data.video.files import video_file
from hand_recon.scale.readers import FrameReader, ImageReader
from tests.support.photos import corners
from tests.support.video_files import number_of, write_clip

PHOTO = Path("examples/hand.jpg")


def test_bytes_are_read_as_their_file_is() -> None:
    from_file, from_bytes = read_photo(PHOTO), read_photo_bytes(PHOTO.read_bytes(), PHOTO)
    np.testing.assert_array_equal(from_bytes.pixels, from_file.pixels)
    assert (from_bytes.path, from_bytes.focal_px) == (from_file.path, from_file.focal_px)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (PHOTO.read_bytes()[:300], "table.jpg is a cut off JPEG"),
        (b"", "It is empty"),
        (b"GIF89a", "GIF"),
    ],
)
def test_damaged_bytes_are_refused_with_their_name(content: bytes, told: str) -> None:
    with pytest.raises(ValueError, match=told):
        read_photo_bytes(content, "table.jpg")


def test_the_values_of_a_column_are_one_image_in_many_forms() -> None:
    read, pixels = ImageReader(), read_photo(PHOTO).pixels
    content = PHOTO.read_bytes()
    forms = (
        str(PHOTO), f"file://{PHOTO.absolute()}", content, pixels, {"bytes": content, "path": "a.jpg"},
        {"bytes": None, "path": str(PHOTO)}, {"path": str(PHOTO), "position": None, "column": None},
    )  # fmt: skip
    for form in forms:
        np.testing.assert_array_equal(read(form).pixels, pixels)


@pytest.mark.parametrize(
    ("value", "told"),
    [
        (None, "The image is null; expected a file's name"),
        ({"bytes": None, "path": None}, "The image is null"),
        (3.5, "of the type float"),
        ("s3://bucket/a.jpg", r"url\.download"),
        ("gone.jpg", "No file at gone.jpg"),
        (corners()[..., 0], r"shape \(32, 48\).*mode='RGB'"),
        (corners().astype(float), "type float64"),
        ({"path": "gone.mp4", "position": 3}, "No file at gone.mp4"),
        ({"path": "gone.parquet", "position": 3, "column": "image"}, "cannot be read as Parquet"),
    ],
)
def test_what_is_no_image_is_told(value: object, told: str) -> None:
    pytest.importorskip("pyarrow")
    with pytest.raises(ValueError, match=told):
        ImageReader()(value)


def test_frames_are_those_of_their_numbers_in_any_order(tmp_path: Path) -> None:
    path = write_clip(tmp_path / "clip.mp4", 12)
    expected = [frame.pixels for frame in video_file(path).frames()]
    read = FrameReader()
    for number in (0, 1, 5, 4, 11, 0, 7):
        pixels = read(str(path), number)
        np.testing.assert_array_equal(pixels, expected[number])
        assert number_of(pixels) == number
    with pytest.raises(ValueError, match="has 12 frames, and frame 12 is asked for"):
        read(str(path), 12)
    assert number_of(read(str(path), 3)) == 3
    read.close()


def test_frames_in_order_are_decoded_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_clip(tmp_path / "clip.mp4", 6)
    opened: list[str] = []
    read = FrameReader()
    monkeypatch.setattr(FrameReader, "_open", counted(FrameReader._open, opened))
    for number in range(6):
        read(str(path), number)
    assert len(opened) == 1
    read(str(path), 2)
    assert len(opened) == 2
    read.close()


def counted(function: object, calls: list[str]) -> object:
    def wrapper(self: FrameReader, path: str) -> None:
        calls.append(path)
        function(self, path)  # type: ignore[operator]

    return wrapper


def test_a_video_that_is_none_is_refused(tmp_path: Path) -> None:
    (tmp_path / "text.mp4").write_text("no video")
    with pytest.raises(ValueError, match="no video track that can be read"):
        FrameReader()(str(tmp_path / "text.mp4"), 0)


def test_rows_of_a_table_are_those_of_their_numbers(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    from tests.support.lerobot_folder import write_images

    path = write_images(tmp_path / "images.parquet", 10, "photo", group=4)
    read = ImageReader()
    for row in (0, 3, 4, 9, 8, 1):
        place = {"path": str(path), "position": row, "column": "photo"}
        assert number_of(read(place).pixels) == row
    with pytest.raises(ValueError, match="has 10 rows, and row 10 is asked for"):
        read({"path": str(path), "position": 10, "column": "photo"})


def test_a_column_of_names_is_read_beside_its_table(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    import pyarrow.parquet

    (tmp_path / "hand.jpg").write_bytes(PHOTO.read_bytes())
    table = pyarrow.table({"file": ["hand.jpg", None]})
    pyarrow.parquet.write_table(table, tmp_path / "names.parquet")
    read, place = ImageReader(), {"path": str(tmp_path / "names.parquet"), "column": "file"}
    np.testing.assert_array_equal(read({**place, "position": 0}).pixels, read_photo(PHOTO).pixels)
    with pytest.raises(ValueError, match="The image is null"):
        read({**place, "position": 1})
