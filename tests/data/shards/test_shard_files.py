"""Shards as files: what other programs read of them, and what is refused."""

import hashlib
import io
import json
import pickle
import shutil
import tarfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hand_recon.data.shards.dataset import ShardedImages
from hand_recon.data.shards.index import BLOCK, INDEX, open_index, padded
from hand_recon.data.shards.labels import labels_from_json
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


def manifest_of(folder: Path, **changes: Any) -> bytes:  # noqa: ANN401
    """The manifest of a folder with other values."""
    content = json.loads((folder / "shards.json").read_text())
    return json.dumps(content | changes).encode()


def test_more_groups_than_hands_are_refused_but_for_those_of_images_that_are_left_out(
    shard_folder: Path,
) -> None:
    # Nine images of two hands.
    for groups, left_out in ((18, []), (20, ["a", "b"])):
        content = manifest_of(shard_folder, groups=groups, about={"unreadable": left_out})
        assert read_manifest(content, "x").groups == groups
    for groups, left_out in ((19, []), (10**12, ["a"])):
        content = manifest_of(shard_folder, groups=groups, about={"unreadable": left_out})
        with pytest.raises(ValueError, match=rf"{groups:,} groups, expected at most"):
            read_manifest(content, "x")


@pytest.mark.parametrize(
    "content",
    [b"PK\x05\x06" + bytes(18), b"\x93NUMPY\x01\x00\x10\x00{'descr': (((((\n",
     b"\x93NUMPY\x01\x00\x40\x00{'descr': ',f8', 'fortran_order': False, 'shape': (3,)       , }\n"],
)  # fmt: skip
def test_something_else_is_no_index(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "s.npy"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"s\.npy is not a whole \.npy file"):
        open_index(path, 3, 1000)


def test_rows_of_an_index_are_those_of_the_file_and_pickling_sends_the_path_alone(
    shard_folder: Path,
) -> None:
    path = shard_folder / "shard-00000.npy"
    expected = np.load(path)
    index = pickle.loads(pickle.dumps(open_index(path, 8, 1 << 20)))  # noqa: S301  # its own
    np.testing.assert_array_equal(index.rows(), expected)
    assert [index.row(number) for number in range(len(index))] == list(expected)
    data = data_of(shard_folder).dataset("train")
    assert isinstance(data, ShardedImages)
    sent = pickle.dumps(data.rows)
    again = pickle.loads(sent)  # noqa: S301  # its own
    assert again.read([3, 17])[1][2] == data.rows.read([3, 17])[1][2]
    # Rows have 26 bytes, whose beginning is nowhere in what is sent.
    assert not any(np.load(one)[:2].tobytes() in sent for one in shard_folder.glob("*.npy"))


def test_labels_that_are_not_finite_are_refused() -> None:
    hand = {"landmarks": [[1.5, 2.5]] * 20 + [None], "side": "left", "sigma": [1.5] * 21}
    good = json.dumps({"image": "a.jpg", "hands": [hand]})
    found = labels_from_json(good.encode(), "a").landmarks_2d[0]
    assert np.isnan(found[20]).all()
    for number in ("Infinity", "-Infinity", "NaN", "1e400"):
        for value in ("1.5, 2.5", "1.5, 1.5"):
            with pytest.raises(ValueError, match=r"no labels of an image .*number"):
                labels_from_json(good.replace(value, f"{number}, 2.5", 1).encode(), "a")


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
