"""Pages are reused within a block and given back at its end."""

import subprocess
import sys

import numpy as np
import pytest

from cmsreduce.linalg.machine import available_memory
from cmsreduce.linalg.machine.allocators import reusable_bytes, reused_pages

glibc = pytest.mark.skipif(sys.platform != "linux", reason="pages are reused with the GNU C library only")

# Runs in a process of its own: pages that other tests freed would falsify the count. It fills 256 MiB twice and prints
# the page faults of the second round, the reusable bytes, and the memory that stays at the end.
PROBE = """
import resource
import sys
import numpy as np
from contextlib import nullcontext
from pathlib import Path
from cmsreduce.linalg.machine.allocators import reusable_bytes, reused_pages

SIZE = 2**25
scope = reused_pages(200_000, 1e12) if sys.argv[1] == "reused" else nullcontext()

def resident():
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()

before = resident()
with scope:
    np.empty(SIZE).fill(1.0)
    held, first = reusable_bytes(), resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    np.empty(SIZE).fill(1.0)
    faults = resource.getrusage(resource.RUSAGE_SELF).ru_minflt - first
print(faults, held, resident() - before, reusable_bytes())
"""


def probed(how: str) -> list[float]:
    done = subprocess.run([sys.executable, "-c", PROBE, how], capture_output=True, text=True, check=True)
    return [float(word) for word in done.stdout.split()]


@glibc
def test_pages_are_reused_and_given_back():
    faults, reusable, left, after = probed("reused")
    faults_without, none, _, _ = probed("not reused")
    # 256 MiB are 128 huge pages, or 65536 others.
    assert faults < 20
    assert faults_without > 100
    assert 0.9 * 2**28 < reusable < 1.2 * 2**28
    assert none == after == 0
    assert left < 2**25


@glibc
@pytest.mark.parametrize(("n", "limit"), [(100, 1e12), (200_000, 1e9)], ids=["small", "near the limit"])
def test_no_page_is_reused_for_small_bodies_or_near_the_limit(n, limit):
    with reused_pages(n, limit):
        np.empty(2**24).fill(1.0)
        assert reusable_bytes() == 0


@glibc
def test_reusable_memory_counts_as_available():
    with reused_pages(200_000, 1e12):
        before = available_memory()
        np.empty(2**26).fill(1.0)
        # The system has 512 MiB less, and this process can reuse as much.
        assert reusable_bytes() > 0.9 * 2**29
        assert available_memory() > before - 2**28
        with reused_pages(200_000, 1e12):
            pass
        assert reusable_bytes() > 0.9 * 2**29
    assert reusable_bytes() == 0
