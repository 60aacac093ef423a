"""Cores and memory that this process may use: what the machine has free, and no more than its limits leave.

Containers, batch systems and services set limits by control groups of Linux, shells by ``ulimit``. A process that
exceeds the memory of its group is killed without a word.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from functools import cache
from pathlib import Path, PurePosixPath

__all__ = ["available_memory", "usable_cores"]

_KIB = 1024
_PROCESS, _MACHINE, _GROUPS = Path("/proc/self"), Path("/proc/meminfo"), Path("/sys/fs/cgroup")
# Names of version 2 of control groups, and of version 1.
_MOST_MEMORY = ("memory.max", "memory.high", "memory.limit_in_bytes")
_MEMORY_IN_USE = ("memory.current", "memory.usage_in_bytes")
# Memory in use that the system takes back when a process needs it: pages of files. Version 1 counts the pages of the
# groups within a group under other names.
_RECLAIMED = (
    ("inactive_file", "active_file", "slab_reclaimable"),
    ("total_inactive_file", "total_active_file"),
)


def usable_cores() -> int:
    """Number of cores that this process may use, at most OMP_NUM_THREADS."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    cores = math.ceil(min(cores, _share_of_cores()))
    allowed = os.environ.get("OMP_NUM_THREADS", "")
    return min(cores, int(allowed)) if allowed.isdigit() and int(allowed) else cores


def available_memory() -> float:
    """Bytes that this process can still take without swapping.

    They are no more than its control groups and the limits of its shell leave. Where the system does not report free
    memory, all of the machine's counts as free.
    """
    installed = float(os.sysconf("SC_PAGE_SIZE")) * os.sysconf("SC_PHYS_PAGES")
    free = _table(_MACHINE).get("MemAvailable:", installed / _KIB) * _KIB
    return max(min(free, _left_by_groups(installed), _left_by_shell()), 0.0)


def _left_by_groups(installed: float) -> float:
    """Bytes that the control groups of this process leave to it; infinite without a limit below what is installed."""
    left = math.inf
    for group, most in _limited_groups(installed):
        counted = _table(group / "memory.stat")
        reclaimed = max(sum(counted.get(name, 0.0) for name in names) for names in _RECLAIMED)
        left = min(left, most - sum(_numbers(group, _MEMORY_IN_USE)) + reclaimed)
    return left


@cache
def _limited_groups(installed: float) -> list[tuple[Path, float]]:
    """Control groups that limit this process to less than what is installed, and their limits in bytes."""
    limits = ((group, min(_numbers(group, _MOST_MEMORY), default=math.inf)) for group in _groups("memory"))
    return [(group, most) for group, most in limits if most < installed]


def _left_by_shell() -> float:
    """Bytes that ``ulimit -v`` and ``ulimit -d`` leave to this process."""
    try:
        import resource
    except ImportError:
        return math.inf
    names = {"VmSize:": resource.RLIMIT_AS, "VmData:": resource.RLIMIT_DATA}
    found = ((name, resource.getrlimit(limit)[0]) for name, limit in names.items())
    limits = {name: most for name, most in found if most != resource.RLIM_INFINITY}
    # The system adds up the memory of the process for each look, and most shells set no limit.
    used = _table(_PROCESS / "status") if limits else {}
    return min((most - used.get(name, 0.0) * _KIB for name, most in limits.items()), default=math.inf)


@cache
def _share_of_cores() -> float:
    """Cores whose time the control groups of this process give to it."""
    share = math.inf
    for group in _groups("cpu"):
        # Version 2 has both numbers in one file.
        words = " ".join(_words(group / name) for name in ("cpu.max", "cpu.cfs_quota_us", "cpu.cfs_period_us")).split()
        if len(words) == 2 and words[0].isdigit():
            share = min(share, int(words[0]) / int(words[1]))
    return share


def _groups(controller: str) -> Iterator[Path]:
    """Folders of the control groups of this process that may limit it, the innermost first."""
    for line in _words(_PROCESS / "cgroup").splitlines():
        _, controllers, path = line.split(":", 2)
        # Version 2 names no controllers. In a container the path may be one of the machine outside; the group of the
        # container is then the root.
        if not controllers or controller in controllers.split(","):
            root, inner = _GROUPS / controller if controllers else _GROUPS, PurePosixPath(path.lstrip("/"))
            yield from (root / each for each in (inner, *inner.parents))


def _numbers(group: Path, names: tuple[str, ...]) -> list[float]:
    """Contents of those files of a group that hold a number; without a limit they hold a word."""
    found = (_words(group / name).strip() for name in names)
    return [float(each) for each in found if each.isdigit()]


def _table(path: Path) -> dict[str, float]:
    """First number in each line of a table by the word before it."""
    lines = (line.split() for line in _words(path).splitlines())
    return {line[0]: float(line[1]) for line in lines if len(line) > 1 and line[1].isdigit()}


def _words(path: Path) -> str:
    """Text of a file of the system; empty if there is none."""
    try:
        return path.read_text()
    except OSError:
        return ""
