"""Pages that are kept within a block: touched once, given back at its end; results are the same."""

import subprocess
import sys

import numpy as np
import pytest

from cmsreduce.linalg.machine import available_memory
from cmsreduce.linalg.machine.allocators import kept_bytes, kept_pages

glibc = pytest.mark.skipif(sys.platform != "linux", reason="memory is kept with the GNU C library only")

# In a process of its own: pages that others left would hide what is counted. Touches 256 MiB twice, tells how many
# pages were touched for the first time in the second round, and how much stays when all is done.
PROBE = """
import resource
import sys
import numpy as np
from contextlib import nullcontext
from pathlib import Path
from cmsreduce.linalg.machine.allocators import kept_bytes, kept_pages

SIZE = 2**25
keep = kept_pages(200_000, 1e12) if sys.argv[1] == "kept" else nullcontext()

def resident():
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()

before = resident()
with keep:
    np.empty(SIZE).fill(1.0)
    held, first = kept_bytes(), resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    np.empty(SIZE).fill(1.0)
    faults = resource.getrusage(resource.RUSAGE_SELF).ru_minflt - first
print(faults, held, resident() - before, kept_bytes())
"""


def probed(how: str) -> list[float]:
    done = subprocess.run([sys.executable, "-c", PROBE, how], capture_output=True, text=True, check=True)
    return [float(word) for word in done.stdout.split()]


@glibc
def test_pages_are_touched_once_and_given_back():
    touched, kept, left, after = probed("kept")
    again, none, _, _ = probed("not kept")
    # 256 MiB are 128 huge pages, or 65536 others.
    assert touched < 20
    assert again > 100
    assert 0.9 * 2**28 < kept < 1.2 * 2**28
    assert none == after == 0
    assert left < 2**25


@glibc
@pytest.mark.parametrize(("n", "limit"), [(100, 1e12), (200_000, 1e9)], ids=["a small body", "one that may not fit"])
def test_where_it_is_no_use_nothing_is_kept(n, limit):
    with kept_pages(n, limit):
        np.empty(2**24).fill(1.0)
        assert kept_bytes() == 0


@glibc
def test_what_is_kept_can_be_had():
    with kept_pages(200_000, 1e12):
        before = available_memory()
        np.empty(2**26).fill(1.0)
        # The system has 512 MiB less, and this process as much to use again.
        assert kept_bytes() > 0.9 * 2**29
        assert available_memory() > before - 2**28
        with kept_pages(200_000, 1e12):
            pass
        assert kept_bytes() > 0.9 * 2**29
    assert kept_bytes() == 0
