"""Files of shards that are open at the same time: bounded for all stores together, closed with them."""

import os
import signal
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from hand_recon.data.shards.manifest import read_manifest
from hand_recon.data.shards.open_files import DESCRIPTORS, OpenFiles
from hand_recon.data.shards.stores import FolderStore, Span


@pytest.fixture(autouse=True)
def few(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Two descriptors, of none but this test's files."""
    monkeypatch.setattr(DESCRIPTORS, "most", 2)
    monkeypatch.setattr(DESCRIPTORS, "open", {})
    yield
    for descriptor in DESCRIPTORS.open.values():
        os.close(descriptor)


def descriptors_of(folder: Path) -> int:
    """Descriptors of this process that lead into a folder."""
    found = 0
    for one in Path("/proc/self/fd").iterdir():
        try:
            found += str(folder) in os.readlink(one)
        except FileNotFoundError:
            continue
    return found


def store_of(folder: Path) -> FolderStore:
    return FolderStore(folder, read_manifest((folder / "shards.json").read_bytes(), "a"))


def test_several_stores_share_the_bound_and_close_their_files(shard_folder: Path) -> None:
    stores = [store_of(shard_folder) for _ in range(3)]
    indices = [store.index(shard) for store in stores for shard in range(3)]
    assert descriptors_of(shard_folder) == 0
    spans = [Span(shard, 512, 9) for shard in range(3)]
    first = [store.read(spans) for store in stores]
    assert first[0] == first[1] == first[2]
    assert [index.row(0)["offset"] for index in indices] == [512] * 9
    assert descriptors_of(shard_folder) == len(DESCRIPTORS.open) == 2
    del stores, indices
    assert descriptors_of(shard_folder) == len(DESCRIPTORS.open) == 0


def test_the_file_used_longest_ago_is_closed(tmp_path: Path) -> None:
    files = OpenFiles()
    for name in "abc":
        (tmp_path / name).write_text(name)
    assert [files.read(tmp_path / name, 9, 0) for name in "abac"] == [b"a", b"b", b"a", b"c"]
    assert [path.name for _, path in DESCRIPTORS.open] == ["a", "c"]


def test_another_owner_reads_the_file_that_is_there_now(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_text("old")
    first = OpenFiles()
    assert first.read(path, 9, 0) == b"old"
    path.unlink()
    path.write_text("new")
    assert OpenFiles().read(path, 9, 0) == b"new"
    assert first.read(path, 9, 0) == b"old"


# From Python 3.12 on, forking beside a thread warns; here that is the point.
@pytest.mark.filterwarnings("ignore:This process .* is multi-threaded:DeprecationWarning")
def test_a_forked_process_reads_while_the_parents_lock_is_held(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_text("abc")
    files = OpenFiles()
    files.read(path, 1, 0)
    held, done = threading.Event(), threading.Event()

    def hold() -> None:
        with DESCRIPTORS.lock:
            held.set()
            done.wait(60)

    thread = threading.Thread(target=hold)
    thread.start()
    held.wait(60)
    # Without a lock of its own, the child would wait forever; the alarm ends it.
    child = os.fork()
    if child == 0:
        signal.alarm(20)
        good = False
        try:
            good = files.read(path, 2, 1) == b"bc"
        finally:
            os._exit(0 if good else 1)
    done.set()
    thread.join()
    assert os.waitpid(child, 0)[1] == 0
    assert files.read(path, 1, 0) == b"a"
