"""One thread for dense algebra, given back after, and nothing said to MKL, which would then take no file."""

import subprocess
import sys
from pathlib import Path

import pytest
from threadpoolctl import threadpool_info

from cmsreduce.linalg.blas_threads import one_blas_thread

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = """
import sys
from pathlib import Path
import numpy as np
import scipy.sparse as sp
from cmsreduce.linalg import mkl_memory
from cmsreduce.linalg.factorise import factorise
from cmsreduce.linalg.pardiso import mkl_library
from cmsreduce.linalg.solver_settings import SolverSettings, solver_settings

library = mkl_library()
A = sp.csc_array(sp.diags_array([-1.0, 3.0, -1.0], offsets=[-1, 0, 1], shape=(6000, 6000)))
with solver_settings(SolverSettings("multifrontal", memory=1e9, scratch=Path(sys.argv[1]))):
    factor = factorise(A)
    assert abs(A @ factor(np.ones(6000)) - 1).max() < 1e-12
    mkl_memory.watch_if_large(library, 10**6)
print(factor.backend, mkl_memory.can_be_mapped())
"""


def threads() -> list[int]:
    """Of each BLAS but MKL."""
    return [each["num_threads"] for each in threadpool_info() if each["internal_api"] not in ("mkl", "openmp")]


def test_one_thread_and_then_as_before():
    before = threads()
    assert before
    with one_blas_thread():
        assert set(threads()) == {1}
    assert threads() == before


@pytest.mark.pardiso
@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="files are mapped by Linux's own calls")
def test_fronts_leave_a_file_to_pardiso(tmp_path):
    command = [sys.executable, "-c", SCRIPT, str(tmp_path)]
    told = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True, timeout=300).stdout
    assert told.split() == ["multifrontal", "True"]
