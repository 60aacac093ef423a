"""Free memory and cores are those that control groups and limits of the shell leave to the process."""

import math
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from cmsreduce.linalg.machine import allowance, available_memory, usable_cores

GIB = 2**30
# Files of the system: a process in a group within a group, with the memory of the outer one limited.
VERSION_2 = {
    "process/cgroup": "0::/batch/job 7\n",
    "groups/batch/memory.max": f"{6 * GIB}\n",
    "groups/batch/memory.current": f"{5 * GIB}\n",
    "groups/batch/memory.stat": f"anon {GIB}\nfile {4 * GIB}\ninactive_file {GIB}\nactive_file {2 * GIB}\n",
    "groups/batch/job 7/memory.max": "max\n",
    "groups/batch/job 7/memory.high": "max\n",
    "groups/batch/job 7/cpu.max": "150000 100000\n",
    "groups/batch/cpu.max": "max 100000\n",
}
VERSION_1 = {
    "process/cgroup": "4:memory:/batch\n1:cpu,cpuacct:/batch\n0::/\n",
    "groups/memory/batch/memory.limit_in_bytes": f"{6 * GIB}\n",
    "groups/memory/batch/memory.usage_in_bytes": f"{5 * GIB}\n",
    "groups/memory/batch/memory.stat": f"inactive_file 0\ntotal_inactive_file {GIB}\ntotal_active_file {2 * GIB}\n",
    "groups/memory/memory.limit_in_bytes": "9223372036854771712\n",
    "groups/cpu/batch/cpu.cfs_quota_us": "150000\n",
    "groups/cpu/batch/cpu.cfs_period_us": "100000\n",
    "groups/cpu/cpu.cfs_quota_us": "-1\n",
}
# In a container the path is that of the machine outside, and the root is the container's own group.
CONTAINER_2 = {
    "process/cgroup": "0::/\n",
    "groups/memory.max": f"{6 * GIB}\n",
    "groups/memory.current": f"{3 * GIB}\n",
    "groups/memory.stat": f"inactive_file {GIB}\n",
    "groups/cpu.max": "150000 100000\n",
}
CONTAINER_1 = {
    "process/cgroup": "4:memory:/docker/5f\n1:cpu,cpuacct:/docker/5f\n",
    "groups/memory/memory.limit_in_bytes": f"{4 * GIB}\n",
    "groups/memory/memory.usage_in_bytes": "0\n",
    "groups/cpu/cpu.cfs_quota_us": "150000\n",
    "groups/cpu/cpu.cfs_period_us": "100000\n",
}
# More is in use than the group should take.
FULL = {**CONTAINER_2, "groups/memory.high": f"{GIB}\n"}
FREE = {"process/cgroup": "0::/\n", "groups/cpu.max": "max 100000\n", "groups/memory.max": "max\n"}


@pytest.fixture
def system(tmp_path, monkeypatch):
    """Write files of the system, of a machine with 20 GiB free of 32."""

    def write(files: dict[str, str]) -> None:
        for name, text in {**files, "meminfo": f"MemAvailable: {20 * GIB // 1024} kB\n"}.items():
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / name).write_text(text)
        monkeypatch.setattr(allowance, "_PROCESS", tmp_path / "process")
        monkeypatch.setattr(allowance, "_GROUPS", tmp_path / "groups")
        monkeypatch.setattr(allowance, "_MACHINE", tmp_path / "meminfo")
        monkeypatch.setattr(allowance.os, "sysconf", {"SC_PAGE_SIZE": 4096, "SC_PHYS_PAGES": 8 * 2**20}.__getitem__)
        monkeypatch.setattr(allowance.os, "sched_getaffinity", lambda _: set(range(8)), raising=False)
        monkeypatch.delenv("OMP_NUM_THREADS", raising=False)

    def forget() -> None:
        allowance._share_of_cores.cache_clear()
        allowance._limited_groups.cache_clear()

    forget()
    yield write
    forget()


@pytest.mark.parametrize(
    "files, gib, cores",
    [
        (VERSION_2, 4, 2),
        (VERSION_1, 4, 2),
        (CONTAINER_2, 4, 2),
        (CONTAINER_1, 4, 2),
        (FULL, 0, 2),
        (FREE, 20, 8),
        ({}, 20, 8),
    ],
    ids=["version 2", "version 1", "container", "container of version 1", "full", "no limit", "no groups"],
)
def test_control_groups_limit_memory_and_cores(system, files, gib, cores):
    system(files)
    assert available_memory() == gib * GIB
    assert usable_cores() == cores


def test_a_share_of_a_core_is_one_core(system):
    system({**FREE, "groups/cpu.max": "20000 100000\n"})
    assert usable_cores() == 1 and math.isclose(allowance._share_of_cores(), 0.2)


@pytest.mark.skipif(not Path("/proc/self/status").is_file(), reason="the system does not tell the memory in use")
@pytest.mark.parametrize("limit", ["RLIMIT_AS", "RLIMIT_DATA"])
def test_limits_of_the_shell_count_less_what_is_in_use(limit):
    code = "from cmsreduce.linalg.machine import available_memory; print(available_memory())"
    most, number = 3 * GIB // 2, getattr(resource, limit)
    found = subprocess.run(
        [sys.executable, "-c", code],
        preexec_fn=lambda: resource.setrlimit(number, (most, most)),
        capture_output=True,
        text=True,
        check=True,
    )
    assert 0.2 * most < float(found.stdout) < most - 30 * 2**20
