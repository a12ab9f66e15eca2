"""Differences of provenance: those that losses may depend on are told apart from others."""

from pathlib import Path

from hand_recon.runs.provenance.machine import Meter, hardware
from hand_recon.runs.provenance.record import (
    DIFF_FILE,
    add_used,
    differences,
    read_provenance,
    write_provenance,
)


def test_what_is_written_is_read_and_time_and_memory_are_added(tmp_path: Path) -> None:
    content = {"code": {"revision": "abc"}, "hardware": hardware()}
    write_provenance(tmp_path, content, "a patch")
    assert read_provenance(tmp_path) == content
    assert (tmp_path / DIFF_FILE).read_text() == "a patch"
    used = Meter().used()
    # A process with torch in it has more than 100 MiB.
    assert used["peak_memory_mib"] > 100
    add_used(tmp_path, used)
    assert read_provenance(tmp_path) == content | {"used": used}


def test_a_run_without_provenance_stays_without(tmp_path: Path) -> None:
    add_used(tmp_path, {"wall_seconds": 1.0})
    assert read_provenance(tmp_path) is None
    (tmp_path / "provenance.json").write_text("[]")
    assert read_provenance(tmp_path) is None


def test_code_data_and_numerical_packages_count_and_the_machine_does_not() -> None:
    before = {
        "code": {"revision": "a" * 40, "packages": {"torch": "2.11", "rich": "13"}},
        "data": {"data.root": {"path": "/a", "contents": "0" * 64, "files_read": 3}},
        "hardware": {"processor": "one"},
    }
    now = {
        "code": {"revision": "b" * 40, "packages": {"torch": "2.12", "rich": "14"}},
        "data": {"data.root": {"path": "/b", "contents": "1" * 64, "files_read": 4}},
        "hardware": {"processor": "other"},
    }
    counting, others = differences(before, now)
    assert counting == [
        "code.packages.torch was 2.11, is 2.12",
        f"code.revision was {'a' * 40}, is {'b' * 40}",
        "data.data.root.contents was 000000000000…, is 111111111111…",
    ]
    assert others == [
        "code.packages.rich was 13, is 14",
        "hardware.processor was one, is other",
    ]
    assert differences(before, before) == ([], [])
