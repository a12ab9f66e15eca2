"""The soak of `engine=daft`: what it compares and measures; the kills themselves are slow."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("pyarrow")

import soak_scale
from tests.support.detector_models import published_models


def row(number: int, bend: float = 10.0, **changes: Any) -> dict[str, Any]:  # noqa: ANN401
    hand = {"kp2d": [[1.0, 2.0]], "kp3d": None, "joint_angles_degrees": [[bend]]} | {
        "covariance_3d": None
    }
    return {"row": number, "path": "a.jpg", "error": None, "hands": [hand]} | changes


def test_tables_differ_by_their_greatest_relative_difference() -> None:
    assert soak_scale.difference({0: row(0)}, {0: row(0)}) == 0
    assert soak_scale.difference({0: row(0)}, {0: row(0, 10.5)}) == pytest.approx(0.05)


@pytest.mark.parametrize(
    ("other", "told"),
    [
        ({}, "1 rows are in one of two tables alone"),
        ({0: row(0, path="b.jpg")}, "of another image"),
        ({0: row(0, error="damaged")}, "has another error"),
        ({0: row(0, hands=None)}, "another number of hands"),
    ],
)
def test_lost_and_changed_rows_end_the_program(other: dict[int, Any], told: str) -> None:
    with pytest.raises(SystemExit, match=told):
        soak_scale.difference({0: row(0)}, other)


def test_a_doubled_row_ends_the_program(tmp_path: Path) -> None:
    import pyarrow
    import pyarrow.parquet

    (tmp_path / "hands").mkdir()
    for part in (0, 1):
        pyarrow.parquet.write_table(
            pyarrow.Table.from_pylist([row(3)]), tmp_path / "hands" / f"part-0000{part}.parquet"
        )
    with pytest.raises(SystemExit, match="Row 3 is there twice"):
        soak_scale.table_of(tmp_path)


def test_the_rate_leaves_out_the_start(tmp_path: Path) -> None:
    """Parts of 8 images at 100, 102 and 104 s: the first took unknown time, the other two 4 s."""
    (tmp_path / "hands").mkdir()
    for part, moment in enumerate((100, 102, 104)):
        path = tmp_path / "hands" / f"part-0000{part}.parquet"
        path.write_bytes(b"")
        os.utime(path, (moment, moment))
    assert soak_scale.steady_rate(tmp_path, 8) == 4.0


def test_a_soak_that_could_not_kill_has_not_passed(monkeypatch: pytest.MonkeyPatch) -> None:
    """A command that ends at once has no workers, and its tables are the same."""
    monkeypatch.setattr(soak_scale, "command", lambda *_: [sys.executable, "-S", "-c", "pass"])
    monkeypatch.setattr(soak_scale, "table_of", lambda output: {0: row(0)})
    with pytest.raises(SystemExit, match="Found 0 kills; expected 3"):
        soak_scale.main(["examples", "--images", "1", "--kills", "3", "--rounds", "0"])


def test_where_there_is_no_worker_none_is_killed() -> None:
    with subprocess.Popen(["sleep", "20"]) as process:  # noqa: S607
        assert soak_scale.workers_of(process.pid) == []
        assert not soak_scale.kill_worker(process)
        assert process.poll() is None
        process.kill()


@pytest.mark.slow
def test_killed_workers_and_commands_lose_and_double_nothing(
    capfd: pytest.CaptureFixture[str],
) -> None:
    pytest.importorskip("daft", reason="Daft (the extra scale) is not installed")
    published_models()
    soak_scale.main(["examples", "--images", "24", "--part", "2", "--kills", "4", "--rounds", "0"])
    assert (
        "2 workers and 2 commands killed: 24 rows, none lost or doubled" in capfd.readouterr().out
    )
