"""`hand-recon predict engine=daft` where workers die, raise errors, or cannot write."""

import errno
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("daft", reason="Daft (the extra scale) is not installed")

from hand_recon.command_line.user_errors import USER_ERRORS
from hand_recon.scale import engine
from hand_recon.scale.engine import predict_in_parts
from hand_recon.scale.parts import PartFiles
from hand_recon.scale.udfs import HandsOfPlaces
from tests.support.daft_processes import in_processes
from tests.support.parts_of_photos import config_of, in_this_process


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    return in_this_process(monkeypatch)


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
