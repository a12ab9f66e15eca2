"""`hand-recon predict engine=daft`: parts, what goes on after an interruption, and what is refused."""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("daft", reason="Daft (the extra scale) is not installed")


import hand_recon
from hand_recon.runs import predict_run
from hand_recon.runs.unfinished import MARK
from hand_recon.scale import engine
from hand_recon.scale.engine import predict_in_parts
from hand_recon.scale.start import predict
from tests.support.daft_processes import in_processes
from tests.support.parts_of_photos import config_of, in_this_process, rows_in
from tests.support.photo_folder import CAMERA, QUICK, asked


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    return in_this_process(monkeypatch)


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
