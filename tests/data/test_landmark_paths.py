"""Images are found where a landmark file was written on another machine."""

import json
import logging
from pathlib import Path

import pytest

from hand_recon.data.landmarks.image_paths import located_images
from hand_recon.data.landmarks.splits import LandmarkRecipe, LandmarkSplits


def empty(folder: Path, *names: str) -> None:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b"")


@pytest.mark.parametrize(
    "written",
    [
        "set a/0.jpg",
        r"set a\0.jpg",
        r"D:\hands\set a\0.jpg",
        "/home/somebody/hands/set a/0.jpg",
        r"\\server\share\set a\0.jpg",
        "file:///home/somebody/set%20a/0.jpg",
        "https://example.org/hands/set%20a/0.jpg?version=2",
        "/data/local-files/?d=hands/set%20a/0.jpg",
        "./set a/0.jpg",
        "../elsewhere/set a/0.jpg",
        "set a/0.JPG",
        "0.jpg",
    ],
)
def test_an_image_is_found_however_its_path_is_written(
    tmp_path: Path, written: str, caplog: pytest.LogCaptureFixture
) -> None:
    root = tmp_path / "images"
    empty(root, "set a/0.jpg", "set a/1.jpg")
    if written == "0.jpg":
        root = root / "set a"
    with caplog.at_level(logging.INFO):
        (found,) = located_images(tmp_path / "a.json", root, [written])
    assert found is not None
    assert found.resolve() == (tmp_path / "images/set a/0.jpg").resolve()
    direct = (root / written).is_file()
    assert ("1 of 1 images are not at the written path" in caplog.text) != direct


def test_letters_in_another_form_of_unicode_are_the_same(tmp_path: Path) -> None:
    empty(tmp_path, "h\u00e4nde.png")
    (found,) = located_images(tmp_path / "a.json", tmp_path, ["ha\u0308nde.png"])
    assert found is not None
    assert found.is_file()


def test_a_file_at_the_written_path_goes_before_all_others(tmp_path: Path) -> None:
    empty(tmp_path, "0.jpg", "set a/0.jpg", r"set a\0.jpg", "0%20.jpg", "0 .jpg")
    for name in (r"set a\0.jpg", "set a/0.jpg", "0%20.jpg"):
        (found,) = located_images(tmp_path / "a.json", tmp_path, [name])
        assert found == tmp_path / name


def test_two_paths_never_become_one_image(tmp_path: Path) -> None:
    """Without the folders `a` and `b`, `a/0.jpg` and `b/0.jpg` would both be read from `0.jpg`."""
    empty(tmp_path, "0.jpg")
    names = ["/far/a/0.jpg", "/far/b/0.jpg", None]
    assert located_images(tmp_path / "a.json", tmp_path, names) == (
        Path("/far/a/0.jpg"), Path("/far/b/0.jpg"), None,
    )  # fmt: skip
    empty(tmp_path, "a/0.jpg", "b/0.jpg")
    found = located_images(tmp_path / "a.json", tmp_path, names)
    assert found == (tmp_path / "a/0.jpg", tmp_path / "b/0.jpg", None)


@pytest.mark.parametrize("name", ["x" * 5000, "nul\0byte.jpg", "..", "/", "%", "https://", "?d="])
def test_paths_that_no_file_can_have_are_left_as_they_are(tmp_path: Path, name: str) -> None:
    assert located_images(tmp_path / "a.json", tmp_path, [name]) == (tmp_path / name,)


def test_the_error_lists_where_images_were_looked_for(tmp_path: Path) -> None:
    hands = [
        {"landmarks": [[20.0 + n, 30.0] for n in range(21)], "side": "right", "image": name}
        for name in (r"C:\hands\set a\0.jpg", r"C:\hands\set a\1.jpg")
    ]
    path = tmp_path / "labels.json"
    path.write_text(json.dumps(hands))
    with pytest.raises(FileNotFoundError) as error:
        LandmarkSplits(LandmarkRecipe(path, path, path)).dataset("val")
    message = str(error.value)
    assert "None of 2 images is there" in message
    assert str(tmp_path / r"C:\hands\set a\0.jpg") in message
    for place in ("hands/set a/0.jpg", "set a/0.jpg", "0.jpg"):
        assert f"{tmp_path / place}" in message
    assert "Name their folder with data.images" in message
