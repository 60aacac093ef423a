"""MUMPS on several processes: its modes equal SuperLU's, missing programs are named, and nothing is left behind."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.eigen import certified_modes, count_below
from cmsreduce.linalg.machine import SolverSettings, solver_settings
from cmsreduce.linalg.sparse import factorise
from cmsreduce.linalg.sparse.mumps import mumps_lacks
from tests.solids import block

# A square bar, so that bending modes come in pairs.
BAR = block("bar", (2.0, 0.2, 0.2), (24, 3, 3), held=range(1, 17))
TOP = 2 * np.pi * 9000.0


@pytest.mark.mumps
@pytest.mark.parametrize("ranks", [1, 2, 3])
def test_modes_are_those_of_superlu_on_any_number_of_processes(ranks):
    assert BAR.n > 600
    found = []
    for settings in (SolverSettings("superlu"), SolverSettings("mumps", ranks=ranks)):
        with solver_settings(settings):
            found.append((count_below(BAR.K, BAR.M, TOP), certified_modes(BAR.K, BAR.M, TOP)))
        assert {work.backend for work in settings.work} == {settings.backend}
    (count, modes), (count2, modes2) = found
    assert count2 == count == modes.omega.size == modes2.omega.size > 12
    np.testing.assert_allclose(modes2.omega, modes.omega, rtol=1e-9)
    # A pair may be turned within its plane: the subspaces agree.
    overlap = np.linalg.svd(modes.Phi.T @ (BAR.M @ modes2.Phi), compute_uv=False)
    np.testing.assert_allclose(overlap, 1.0, atol=1e-9)
    assert modes2.bound.max() < 1e-9


@pytest.mark.mumps
def test_several_factors_exist_at_a_time_and_are_freed():
    matrices = [sp.csc_array(BAR.K + shift * BAR.M) for shift in (0.0, 1e6, 1e8)]
    x = np.random.default_rng(0).standard_normal((BAR.n, 2))
    with solver_settings(SolverSettings("mumps")):
        factors = [factorise(A) for A in matrices]
        for _ in range(2):
            for A, factor in zip(matrices, factors, strict=True):
                np.testing.assert_allclose(factor(A @ x), x, atol=1e-9)
        group, name = factors[0]._group, factors[0]._name
        assert group.alive
        del factors, factor
        # A solve with a freed factor ends the processes; the next factorisation starts new ones.
        with pytest.raises(MatrixError, match="processes of MUMPS ended at 'solve'"):
            group.solve(name, x)
        np.testing.assert_allclose(factorise(matrices[0])(matrices[0] @ x), x, atol=1e-9)


_HOLDS_A_FACTOR = """
import sys, time
import numpy as np, scipy.sparse as sp
from cmsreduce.linalg.sparse.factorisation import factorise
from cmsreduce.linalg.machine import SolverSettings, solver_settings
with solver_settings(SolverSettings("mumps", ranks=2)):
    factor = factorise(sp.csc_array(sp.diags_array(np.arange(1.0, 99.0))))
print(factor._group.folder, factor._group._process.pid, flush=True)
time.sleep({seconds})
"""


def _beneath(pid: int) -> set[int]:
    """Processes that a process started, and their own children."""
    try:
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    except OSError:
        return set()
    return {int(child) for child in children}.union(*(_beneath(int(child)) for child in children))


@pytest.mark.mumps
@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="processes are looked for in /proc")
@pytest.mark.parametrize("death", [None, signal.SIGTERM, signal.SIGKILL], ids=["end", "SIGTERM", "SIGKILL"])
def test_nothing_is_left_behind(death):
    script = _HOLDS_A_FACTOR.format(seconds=60 if death else 0.2)
    parent = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    folder, mpiexec = parent.stdout.readline().split()
    started = _beneath(int(mpiexec)) | {int(mpiexec)}
    assert Path(folder).is_dir()
    if death:
        assert len(started) >= 3
        parent.send_signal(death)
    parent.wait()
    parent.stdout.close()
    last = time.monotonic() + 20
    while time.monotonic() < last and (Path(folder).exists() or any(Path(f"/proc/{pid}").exists() for pid in started)):
        # An ended process may stay listed until its adopted parent reads its exit status.
        started = {pid for pid in started if _runs(pid)}
        time.sleep(0.05)
    assert not Path(folder).exists()
    assert not any(_runs(pid) for pid in started)


def _runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.parametrize(
    ("python", "message"),
    [
        ("/nowhere/python3", "there is no interpreter /nowhere/python3"),
        # An interpreter without packages.
        ("bare", "cannot load petsc4py"),
    ],
)
def test_an_unusable_interpreter_is_named(tmp_path, python, message):
    if python == "bare":
        bare = tmp_path / "bare"
        bare.write_text("#!/bin/sh\necho \"ModuleNotFoundError: No module named 'petsc4py'\" >&2\nexit 1\n")
        bare.chmod(0o755)
        python = str(bare)
    assert message in mumps_lacks(python)
    with (
        solver_settings(SolverSettings("mumps", python=python)),
        pytest.raises(MatrixError, match=r"'mumps' cannot run: .*solver\.python"),
    ):
        factorise(BAR.K)


@pytest.mark.mumps
def test_without_mpiexec_it_is_refused(tmp_path, monkeypatch):
    petsc = tmp_path / "python3"
    petsc.write_text("#!/bin/sh\nexit 0\n")
    petsc.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert mumps_lacks(str(petsc)) == "there is no mpiexec on the PATH"
    assert os.environ["PATH"] == str(tmp_path)
