"""`predict engine=daft` for four photographs, with a worker of this process in place of Daft's."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow.parquet
import pytest
from omegaconf import DictConfig

from hand_recon.scale import engine
from hand_recon.scale.image_worker import ImageTask, ImageWorker
from hand_recon.scale.schema import group_type
from tests.support.photo_folder import asked


def config_of(folder: Path, output: Path, *words: str) -> DictConfig:
    """`predict engine=daft` for a folder of photographs, in parts of two."""
    settings = ("engine=daft", "part=2", "batch=1", "workers=1", f"output='{output}'")
    return asked(folder, *settings, *words)


_workers: dict[str, ImageWorker] = {}


def kept_worker(settings: dict[str, Any]) -> ImageWorker:
    """A worker of some settings, made once."""
    key = json.dumps(settings)
    return _workers.setdefault(key, _workers.get(key) or ImageWorker(settings))


def in_this_process(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Replace Daft's query by a worker in this process, which starts sooner; lists the rows that it gets."""
    asked_for: list[int] = []
    monkeypatch.setattr(engine, "ImageWorker", kept_worker)

    def query(self: engine._Run, missing: list[int]) -> Iterator[Any]:
        worker, column = kept_worker(self.settings), self.places.column
        for group in self._groups(missing).to_pylist():
            asked_for.extend(group["row"])
            places = zip(group["path"], group["position"], strict=True)
            values = [{"path": path, "position": at, "column": column} for path, at in places]
            found = pyarrow.array([worker([ImageTask(one) for one in values])], group_type())
            row = pyarrow.array([group["row"]])
            batch = pyarrow.record_batch([row, found], ["row", "found"])
            yield self._rows(batch)

    monkeypatch.setattr(engine._Run, "_query", query)
    return asked_for


def rows_in(output: Path) -> list[dict[str, Any]]:
    """The folder of the parts as one table."""
    rows: list[dict[str, Any]] = pyarrow.parquet.read_table(output / "hands").to_pylist()
    return rows
