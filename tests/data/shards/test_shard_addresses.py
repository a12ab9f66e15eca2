"""Shards behind a URL: ranges or whole shards in a bounded cache, repeated requests, refusals."""

import errno
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch

from hand_recon.data.dataset import HandDataset, load_batch
from hand_recon.data.shards.cache import BoundedCache
from hand_recon.data.shards.dataset import ShardedImages
from hand_recon.data.shards.manifest import ShardFile, read_manifest
from hand_recon.data.shards.remote import Web
from hand_recon.data.shards.splits import ShardRecipe, check_cache
from tests.support.shard_folders import data_of
from tests.support.shard_server import Served, serving

pytest.importorskip("requests")


@pytest.fixture
def served(shard_folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Served]:
    """The shards behind a URL of this machine, which no proxy is asked for."""
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    monkeypatch.setattr("time.sleep", lambda seconds: None)
    with serving(shard_folder) as found:
        yield found


def assert_same_images(found: HandDataset, folder: Path) -> None:
    """Fail unless all images of a dataset are those of the folder's training hands."""
    expected = data_of(folder).dataset("train")
    every = list(range(len(expected)))
    assert len(found) == len(expected)
    assert torch.equal(load_batch(found, every).image, load_batch(expected, every).image)


def tars(served: Served) -> list[str]:
    """Shards that were asked for, in order."""
    return [name for name, _ in served.asked if name.endswith(".tar")]


@pytest.mark.parametrize("address", ["", "shards.json"])
def test_ranges_of_shards_are_read_and_no_shard_is_kept(
    served: Served, shard_folder: Path, tmp_path: Path, address: str
) -> None:
    data = data_of(served.url + address, tmp_path).dataset("train")
    assert_same_images(data, shard_folder)
    ranges = [wanted for name, wanted in served.asked if name.endswith(".tar")]
    assert len(ranges) == len(data)
    assert all(wanted.startswith("bytes=") for wanted in ranges)
    assert not list(tmp_path.rglob("*.tar"))
    # Indices are downloaded once.
    served.asked.clear()
    assert len(data_of(served.url, tmp_path).dataset("train")) == len(data)
    assert [name for name, _ in served.asked] == ["shards.json"]


def test_whole_shards_are_downloaded_once(
    served: Served, shard_folder: Path, tmp_path: Path
) -> None:
    data = data_of(served.url, tmp_path, order="shards", shards_at_once=2)
    data.train_dataloader()
    assert_same_images(data.dataset("train"), shard_folder)
    assert sorted(tars(served)) == ["shard-00000.tar", "shard-00001.tar", "shard-00002.tar"]
    assert len(list(tmp_path.rglob("*.tar"))) == 3
    # Training again, in the same process or another one, finds them.
    for again in (data, data_of(served.url, tmp_path, order="shards")):
        again.train_dataloader()
        assert_same_images(again.dataset("train"), shard_folder)
    assert len(tars(served)) == 3


def test_validation_reads_ranges_whatever_the_order_of_training(
    served: Served, tmp_path: Path
) -> None:
    data = data_of(served.url, tmp_path, order="shards", shards_at_once=2)
    data.train_dataloader()
    for split in ("val", "test"):
        load_batch(data.dataset(split), [0, 1])
    # Of one image with two hands each.
    assert len([wanted for _, wanted in served.asked if wanted]) == 4
    assert len(tars(served)) == 4
    assert not list(tmp_path.rglob("*.tar"))


def test_a_cache_that_cannot_hold_the_mixed_shards_is_refused(
    served: Served, tmp_path: Path
) -> None:
    data = data_of(served.url, tmp_path, order="shards", cache_gb=4e-5)
    # Three shards of up to 19.5 kB: all are needed for four at a time, or for one at a time in two processes.
    with pytest.raises(ValueError, match=r"3 of which are needed at a time, and cache_gb=4e-05"):
        data.train_dataloader()
    dataset = data.dataset("train")
    assert isinstance(dataset, ShardedImages)
    recipe = ShardRecipe(served.url, order="shards", cache_gb=4e-5, shards_at_once=1)
    check_cache(dataset.rows, recipe, 1)
    with pytest.raises(ValueError, match="3 of which are needed"):
        check_cache(dataset.rows, recipe, 2)
    # Those of the next four may be read before all hands of the last four are.
    recipe = ShardRecipe(served.url, order="shards", cache_gb=2e-5, shards_at_once=1)
    with pytest.raises(ValueError, match="2 of which are needed"):
        check_cache(dataset.rows, recipe, 1)


def test_the_file_used_longest_ago_makes_room(tmp_path: Path) -> None:
    files = {name: ShardFile(f"{name}.tar", 4, name * 64) for name in "abc"}
    fetched: list[str] = []

    def read(cache: BoundedCache, name: str) -> bytes:
        def fetch(target: Path) -> None:
            fetched.append(name)
            target.write_bytes(name.encode() * 4)

        return cache.read(files[name], fetch, 1, 2)

    cache = BoundedCache(tmp_path, 8)
    assert [read(cache, name) for name in "abab"] == [b"aa", b"bb", b"aa", b"bb"]
    assert fetched == ["a", "b"]
    read(cache, "a")
    assert read(cache, "c") == b"cc"
    # b was used before a.
    assert sorted(path.name[0] for path in tmp_path.glob("*.tar")) == ["a", "c"]
    assert read(cache, "b") == b"bb"
    assert fetched == ["a", "b", "c", "b"]
    assert sum(path.stat().st_size for path in tmp_path.glob("*.tar")) == 8


class WaitedError(Exception):
    """Raised in the place of a pause."""


def test_running_downloads_have_their_room_before_they_have_their_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Names by which a file could be taken for something else in the cache.
    files = {one: ShardFile(f"{one}.{kind}", 4, one * 64) for one, kind in
             zip("abcd", ("lock", "part", "room", "tar"), strict=True)}  # fmt: skip
    cache = BoundedCache(tmp_path, 8)

    def whole(target: Path) -> None:
        target.write_bytes(b"1234")

    def held() -> list[str]:
        return sorted(path.name[0] for path in tmp_path.iterdir() if path.suffix != ".lock")

    def while_c_comes(target: Path) -> None:
        cache.path(files["d"], whole)
        whole(target)

    for name in "ab":
        cache.path(files[name], whole)
    cache.path(files["c"], while_c_comes)
    assert held() == ["c", "d"]

    def raise_it(seconds: float) -> None:
        raise WaitedError(seconds)

    def while_b_comes(target: Path) -> None:
        # a is being fetched and b takes the rest: there is no room before one of them is there.
        with pytest.raises(WaitedError):
            cache.path(files["d"], whole)
        whole(target)

    def while_a_comes(target: Path) -> None:
        cache.path(files["b"], while_b_comes)
        whole(target)

    monkeypatch.setattr("time.sleep", raise_it)
    (tmp_path / f"{'d' * 24}.tar").unlink()
    cache.path(files["a"], while_a_comes)
    assert held() == ["a", "b"]


def test_the_room_of_a_download_that_failed_or_was_killed_is_free_again(tmp_path: Path) -> None:
    cache = BoundedCache(tmp_path, 8)
    file = ShardFile("a.tar", 8, "a" * 64)

    def fails(target: Path) -> None:
        raise ConnectionError("no network")

    def comes(target: Path) -> None:
        target.write_bytes(b"12345678")

    with pytest.raises(ConnectionError, match="no network"):
        cache.path(file, fails)
    killed = tmp_path / f"{'b' * 24}.room"
    killed.write_bytes(bytes(8))
    part = tmp_path / f"{'b' * 24}.tar.part"
    part.write_bytes(bytes(3))
    assert cache.read(file, comes, 2, 3) == b"345"
    assert not killed.exists()
    assert not part.exists()
    with pytest.raises(ValueError, match=r"b.tar has 9e-06 MB, and the cache .* data.cache_gb"):
        cache.path(ShardFile("b.tar", 9, "b" * 64), fails)


def test_failed_requests_are_repeated(
    served: Served, shard_folder: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    data = data_of(served.url, tmp_path).dataset("train")
    served.failures += [503, "cut", 429]
    assert_same_images(data, shard_folder)
    assert len(re.findall(r"attempt \d failed", caplog.text)) == 3
    shuffled = data_of(served.url, tmp_path, order="shards", shards_at_once=2)
    shuffled.train_dataloader()
    whole = shuffled.dataset("train")
    served.failures += [500, "cut", "other"]
    assert torch.equal(whole[0].image, data[0].image)
    assert "bytes came whose checksum begins with" in caplog.text


def test_requests_that_always_fail_end_in_an_error(served: Served, tmp_path: Path) -> None:
    served.failures += [500] * 3
    with pytest.raises(ConnectionError, match=r"shards.json could not be read in 3 attempts.*500"):
        data_of(served.url, tmp_path, attempts=3).dataset("train")
    assert len(served.asked) == 3
    whole = data_of(served.url, tmp_path, order="shards", shards_at_once=2, attempts=2)
    whole.train_dataloader()
    data = whole.dataset("train")
    served.failures += ["other", "cut"]
    with pytest.raises(ConnectionError, match=r"\.tar could not be read in 2 attempts"):
        data[0]
    assert not list(tmp_path.rglob("*.tar"))


def test_what_another_attempt_does_not_change_is_not_repeated(
    served: Served, tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match=r"none/shards.json: the server answers 404"):
        data_of(served.url + "none", tmp_path).dataset("train")
    served.failures += [403]
    with pytest.raises(ValueError, match="answers 403"):
        data_of(served.url, tmp_path).dataset("train")
    assert len(served.asked) == 2
    with pytest.raises(ValueError, match="has more than 10 bytes"):
        Web().content(served.url + "shards.json", 10)


def test_a_full_disk_is_no_fault_of_the_network(
    served: Served, shard_folder: Path, tmp_path: Path
) -> None:
    file = read_manifest((shard_folder / "shards.json").read_bytes(), "a").shards[0].tar
    target = tmp_path / "a.tar"
    target.with_name("a.tar.part").symlink_to("/dev/full")
    with pytest.raises(OSError, match="No space left") as caught:
        Web().download(served.url + file.name, file, target)
    assert caught.value.errno == errno.ENOSPC
    assert len(served.asked) == 1
    assert not list(tmp_path.iterdir())
    with pytest.raises(FileNotFoundError):
        Web().download(served.url + file.name, file, tmp_path / "none" / "a.tar")
    assert len(served.asked) == 2


def test_a_server_without_ranges_is_told_apart(served: Served, tmp_path: Path) -> None:
    served.ranges = False
    data = data_of(served.url, tmp_path).dataset("train")
    with pytest.raises(ValueError, match=r"answers with the whole file .*data.order=shards"):
        data[0]


def test_other_bytes_in_a_range_are_a_damaged_image(
    served: Served, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    data = data_of(served.url, tmp_path).dataset("train")
    served.failures += ["other"]
    assert data[0].index == 1
    assert "another checksum than the index" in caplog.text


def test_an_address_needs_a_folder_for_indices() -> None:
    assert ShardRecipe("http://127.0.0.1:9/").reading.folder is None
    with pytest.raises(ValueError, match=r"set data.reading.cache_dir"):
        data_of("http://127.0.0.1:9/").dataset("train")


def test_loading_processes_read_ranges_with_connections_of_their_own(
    served: Served, shard_folder: Path, tmp_path: Path
) -> None:
    data = data_of(served.url, tmp_path, workers=2)
    # A connection and threads of this process, which a forked one must not use.
    load_batch(data.dataset("train"), [0, 1])
    images = torch.cat([batch.image for batch in data.train_dataloader()])
    expected = torch.cat([batch.image for batch in data_of(shard_folder).train_dataloader()])
    assert torch.equal(images, expected)
