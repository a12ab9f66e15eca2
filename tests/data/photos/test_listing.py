"""Files, folders and patterns become photographs in a natural order, each once."""

import logging
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from hand_recon.data.photos.formats import PhotoError
from hand_recon.data.photos.listing import natural_order, photo_files


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Three photographs, one of them without a suffix, among files of other kinds."""
    place = tmp_path / "DCIM"
    (place / "100CAMERA").mkdir(parents=True)
    (place / ".thumbnails").mkdir()
    for name in ("img10.jpg", "Img2.jpg", "100CAMERA/photo", ".thumbnails/img2.jpg", ".hidden.png"):
        Image.new("RGB", (4, 4)).save(place / name, "PNG")
    (place / "film.mp4").write_bytes(b"\0\0\0\x18ftypisom")
    (place / "img2.dng").write_bytes(b"II*\0\x08\0\0\0")
    (place / "notes.txt").write_text("hands")
    (place / "hands.json").write_text("{}")
    return place


def names(paths: list[Path], base: Path) -> list[str]:
    return [path.relative_to(base).as_posix() for path in paths]


def test_a_folder_gives_its_photographs_in_natural_order_and_counts_the_rest(
    folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.INFO):
        found = photo_files([folder])
    assert names(found, folder) == ["100CAMERA/photo", "Img2.jpg", "img10.jpg"]
    assert caplog.messages == [
        "Left out of the folders: 2 hidden, 2 other files, 1 raw files, 1 videos."
    ]


def test_a_damaged_photograph_in_a_folder_is_kept_so_that_it_is_reported(folder: Path) -> None:
    (folder / "empty.JPG").write_bytes(b"")
    (folder / "page.jpg").write_text("<html>")
    assert {"empty.JPG", "page.jpg"} <= set(names(photo_files([folder]), folder))


def test_a_file_that_is_named_is_kept_whatever_it_is(folder: Path) -> None:
    named = [folder / "notes.txt", folder / ".hidden.png"]
    assert photo_files(named) == named


def test_arguments_keep_their_order_and_each_file_comes_once(folder: Path) -> None:
    found = photo_files(
        [folder / "img10.jpg", str(folder), folder / "100CAMERA" / ".." / "Img2.jpg"]
    )
    assert names(found, folder) == ["img10.jpg", "100CAMERA/photo", "Img2.jpg"]


def test_a_link_to_a_photograph_is_the_same_photograph(folder: Path) -> None:
    try:
        (folder / "again.jpg").symlink_to(folder / "img10.jpg")
        (folder / "100CAMERA" / "loop").symlink_to(folder)
        (folder / "gone.txt").symlink_to(folder / "nothing")
    except OSError:
        pytest.skip("links cannot be made here")
    assert names(photo_files([folder]), folder) == ["100CAMERA/photo", "again.jpg", "Img2.jpg"]


def test_a_pattern_is_expanded_unless_a_file_has_that_name(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    assert photo_files(["*.jpg"]) == [Path("Img2.jpg"), Path("img10.jpg")]
    assert photo_files(["**/ph*"]) == [Path("100CAMERA/photo")]
    assert photo_files(["[0-9]*"]) == [Path("100CAMERA/photo")]
    Image.new("RGB", (4, 4)).save("hand[1].jpg")
    assert photo_files(["hand[1].jpg"]) == [Path("hand[1].jpg")]


def test_what_is_not_there_is_an_error(folder: Path) -> None:
    with pytest.raises(PhotoError, match=r"none\.jpg does not exist; expected a file"):
        photo_files([folder / "none.jpg"])
    with pytest.raises(PhotoError, match="matches no file"):
        photo_files([folder / "*.heic"])
    with pytest.raises(PhotoError, match="Found no photograph in an empty list"):
        photo_files([])
    (folder / "empty").mkdir()
    with pytest.raises(PhotoError, match=r"Found no photograph in .*empty"):
        photo_files([folder / "empty"])


def test_a_name_that_is_no_text_is_found(tmp_path: Path) -> None:
    name = os.fsdecode(b"h\xe4nd.jpg")
    try:
        Image.new("RGB", (4, 4)).save(tmp_path / name, "JPEG")
    except OSError:
        pytest.skip("this file system has only names of text")
    assert [path.name for path in photo_files([tmp_path])] == [name]


@given(st.lists(st.text(st.characters(exclude_characters="/\0"), min_size=1), max_size=6))
def test_any_names_can_be_compared(parts: list[str]) -> None:
    keys = [natural_order(Path(part)) for part in parts]
    assert all(
        (first < second) + (first > second) + (first == second) == 1
        for first in keys
        for second in keys
    )


def test_numbers_count_as_numbers_at_every_place() -> None:
    ordered = [
        "2/b9.jpg",
        "2/b10.jpg",
        "10/a1.jpg",
        "a.jpg",
        "a1.jpg",
        "A02.jpg",
        "a3x7.jpg",
        "a3x10.jpg",
    ]
    shuffled = sorted(map(Path, ordered), key=str)
    assert [path.as_posix() for path in sorted(shuffled, key=natural_order)] == ordered
