"""Places of shards: a folder, or a URL of which ranges or whole shards are read."""

import copy
import hashlib
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol, runtime_checkable
from urllib.parse import urljoin

from hand_recon.data.cache import digest, exclusive_lock
from hand_recon.data.progress import with_progress
from hand_recon.data.shards.cache import BoundedCache
from hand_recon.data.shards.index import CURE, ShardIndex, open_index
from hand_recon.data.shards.manifest import Manifest, ShardFile
from hand_recon.data.shards.open_files import OpenFiles
from hand_recon.data.shards.remote import CONNECTIONS, Web


@dataclass(frozen=True)
class Span:
    """A range of bytes of a shard."""

    shard: int
    """Number of the shard in its manifest."""
    offset: int
    """First byte."""
    size: int
    """Number of bytes."""


@runtime_checkable
class ShardStore(Protocol):
    """Shards of one manifest at one place."""

    where: str
    """Folder or URL, for messages."""
    manifest: Manifest
    """The manifest."""

    def index(self, shard: int) -> ShardIndex:
        """Index of a shard."""
        ...

    def read(self, spans: Sequence[Span]) -> list[bytes]:
        """Bytes of some ranges, which are shorter where a file is."""
        ...

    def whole(self, limit: int) -> "ShardStore":
        """The store that reads whole shards where a store elsewhere keeps them, up to some bytes."""
        ...


class FolderStore:
    """Shards in a folder."""

    def __init__(self, folder: Path, manifest: Manifest, verify: str = "sizes") -> None:
        """Check the files.

        Args:
            folder: The folder.
            manifest: Its manifest.
            verify: `sizes` compares sizes, `sha256` reads all files and compares checksums.

        Raises:
            ValueError: A file is missing, cut off or another one.
        """
        self.where = str(folder)
        self.folder = folder
        self.manifest = manifest
        self.files = OpenFiles()
        for shard in manifest.shards:
            check_size(folder / shard.tar.name, shard.tar)
            check_sum(folder / shard.index.name, shard.index)
        if verify == "sha256":
            for shard in with_progress(manifest.shards, len(manifest.shards), "Verifying"):
                check_sum(folder / shard.tar.name, shard.tar)

    def index(self, shard: int) -> ShardIndex:
        """Index of a shard."""
        known = self.manifest.shards[shard]
        path = self.folder / known.index.name
        return open_index(path, known.hands, known.tar.bytes, self.files)

    def read(self, spans: Sequence[Span]) -> list[bytes]:
        """Bytes of some ranges."""
        return [self.files.read(self._path(span.shard), span.size, span.offset) for span in spans]

    def whole(self, limit: int) -> "FolderStore":
        """This store: nothing has to be downloaded."""
        del limit
        return self

    def _path(self, shard: int) -> Path:
        return self.folder / self.manifest.shards[shard].tar.name


class WebStore:
    """Shards behind a URL, of which ranges are read; their indices are kept in a folder."""

    def __init__(self, url: str, manifest: Manifest, cache: Path, web: Web) -> None:
        """Store the settings; indices are downloaded on first use.

        Args:
            url: Address of the manifest.
            manifest: The manifest.
            cache: Folder of downloaded files.
            web: Client.
        """
        self.where = url
        self.manifest = manifest
        self.web = web
        self.cache = cache
        self.indices = cache / f"indices-{digest(manifest.to_json())}"
        self.shards: BoundedCache | None = None
        self.files = OpenFiles()
        self._pool: ThreadPoolExecutor | None = None
        self._owner = -1

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "_pool": None}

    def index(self, shard: int) -> ShardIndex:
        """Index of a shard, downloaded once."""
        known = self.manifest.shards[shard]
        target = self.indices / known.index.name
        if not target.is_file():
            self.indices.mkdir(parents=True, exist_ok=True)
            with exclusive_lock(self.indices / "download.lock"):
                if not target.is_file():
                    self.web.download(self._url(known.index), known.index, target)
        return open_index(target, known.hands, known.tar.bytes, self.files)

    def read(self, spans: Sequence[Span]) -> list[bytes]:
        """Bytes of some ranges, many of which are asked for at the same time."""
        if self.shards is not None:
            return [self._read_whole(self.shards, span) for span in spans]
        if len(spans) < 2:
            return [self._read_span(span) for span in spans]
        return list(self._own_pool().map(self._read_span, spans))

    def whole(self, limit: int) -> "WebStore":
        """The same store, which downloads the shards that it reads as a whole and keeps some."""
        store = copy.copy(self)
        store.shards = BoundedCache(self.cache / "shards", limit)
        return store

    def _read_span(self, span: Span) -> bytes:
        return self.web.span(
            self._url(self.manifest.shards[span.shard].tar), span.offset, span.size
        )

    def _read_whole(self, cache: BoundedCache, span: Span) -> bytes:
        file = self.manifest.shards[span.shard].tar
        fetch = partial(self.web.download, self._url(file), file)
        return cache.read(file, fetch, span.offset, span.size)

    def _url(self, file: ShardFile) -> str:
        return urljoin(self.where, file.name)

    def _own_pool(self) -> ThreadPoolExecutor:
        """Threads of this process: they do not survive a fork."""
        if self._pool is None or self._owner != os.getpid():
            self._pool, self._owner = ThreadPoolExecutor(CONNECTIONS), os.getpid()
        return self._pool


def check_size(path: Path, file: ShardFile) -> None:
    """Compare the size of a file with the manifest.

    Args:
        path: The file.
        file: What the manifest says.

    Raises:
        ValueError: It is missing, or has another size.
    """
    size = path.stat().st_size if path.is_file() else None
    if size != file.bytes:
        found = "is missing" if size is None else f"has {size:,} bytes"
        raise ValueError(f"{path} {found}, and the manifest says {file.bytes:,} bytes. {CURE}")


def check_sum(path: Path, file: ShardFile) -> None:
    """Compare size and checksum of a file with the manifest.

    Args:
        path: The file.
        file: What the manifest says.

    Raises:
        ValueError: It is missing, or another one.
    """
    check_size(path, file)
    with path.open("rb") as stream:
        found = hashlib.file_digest(stream, "sha256").hexdigest()
    if found != file.sha256:
        raise ValueError(
            f"{path} has the checksum {found[:8]}…, and the manifest says {file.sha256[:8]}…: it is damaged "
            f"or another file. {CURE}"
        )
