"""Free memory is what the machine and the container both leave."""

from pathlib import Path

import torch

from hand_recon.data.free_memory import free_memory

CPU = torch.device("cpu")
MACHINE = "MemTotal:       1000 kB\nMemFree:   10 kB\nMemAvailable:    400 kB\n"


def group(folder: Path, limit: str, used: int, cached: int) -> Path:
    (folder / "memory.max").write_text(f"{limit}\n")
    (folder / "memory.current").write_text(f"{used}\n")
    (folder / "memory.stat").write_text(f"anon 5\nfile {cached}\n")
    return folder


def test_the_smaller_of_machine_and_container_counts(tmp_path: Path) -> None:
    (table := tmp_path / "meminfo").write_text(MACHINE)
    nowhere = tmp_path / "nowhere"
    assert free_memory(CPU, table, nowhere) == 400 * 1024
    assert free_memory(CPU, table, group(tmp_path, "max", 7, 3)) == 400 * 1024
    assert free_memory(CPU, table, group(tmp_path, "1000", 700, 100)) == 400
    assert free_memory(CPU, table, group(tmp_path, "9000000", 0, 0)) == 400 * 1024
    assert free_memory(CPU, nowhere, tmp_path) == 9000000


def test_nothing_is_claimed_where_the_system_does_not_say(tmp_path: Path) -> None:
    (table := tmp_path / "meminfo").write_text("MemTotal: 1000 kB\nMemAvailable:\n")
    assert free_memory(CPU, table, tmp_path) is None
    assert free_memory(torch.device("meta")) is None


def test_this_machine_has_free_memory() -> None:
    free = free_memory(CPU)
    assert free is None or 2**20 < free < 2**50
