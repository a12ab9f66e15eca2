"""`hand-recon predict engine=daft`: parts, what goes on after an interruption, and what is refused."""

import errno
import importlib.util
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from omegaconf import DictConfig

pytest.importorskip("daft", reason="Daft (the extra scale) is not installed")

import pyarrow.parquet

import hand_recon
from hand_recon.command_line.user_errors import USER_ERRORS
from hand_recon.hand.model import HandModel
from hand_recon.runs import predict_run
from hand_recon.runs.unfinished import MARK
from hand_recon.scale import engine
from hand_recon.scale.engine import predict_in_parts
from hand_recon.scale.image_worker import ImageTask, ImageWorker
from hand_recon.scale.parts import PartFiles
from hand_recon.scale.schema import group_type
from hand_recon.scale.start import predict
from hand_recon.scale.udfs import HandsOfPlaces
from tests.support.daft_processes import in_processes
from tests.support.photo_folder import CAMERA, QUICK, asked, photo_folder


@pytest.fixture(scope="module")
def folder(hand: HandModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return photo_folder(hand, tmp_path_factory.mktemp("photos"))


def config_of(folder: Path, output: Path, *words: str) -> DictConfig:
    settings = ("engine=daft", "part=2", "batch=1", "workers=1", f"output='{output}'")
    return asked(folder, *settings, *words)


_workers: dict[str, ImageWorker] = {}


def kept_worker(settings: dict[str, Any]) -> ImageWorker:
    """A worker of some settings, made once."""
    key = json.dumps(settings)
    return _workers.setdefault(key, _workers.get(key) or ImageWorker(settings))


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> list[int]:
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


@in_processes
def test_a_folder_becomes_part_files_by_processes_of_daft(folder: Path, tmp_path: Path) -> None:
    output = tmp_path / "out"
    summary = predict(config_of(folder, output))
    assert summary == {
        "images": 4,
        "failed": 1,
        "hands": 3,
        "fitted": 3,
        "doubtful": summary["doubtful"],
    }
    rows = rows_in(output)
    assert [row["row"] for row in rows] == [0, 1, 2, 3]
    assert [Path(row["path"]).name for row in rows] == sorted(
        path.name for path in (folder / "photos").iterdir()
    )
    words = ["detector=landmarks", f"detector.landmarks='{folder}/found.json'", *QUICK]
    photos = [row["path"] for row in rows[:3]]
    for row, photo in zip(rows, photos, strict=False):
        # One image at once, as batch=1 has it: a fit of few steps depends on the others of its batch.
        expected = hand_recon.reconstruct(photo, camera=np.array(CAMERA), overrides=words)
        found = np.array([hand["kp3d"] for hand in row["hands"]]).reshape(-1, 21, 3)
        np.testing.assert_allclose(found, expected.landmarks_3d, atol=1e-6)
    assert "cut off" in rows[3]["error"]
    assert sorted(path.name for path in output.iterdir()) == [
        "config.yaml", "hands", "manifest.json",
    ]  # fmt: skip
    manifest = json.loads((output / "manifest.json").read_text())
    assert manifest["counts"] == summary
    assert manifest["parts"] == ["part-00000.parquet", "part-00001.parquet"]
    with pytest.raises(FileExistsError, match=r"already holds manifest\.json"):
        predict(config_of(folder, output))


def test_an_interrupted_command_goes_on_with_the_missing_parts(
    folder: Path, tmp_path: Path, here: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    output = tmp_path / "out"
    monkeypatch.setattr(engine, "write_json", interrupted)
    with pytest.raises(KeyboardInterrupt):
        predict_in_parts(config_of(folder, output))
    assert here == [0, 1, 2, 3]
    assert (output / MARK).exists()
    (output / "hands" / "part-00000.parquet").unlink()
    kept = (output / "hands" / "part-00001.parquet").stat().st_mtime_ns
    monkeypatch.undo()
    monkeypatch.setattr(engine._Run, "_query", lambda *_: iter(()))
    for changed, told in (
        (config_of(folder, output, "descent.steps=21"), "other options"),
        (config_of(folder, output, f"input=['{folder}/photos/1 two.png']"), "other input"),
        (config_of(folder, output, "part=3"), "other options"),
        (config_of(folder, output, "batch=2"), "other options"),
    ):
        with pytest.raises(FileExistsError, match=f"unfinished results of a command with {told}"):
            predict_in_parts(changed)
    assert (output / "hands" / "part-00001.parquet").stat().st_mtime_ns == kept


def interrupted(*_: object) -> None:
    raise KeyboardInterrupt


def test_only_missing_parts_are_run_again_also_by_other_workers(
    folder: Path, tmp_path: Path, here: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    output = tmp_path / "out"
    with monkeypatch.context() as patched:
        patched.setattr(engine, "write_json", interrupted)
        with pytest.raises(KeyboardInterrupt):
            predict_in_parts(config_of(folder, output))
    (output / "hands" / "part-00000.parquet").unlink()
    here.clear()
    summary = predict_in_parts(config_of(folder, output, "workers=3"))
    assert here == [0, 1]
    assert [row["row"] for row in rows_in(output)] == [0, 1, 2, 3]
    assert (summary["images"], summary["hands"]) == (4, 3)
    assert not (output / MARK).exists()


def test_a_worker_that_dies_is_replaced_and_one_that_always_dies_ends_the_command(
    folder: Path, tmp_path: Path, here: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    query, deaths = engine._Run._query, []

    def dying(self: engine._Run, missing: list[int]) -> Iterator[Any]:
        deaths.append(len(missing))
        yield from query(self, missing[:1]) if len(deaths) == 2 else ()
        if len(deaths) < 4:
            raise RuntimeError("UDF process closed the connection")
        yield from query(self, missing)

    monkeypatch.setattr(engine._Run, "_query", dying)
    predict_in_parts(config_of(folder, tmp_path / "some"))
    assert deaths == [2, 2, 1, 1]
    assert sorted(here) == [0, 1, 2, 3]
    deaths[:] = [0] * 4
    monkeypatch.setattr(engine._Run, "_query", always_dying)
    with pytest.raises(
        ChildProcessError, match=r"failed 3 times in a row .*rows 0 to 1 .*1 two\.png.*: killed"
    ):
        predict_in_parts(config_of(folder, tmp_path / "none"))
    # A command shows it as a message.
    assert issubclass(ChildProcessError, USER_ERRORS)


def always_dying(self: engine._Run, missing: list[int]) -> Iterator[Any]:
    raise RuntimeError("killed")
    yield  # A generator, as the query is.


def test_a_part_that_cannot_be_written_ends_the_command_at_once(
    folder: Path, tmp_path: Path, here: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(PartFiles, "_write", full)
    with pytest.raises(OSError, match="No space left") as found:
        predict_in_parts(config_of(folder, tmp_path / "out"))
    assert found.value.errno == errno.ENOSPC
    # The images of the first part alone, and once.
    assert here == [0, 1]


class Lacking(HandsOfPlaces):
    """A column whose workers lack a package."""

    def __init__(self, settings: dict[str, Any]) -> None:
        self.settings = settings

    def rows(self, path: Any, position: Any, column: Any) -> Any:  # noqa: ANN401
        raise ModuleNotFoundError("no LiteRT")


def test_an_error_that_a_worker_raises_outside_of_a_row_is_told_at_once(
    folder: Path, tmp_path: Path, here: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    tried = []

    def lacking(self: engine._Run, missing: list[int]) -> Iterator[Any]:
        tried.append(missing)
        raise RuntimeError("UDF unexpectedly failed with traceback:\n  File x\nIndexError: 3\n")
        yield  # A generator, as the query is.

    monkeypatch.setattr(engine._Run, "_query", lacking)
    with pytest.raises(ChildProcessError, match=r"not because of an image: IndexError: 3\. Work"):
        predict_in_parts(config_of(folder, tmp_path / "out"))
    assert len(tried) == 1


@pytest.mark.slow
@in_processes
def test_an_installation_that_lacks_something_ends_the_command_at_once(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(engine, "HandsOfPlaces", Lacking)
    with pytest.raises(
        ChildProcessError, match=r"not because of an image: ModuleNotFoundError: no LiteRT\. Work"
    ):
        predict_in_parts(config_of(folder, tmp_path / "out"))
    assert "run again" not in caplog.text


def test_strict_refuses_failures_after_everything_is_written(
    folder: Path, tmp_path: Path, here: list[int]
) -> None:
    with pytest.raises(
        ValueError, match="1 of 4 images could not be processed; the column `error`"
    ):
        predict_in_parts(config_of(folder, tmp_path / "out", "strict=true"))
    assert (tmp_path / "out" / "manifest.json").exists()
    assert len(here) == 4


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["engine=spark"], "engine=spark is unknown; expected daft, or null"),
        (["json=-"], "json=- beside engine=daft"),
        (["rank=uncertainty"], "rank=uncertainty beside engine=daft"),
        (["workers=0"], "workers=0; expected 1 or more"),
        (["same_person=true"], "same_person=true, which needs all hands at once"),
        (["column=image"], "column=image and photographs"),
    ],
)
def test_what_does_not_go_with_parts_is_refused_before_anything_is_made(
    folder: Path, tmp_path: Path, words: list[str], told: str
) -> None:
    with pytest.raises(ValueError, match=told):
        predict(config_of(folder, tmp_path / "out", *words))
    assert not (tmp_path / "out").exists()


def test_without_an_engine_the_command_is_the_ordinary_one(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(predict_run, "predict", lambda config: {"output": config.output})
    assert predict(asked(folder, f"output='{tmp_path}'")) == {"output": str(tmp_path)}


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("ray") is None, reason="Ray is not installed")
def test_ray_makes_the_same_table_as_processes_of_this_machine(
    folder: Path, tmp_path: Path
) -> None:
    """In processes of their own, since Daft keeps the first runner of a process."""
    import subprocess
    import sys

    tables = []
    for name, words in (("here", ["ray=null"]), ("ray", ["ray=auto"])):
        command = [
            sys.executable, "-m", "hand_recon.predict", str(folder / "photos"), "engine=daft", "part=2",
            "batch=1",
            "detector=landmarks", f"detector.landmarks={folder}/found.json", f"output={tmp_path / name}",
            *QUICK, *words,
        ]  # fmt: skip
        done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603
        assert done.returncode == 0, done.stderr
        tables.append(rows_in(tmp_path / name))
    assert len(tables[0]) == 4
    assert tables[0] == tables[1]
