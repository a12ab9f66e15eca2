"""Manifests are equal for copies of the same data, and differ for other names, sizes and contents."""

import os
import shutil
from pathlib import Path

import pytest

from hand_recon.runs.provenance import data_files, data_manifest
from hand_recon.runs.provenance.data_manifest import data_manifests, manifest


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    root = tmp_path / "data"
    (root / "images").mkdir(parents=True)
    for number in range(300):
        (root / "images" / f"{number:03d}.jpg").write_bytes(bytes([number % 251]) * (number + 1))
    (root / "labels.json").write_text('{"a": 1}')
    return root


def digests(path: Path) -> dict[str, object]:
    """A manifest without its path."""
    found = manifest(path)
    found.pop("path")
    return found


def test_a_copy_with_other_times_has_the_same_manifest(dataset: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(dataset, copy)
    os.utime(copy / "labels.json", (0, 0))
    assert digests(copy) == digests(dataset)
    assert digests(dataset)["files"] == 301
    assert digests(dataset)["bytes"] == sum(range(1, 301)) + 8
    # All of the annotations, and 64 of the 300 images.
    assert digests(dataset)["files_read"] == 65


@pytest.mark.parametrize("change", ["annotation", "size", "name", "gone", "sampled image"])
def test_each_change_of_the_data_is_seen(dataset: Path, change: str) -> None:
    before = digests(dataset)
    image = dataset / "images" / "000.jpg"
    if change == "annotation":
        (dataset / "labels.json").write_text('{"a": 2}')
    elif change == "size":
        (dataset / "images" / "299.jpg").write_bytes(b"longer" * 100)
    elif change == "name":
        image.rename(image.with_name("x.jpg"))
    elif change == "gone":
        image.unlink()
    else:
        image.write_bytes(b"?")
    assert digests(dataset) != before


def test_of_a_large_file_among_many_bytes_three_pieces_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(data_manifest, "PIECE", 10)
    monkeypatch.setattr(data_manifest, "MOST_BYTES", 50)
    file = tmp_path / "large.bin"
    content = bytearray(100)
    seen = []
    for place in (0, 25, 50, 75, 99):
        file.write_bytes(content)
        before = digests(file)
        content[place] = 1
        file.write_bytes(content)
        seen.append(digests(file) != before)
    # Bytes 0 to 9, 45 to 54 and 90 to 99.
    assert seen == [True, False, True, False, True]


def test_hidden_files_and_links_to_nowhere_do_not_count(dataset: Path) -> None:
    before = digests(dataset)
    (dataset / ".cache").write_text("x")
    (dataset / "link.jpg").symlink_to(dataset / "nowhere.jpg")
    assert digests(dataset) == before


def test_the_data_are_those_that_settings_name(dataset: Path) -> None:
    labels = str(dataset / "labels.json")
    config = {
        "data": {"root": str(dataset), "parts": {"photographs": {"train": labels, "images": None}}},
        "photos": {"train": "???", "images": None},
        "model": {"encoder": {"weights": "imagenet"}},
        "paths": {"output": str(dataset)},
        "start_from": "none",
    }
    found = data_manifests(config)
    assert found.keys() == {
        "data.root", "data.parts.photographs.train", "data.parts.photographs.images",
    }  # fmt: skip
    # Images lie beside the file of their landmarks; the file itself is another entry.
    assert found["data.parts.photographs.images"]["files"] == 300
    assert found["data.parts.photographs.train"]["files"] == 1


def test_lists_patterns_and_urls_have_entries(dataset: Path) -> None:
    labels, images = dataset / "labels.json", dataset / "images"
    url = "https://example.org/shards.json"
    config = {
        "data": {"train": f"{images}/00?.jpg", "val": [str(labels), f"{dataset}/*", url, 3]},
        "start_from": f"{dataset}/nothing*",
    }
    found = data_manifests(config)
    assert found.keys() == {"data.train", "data.val.0", "data.val.1", "data.val.2"}
    assert (found["data.train"]["files"], found["data.train"]["path"]) == (10, str(images))
    assert found["data.val.0"] == manifest(labels)
    # All that the pattern matches is all that the folder has.
    assert found["data.val.1"] == manifest(dataset)
    assert found["data.val.2"] == {"url": url}
    (images / "003.jpg").write_bytes(b"!!!!")
    assert data_manifests(config)["data.train"]["contents"] != found["data.train"]["contents"]


def test_links_above_and_pipes_are_left_out(dataset: Path, tmp_path: Path) -> None:
    before = digests(dataset)
    (dataset / "images" / "above").symlink_to(dataset)
    (dataset / "images" / "itself").symlink_to(dataset / "images" / "itself")
    os.mkfifo(dataset / "pipe.json")
    assert digests(dataset) == before
    (dataset / "images" / "linked.jpg").symlink_to(dataset / "labels.json")
    assert digests(dataset)["files"] == 302
    assert data_manifests({"train": str(dataset / "pipe.json"), "images": None}) == {}


def test_a_folder_that_cannot_be_read_is_counted(
    dataset: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "unreadable_folders" not in digests(dataset)
    listed = os.listdir

    def refusing(folder: str) -> list[str]:
        if folder.endswith("images"):
            raise PermissionError(folder)
        return listed(folder)

    monkeypatch.setattr(os, "listdir", refusing)
    found = digests(dataset)
    assert (found["files"], found["unreadable_folders"]) == (1, 1)


def test_a_huge_folder_is_looked_at_up_to_a_bound_that_the_record_has(
    dataset: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same files whatever the order in which the system lists them."""
    monkeypatch.setattr(data_files, "MOST_ENTRIES", 52)
    listed = os.listdir
    monkeypatch.setattr(os, "listdir", lambda folder: sorted(listed(folder), reverse=True))
    found = digests(dataset)
    # Beside the folder and the one of the images.
    assert (found["files"], found["ended_after"]) == (50, 52)
    assert found["bytes"] == sum(range(1, 51))
    monkeypatch.setattr(os, "listdir", listed)
    assert digests(dataset) == found


def test_files_of_very_many_endings_are_not_all_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(data_manifest, "MOST_READ", 8)
    for number in range(20):
        (tmp_path / f"a.{number}").write_text("x")
    found = digests(tmp_path)
    assert (found["files"], found["files_read"]) == (20, 8)
