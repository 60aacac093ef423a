"""A factor that does not fit in memory lies in a file: when, with which results, and what ends it."""

import gc
import json
import subprocess
import sys
import textwrap
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.linalg.eigen import certified_modes, count_below
from cmsreduce.linalg.machine import SolverSettings, solver_settings
from cmsreduce.linalg.sparse import (
    InsufficientMemoryError,
    NotPositiveDefiniteError,
    RefinedFactor,
    factorisation,
    factorise,
)
from cmsreduce.multifrontal import compile_loops
from tests.solids import block

ROOT = Path(__file__).resolve().parents[3]
BEAM = block("beam", (3.0, 0.5, 0.4), (36, 7, 6), held=range(1, 57))
OMEGA = 2 * np.pi * 900.0
COUNT = count_below(BEAM.K, BEAM.M, OMEGA)


def little(folder, precision="auto", backend="auto"):
    """Settings under which no factor of the beam fits in memory, but the work space of one in a file does."""
    return SolverSettings(backend, memory=5e6, threads=1, precision=precision, scratch=folder)


@pytest.mark.parametrize(("precision", "taken"), [("double", "double"), ("single", "single"), ("auto", "single")])
def test_modes_and_static_shapes_are_those_of_a_factor_in_memory(tmp_path, precision, taken):
    expected = certified_modes(BEAM.K, BEAM.M, OMEGA, count=COUNT)
    x = np.random.default_rng(1).standard_normal((BEAM.n, 3))
    with solver_settings(little(tmp_path / "new", precision)) as settings:
        factor = factorise(BEAM.K)
        # The name of the file is gone at once: a killed process leaves none.
        assert not list((tmp_path / "new").iterdir())
        modes = certified_modes(BEAM.K, BEAM.M, OMEGA, solve=factor, count=COUNT)
        found = factor(BEAM.K @ x)
    assert COUNT == expected.omega.size > 5
    np.testing.assert_allclose(modes.omega, expected.omega, rtol=1e-9)
    np.testing.assert_allclose(found, x, rtol=0, atol=1e-9 * abs(x).max())
    (work,) = settings.work
    size = {"double": 8, "single": 4}[taken]
    assert (work.backend, work.precision) == ("multifrontal", taken)
    assert size * work.entries <= work.file_mib * 2**20 < 1.3 * size * work.entries
    assert work.mib * 2**20 < settings.memory


def test_a_shifted_factor_lies_in_a_file_too(tmp_path):
    """Its count needs no file."""
    A = sp.csc_array(BEAM.K - OMEGA**2 * BEAM.M)
    x = np.random.default_rng(2).standard_normal((BEAM.n, 3))
    given = little(tmp_path, "double", "multifrontal")
    with solver_settings(replace(given, memory=1e7)):
        assert factorise(A, definite=False, solves=False).negative_pivots == COUNT
    with solver_settings(given):
        factor = factorise(A, definite=False)
        found = factor(A @ x)
    assert factor.negative_pivots == COUNT
    np.testing.assert_allclose(found, x, rtol=0, atol=1e-9 * abs(x).max())
    counted, stored = given.work
    assert (counted.file_mib, stored.backend) == (0.0, "multifrontal") and stored.file_mib > 0


def test_one_factor_in_a_file_is_kept_for_later_steps(tmp_path, monkeypatch):
    monkeypatch.setattr(factorisation, "LARGE", 1)
    other = sp.csc_array(BEAM.K * 2)
    with solver_settings(little(tmp_path, "double")) as settings:
        factor = factorise(BEAM.K, kept=True)
        assert factorise(BEAM.K.copy(), kept=True) is factor and len(settings.work) == 1
        second = factorise(other, kept=True)
        assert factor not in settings.factors and second in settings.factors
        # A factor that nobody keeps takes a file, too.
        factorise(sp.csc_array(BEAM.K * 3))
        assert second not in settings.factors


def test_a_factor_in_memory_is_preferred(tmp_path):
    with solver_settings(SolverSettings("multifrontal", scratch=tmp_path)) as settings:
        factorise(BEAM.K)
    assert [(work.precision, work.file_mib) for work in settings.work] == [("double", 0.0)]


def test_a_matrix_too_ill_conditioned_for_single_precision_takes_double(tmp_path, monkeypatch):
    monkeypatch.setattr(RefinedFactor, "_measured_contraction", lambda self: 1.0)
    with solver_settings(little(tmp_path)) as settings:
        x = factorise(BEAM.K)(BEAM.K @ np.ones(BEAM.n))
    np.testing.assert_allclose(x, 1.0, rtol=0, atol=1e-9)
    assert settings.work[0].precision == "double" and settings.work[0].file_mib > 0


@pytest.mark.parametrize("backend", ["superlu", pytest.param("pardiso", marks=pytest.mark.pardiso)])
def test_a_solver_that_is_named_is_not_replaced(tmp_path, backend):
    with solver_settings(little(tmp_path, backend=backend)), pytest.raises(InsufficientMemoryError):
        factorise(BEAM.K)


def test_without_a_folder_a_factor_is_refused():
    with solver_settings(little(None)), pytest.raises(InsufficientMemoryError, match="GiB may be used"):
        factorise(BEAM.K)


def test_a_pivot_that_fails_is_named_without_another_factor(tmp_path):
    A = BEAM.K.copy()
    A[700, 700] *= -1
    with (
        solver_settings(little(tmp_path)),
        pytest.raises(NotPositiveDefiniteError, match="the beam is singular"),
    ):
        factorise(A, what="the beam")


# Factorises a cube in a process of its own, with limits of the system on memory and then on the size of a file.
LIMITED = """
    import json, resource, sys
    from contextlib import suppress
    from dataclasses import replace
    from pathlib import Path
    import numpy as np
    import scipy.sparse as sp
    from cmsreduce.linalg.machine import SolverSettings, solver_settings
    from cmsreduce.linalg.sparse import InsufficientMemoryError, factorise

    K, folder, free = sp.load_npz(sys.argv[1]), Path(sys.argv[1]).parent / "scratch", resource.RLIM_INFINITY
    b, given = np.ones((K.shape[0], 8)), SolverSettings("multifrontal", threads=1, precision="double", scratch=folder)

    def solved(memory):
        with solver_settings(replace(given, memory=memory, work=[])) as settings:
            return [abs(K @ factorise(K)(b) - b).max(), settings.work[0].file_mib]

    # The settings keep the order, which takes as much memory to find as this small factor.
    expected = solved(1e9)
    used = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmData:"))
    # The factor takes 49 MiB, the updates beside it 21, and the rest of the work some 15.
    resource.setrlimit(resource.RLIMIT_DATA, (int(used.split()[1]) * 1024 + 60 * 2**20, free))
    on_disk = None
    # The error holds what was made until its block ends.
    with suppress(MemoryError):
        on_disk = solved(1e9)
    on_disk = on_disk or solved(4e7)
    resource.setrlimit(resource.RLIMIT_DATA, (free, free))
    resource.setrlimit(resource.RLIMIT_FSIZE, (2**24, free))
    try:
        refused = solved(4e7)
    except InsufficientMemoryError as error:
        refused = str(error)
    print(json.dumps([expected, on_disk, refused]))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="Linux alone limits the memory without a file behind it")
def test_a_process_with_too_little_memory_makes_the_factor_in_a_file_if_the_disk_has_room(tmp_path):
    # A process that compiles keeps memory in which the factor would fit.
    compile_loops()
    sp.save_npz(tmp_path / "cube.npz", block("cube", (1.0, 1.0, 1.0), (16, 16, 16), held=range(1, 290)).K)
    command = [sys.executable, "-c", textwrap.dedent(LIMITED), str(tmp_path / "cube.npz")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    in_memory, on_disk, refused = json.loads(done.stdout)
    assert in_memory[1] == 0 and on_disk[1] > 40
    assert on_disk[0] == in_memory[0] < 1e-9
    assert f"in a file in {tmp_path / 'scratch'}: File too large" in refused
    assert "`solver.memory`" in refused and "`solver.scratch`" in refused
    assert not list((tmp_path / "scratch").iterdir())


def test_the_file_goes_with_the_factor(tmp_path):
    maps = Path("/proc/self/maps")
    if not maps.exists():
        pytest.skip("the mappings of a process are listed by Linux alone")
    with solver_settings(little(tmp_path, "double")):
        factor = factorise(BEAM.K)
    assert str(tmp_path) in maps.read_text()
    del factor
    gc.collect()
    assert str(tmp_path) not in maps.read_text()
