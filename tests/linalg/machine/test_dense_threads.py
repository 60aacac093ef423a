"""Settings limit the threads of dense algebra and leave those of MKL unchanged."""

import subprocess
import sys
from pathlib import Path

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from cmsreduce.linalg.machine import SolverSettings, allowed_threads, solver_settings

ROOT = Path(__file__).resolve().parents[3]
SCRIPT = """
import sys
from pathlib import Path
import numpy as np
import scipy.sparse as sp
from cmsreduce.linalg.machine import mkl_memory
from cmsreduce.linalg.sparse.factorisation import factorise
from cmsreduce.linalg.machine import SolverSettings, solver_settings

A = sp.csc_array(sp.diags_array([-1.0, 3.0, -1.0], offsets=[-1, 0, 1], shape=(6000, 6000)))
with solver_settings(SolverSettings("multifrontal", memory=1e9, scratch=Path(sys.argv[1]), replace_allocators=True)):
    factor = factorise(A)
    assert abs(A @ factor(np.ones(6000)) - 1).max() < 1e-12
    mkl_memory.watch_if_large(10**6)
print(factor.backend, mkl_memory.can_be_mapped())
"""


def threads() -> list[int]:
    """Threads of the BLAS libraries of numpy and scipy; other packages bring BLAS libraries of their own."""
    return [each["num_threads"] for each in threadpool_info() if "libscipy_openblas" in each["filepath"]]


@pytest.fixture(autouse=True)
def two():
    """Set two threads, independent of the environment."""
    with threadpool_limits(2, "blas"):
        yield


def test_settings_take_one_thread_unless_they_name_more():
    with solver_settings(SolverSettings()):
        assert set(threads()) == {1}
    with solver_settings(SolverSettings(threads=2)):
        assert set(threads()) == {2}
    assert set(threads()) == {2}


def test_allowed_threads_are_not_exceeded():
    with allowed_threads(1):
        assert SolverSettings().thread_count == 1 and set(threads()) == {1}
        assert SolverSettings(threads=2).thread_count == 2
    assert set(threads()) == {2}


@pytest.mark.pardiso
@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="files are mapped by Linux's own calls")
def test_multifrontal_factors_leave_files_to_pardiso(tmp_path):
    command = [sys.executable, "-c", SCRIPT, str(tmp_path)]
    output = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True, timeout=300).stdout
    assert output.split() == ["multifrontal", "True"]
