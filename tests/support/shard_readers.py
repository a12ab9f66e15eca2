"""Readers of the files of shards, with a small valid file for each."""

import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from hand_recon.data.shards.facts import read_facts
from hand_recon.data.shards.index import INDEX, open_index
from hand_recon.data.shards.labels import labels_from_json
from hand_recon.data.shards.manifest import Manifest, Shard, ShardFile, read_manifest
from hand_recon.reading.naming import naming
from hand_recon.reading.text import read_bytes
from tests.support.broken_files import Kind
from tests.support.landmark_writing import POINTS

_ROWS: Final = [(512, 100, 1000, 7, group, 0) for group in range(3)]
_BYTES: Final = 10_000
"""Size of the shard that the index belongs to."""

_MANIFEST: Final = Manifest(
    "a", "joints", 3,
    (Shard(ShardFile("s.tar", _BYTES, 64 * "a"), ShardFile("s.npy", 200, 64 * "b"), 2, 3),),
)  # fmt: skip


def _index() -> bytes:
    stream = io.BytesIO()
    np.save(stream, np.array(_ROWS, INDEX))
    return stream.getvalue()


def _labels() -> bytes:
    hands = [{"landmarks": hand.tolist(), "side": "left"} for hand in POINTS]
    return json.dumps({"image": "a.jpg", "hands": hands}).encode()


def _read_index(path: Path) -> object:
    index = open_index(path, len(_ROWS), _BYTES)
    return index.row(2), index.rows()


def _read_labels(path: Path) -> object:
    with naming(path, "labels of an image"):
        return labels_from_json(read_bytes(path), "shards")


def _facts(path: Path) -> object:
    return read_facts(path.with_name("none.json"), path, {})


SHARD_READERS: Final[
    tuple[tuple[str, Kind, str, Callable[[], bytes], Callable[[Path], object]], ...]
] = (
    ("shards, index", "binary", "s 手.npy", _index, _read_index),
    (
        "shards, manifest", "binary", "s 手.json", lambda: _MANIFEST.to_json().encode(),
        lambda path: read_manifest(read_bytes(path), str(path)),
    ),
    ("shards, labels", "json", "s 手.json", _labels, _read_labels),
    (
        "shards, facts", "binary", "s 手.csv",
        lambda: b"person,split,source,licence,image\np,q,r,s,a\n", _facts,
    ),
)  # fmt: skip
"""Name, kind, file name, valid content and reader of each, as of `FileReader`."""
