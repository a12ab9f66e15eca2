"""Free memory is what the machine and all groups of the process leave."""

from pathlib import Path

import torch

from hand_recon.data.free_memory import free_memory

CPU = torch.device("cpu")
MACHINE = "MemTotal:       1000 kB\nMemFree:   10 kB\nMemAvailable:    400 kB\n"


def write(root: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)


def group(limit: str, used: int, cached: int, shared: int = 0, name: str = "") -> dict[str, str]:
    folder = f"sys/fs/cgroup/{name}"
    return {
        f"{folder}memory.max": f"{limit}\n",
        f"{folder}memory.current": f"{used}\n",
        f"{folder}memory.stat": f"anon 5\nfile {cached}\nshmem {shared}\n",
    }


def test_the_smaller_of_machine_and_container_counts(tmp_path: Path) -> None:
    write(tmp_path, {"proc/meminfo": MACHINE})
    assert free_memory(CPU, tmp_path) == 400 * 1024
    write(tmp_path, group("max", 7, 3))
    assert free_memory(CPU, tmp_path) == 400 * 1024
    write(tmp_path, group("1000", 700, 100, 30))
    assert free_memory(CPU, tmp_path) == 370
    write(tmp_path, group("9000000", 0, 0))
    assert free_memory(CPU, tmp_path) == 400 * 1024
    (tmp_path / "proc/meminfo").unlink()
    assert free_memory(CPU, tmp_path) == 9000000


def test_the_smallest_of_the_groups_around_the_process_counts(tmp_path: Path) -> None:
    write(tmp_path, {"proc/meminfo": MACHINE, "proc/self/cgroup": "0::/slurm/job_7/step\n"})
    write(tmp_path, group("5000", 100, 0, name="slurm/job_7/"))
    write(tmp_path, group("max", 100, 0, name="slurm/job_7/step/"))
    assert free_memory(CPU, tmp_path) == 4900
    write(tmp_path, group("6000", 3000, 50, name="slurm/"))
    assert free_memory(CPU, tmp_path) == 3050
    write(tmp_path, group("10", 9, 0, name="slurm/job_8/"))
    assert free_memory(CPU, tmp_path) == 3050


def test_groups_of_the_first_version_count_too(tmp_path: Path) -> None:
    folder = "sys/fs/cgroup/memory/docker/1/memory"
    write(
        tmp_path,
        {
            "proc/meminfo": MACHINE,
            "proc/self/cgroup": "11:cpu,cpuacct:/docker/2\n9:memory:/docker/1\n0::/\n",
            f"{folder}.limit_in_bytes": "7000\n",
            f"{folder}.usage_in_bytes": "1000\n",
            f"{folder}.stat": "cache 1\ntotal_cache 300\ntotal_shmem 100\n",
        },
    )
    assert free_memory(CPU, tmp_path) == 6200


def test_nothing_is_claimed_where_the_system_does_not_say(tmp_path: Path) -> None:
    write(tmp_path, {"proc/meminfo": "MemTotal: 1000 kB\nMemAvailable:\n", "proc/self/cgroup": "x"})
    assert free_memory(CPU, tmp_path) is None
    assert free_memory(torch.device("meta")) is None


def test_this_machine_has_free_memory() -> None:
    free = free_memory(CPU)
    assert free is None or 2**20 < free < 2**50
