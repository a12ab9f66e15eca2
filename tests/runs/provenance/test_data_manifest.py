"""Manifests are equal for copies of the same data, and differ for other names, sizes and contents."""

import os
import shutil
from pathlib import Path

import pytest

from hand_recon.runs.provenance import data_manifest
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
