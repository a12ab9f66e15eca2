"""Shards as files: what other programs read of them, and what is refused."""

import hashlib
import io
import json
import shutil
import tarfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hand_recon.data.shards.index import BLOCK, INDEX, padded
from hand_recon.data.shards.manifest import Shard, read_manifest
from hand_recon.data.shards.writer import ShardImage, write_shard
from tests.support.shard_folders import changed_manifest, data_of


def images() -> list[ShardImage]:
    """Two images of 1 and 2 hands whose sizes are below, at and above a block."""
    return [
        ShardImage(0, ".jpg", bytes(range(256)) * 2, b'{"a": 1}', [3]),
        ShardImage(7, ".png", b"x" * 513, b"y" * 512, [0, 4]),
    ]


def test_tarfile_reads_the_members_and_the_index_leads_to_their_bytes(tmp_path: Path) -> None:
    shard = write_shard(tmp_path, "s", images())
    assert shard is not None
    assert (shard.images, shard.hands) == (2, 3)
    content = (tmp_path / "s.tar").read_bytes()
    with tarfile.open(tmp_path / "s.tar") as archive:
        members = {member.name: archive.extractfile(member) for member in archive}
        found = {name: stream.read() for name, stream in members.items() if stream is not None}
    assert found == {
        "000000000.json": b'{"a": 1}', "000000000.jpg": images()[0].content,
        "000000007.json": b"y" * 512, "000000007.png": b"x" * 513,
    }  # fmt: skip
    index = np.load(tmp_path / "s.npy")
    assert index.dtype == INDEX
    assert index["group"].tolist() == [3, 0, 4]
    assert index["hand"].tolist() == [0, 0, 1]
    # The first header has 512 bytes; the second image's labels begin after two headers and two blocks.
    assert index["offset"].tolist() == [512, 2560, 2560]
    for row, image in zip(index, (images()[0], *[images()[1]] * 2), strict=True):
        start = int(row["offset"])
        assert content[start : start + row["labels"]] == image.labels
        start += padded(int(row["labels"])) + BLOCK
        assert content[start : start + row["image"]] == image.content


def test_the_same_images_give_the_same_bytes_and_checksums(tmp_path: Path) -> None:
    first, again = (write_shard(tmp_path, name, images()) for name in ("a", "b"))
    assert first is not None
    assert again is not None
    assert first.tar.sha256 == again.tar.sha256
    for file in (first.tar, first.index):
        content = (tmp_path / file.name).read_bytes()
        assert (len(content), hashlib.sha256(content).hexdigest()) == (file.bytes, file.sha256)


def test_webdataset_streams_the_same_images(shard_folder: Path) -> None:
    webdataset = pytest.importorskip("webdataset")
    tars = sorted(map(str, shard_folder.glob("*.tar")))
    entries = list(webdataset.WebDataset(tars, shardshuffle=False))
    assert [entry["__key__"] for entry in entries] == [f"{number:09d}" for number in range(9)]
    assert [len(json.loads(entry["json"])["hands"]) for entry in entries] == [2] * 9


def named(name: str) -> Callable[[Any], None]:
    """Change of a manifest: another name of the first shard."""

    def change(content: Any) -> None:  # noqa: ANN401  # any JSON
        content["shards"][0]["tar"]["name"] = name

    return change


@pytest.mark.parametrize("name", ["../s.tar", "/etc/passwd", "a/b.tar", "..", "http://a/b", "s\n"])
def test_a_name_that_leads_elsewhere_is_refused(
    tmp_path: Path, shard_folder: Path, name: str
) -> None:
    folder = Path(shutil.copytree(shard_folder, tmp_path / "copy"))
    changed_manifest(folder, named(name))
    with pytest.raises(ValueError, match=r"no manifest of shards: .*without folders"):
        data_of(folder).dataset("train")


@pytest.mark.parametrize(
    "content",
    [b"", b"[]", b"{}", b'{"format": "hand_recon.shards/9"}', b'{"format": "hand_recon.shards/1"}',
     b"[" * 100_000],
)  # fmt: skip
def test_something_else_is_no_manifest(content: bytes) -> None:
    with pytest.raises(ValueError, match=r"x\.json is no manifest of shards.*prepare shards"):
        read_manifest(content, "x.json")


def test_counts_that_are_no_numbers_of_hands_are_refused() -> None:
    file = {"name": "s.tar", "bytes": 1, "sha256": "0" * 64}
    for count in (0, -1, "7", 1.5, True):
        with pytest.raises(ValueError, match=r"the count .*, expected a whole number"):
            Shard.from_json({"tar": file, "index": file, "images": count, "hands": 2})


def test_a_folder_without_a_manifest_says_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"No manifest of shards at .*prepare shards"):
        data_of(tmp_path).dataset("train")
    with pytest.raises(FileNotFoundError, match="Nothing matches"):
        data_of(tmp_path / "none*").dataset("train")


def test_a_shard_that_is_cut_off_or_missing_says_what_to_do(
    tmp_path: Path, shard_folder: Path
) -> None:
    folder = Path(shutil.copytree(shard_folder, tmp_path / "copy"))
    path = folder / "shard-00001.tar"
    whole = path.read_bytes()
    path.write_bytes(whole[:-600])
    told = rf"shard-00001.tar has {len(whole) - 600:,} bytes, and the manifest says {len(whole):,}.*again"
    with pytest.raises(ValueError, match=told):
        data_of(folder).dataset("train")
    path.unlink()
    with pytest.raises(ValueError, match=r"shard-00001.tar is missing, and the manifest says"):
        data_of(folder).dataset("train")


def test_a_shard_with_another_checksum_is_found_on_request(
    tmp_path: Path, shard_folder: Path
) -> None:
    folder = Path(shutil.copytree(shard_folder, tmp_path / "copy"))
    path = folder / "shard-00002.tar"
    content = bytearray(path.read_bytes())
    content[-700] ^= 1
    path.write_bytes(content)
    assert len(data_of(folder).dataset("train")) > 0
    with pytest.raises(ValueError, match=r"shard-00002.tar has the checksum .*another file.*again"):
        data_of(folder, verify="sha256").dataset("train")


def test_an_index_that_is_not_this_shards_is_refused(tmp_path: Path, shard_folder: Path) -> None:
    folder = Path(shutil.copytree(shard_folder, tmp_path / "copy"))
    path = folder / "shard-00000.npy"
    index = np.load(path)

    def use(array: np.ndarray) -> None:
        stream = io.BytesIO()
        np.save(stream, array)
        path.write_bytes(stream.getvalue())
        sum_ = {
            "bytes": len(stream.getvalue()),
            "sha256": hashlib.sha256(stream.getvalue()).hexdigest(),
        }
        changed_manifest(folder, lambda content: content["shards"][0]["index"].update(sum_))

    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(ValueError, match=r"shard-00000.npy has .* and the manifest says"):
        data_of(folder).dataset("train")
    use(index[:3])
    with pytest.raises(ValueError, match="expected 8 hands"):
        data_of(folder).dataset("train")
    for field, value in (("offset", 1 << 63), ("image", (1 << 32) - 1), ("labels", 1 << 21)):
        wrong = index.copy()
        wrong[field][5] = value
        use(wrong)
        with pytest.raises(ValueError, match="1 records beyond the shard's"):
            data_of(folder).dataset("train")
