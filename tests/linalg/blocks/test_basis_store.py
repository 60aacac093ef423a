"""Bases on disk give the same numbers as bases in memory, and leave no file behind."""

import errno
import os
import signal
import subprocess
import sys
import textwrap

import h5py
import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.errors import WriteError
from cmsreduce.linalg.blocks import absolute_parts, combine, combined, congruence, new_basis, observed, side_by_side
from cmsreduce.linalg.machine import SolverSettings, solver_settings
from cmsreduce.model import add_dataset, chosen_columns, mapped_array, mapped_in, shapes_beside

N, M = 3000, 150
RANDOM = np.random.default_rng(4)
SHAPES = RANDOM.standard_normal((N, M))
SQUARE = RANDOM.standard_normal((M, M))
A = sp.random_array((N, N), density=2e-3, format="csc", rng=RANDOM)
A = sp.csc_array(A + A.T + sp.eye_array(N))


def on_disk(folder, values=SHAPES):
    found = mapped_array(folder, *values.shape)
    found[:] = values
    return found


def in_place(Phi):
    own = on_disk(mapped_in(Phi), Phi) if mapped_in(Phi) else Phi.copy(order="F")
    combine(own, SQUARE)
    return own


# Each operation on a basis, and the same in one line of numpy.
WORK = {
    "congruence": (lambda Phi: congruence(A, Phi), SHAPES.T @ (A @ SHAPES)),
    "combined": (lambda Phi: combined(Phi, SQUARE[:, :90]), SHAPES @ SQUARE[:, :90]),
    "combine": (in_place, SHAPES @ SQUARE),
    "absolute parts": (lambda Phi: absolute_parts(A, Phi), (abs(SHAPES) * (abs(A) @ abs(SHAPES))).sum(axis=0)),
    "observed": (lambda Phi: observed(sp.csr_array(A[[5, 9, 2000]]), Phi), A[[5, 9, 2000]] @ SHAPES),
    "chosen": (lambda Phi: chosen_columns(Phi, np.arange(140, 2, -2)), SHAPES[:, 140:2:-2]),
    "scaled": (lambda Phi: chosen_columns(Phi, np.arange(M), np.arange(M) / 2), SHAPES * np.arange(M) / 2),
    "beside": (
        lambda Phi: side_by_side(2 * N, [(np.arange(0, 2 * N, 2), Phi), (None, np.ones((2 * N, 2)))])[0][::2],
        np.hstack([SHAPES, np.ones((N, 2))]),
    ),
}


@pytest.mark.parametrize("work", WORK)
def test_a_basis_on_disk_gives_what_one_in_memory_gives(work, tmp_path):
    do, expected = WORK[work]
    in_memory, mapped = do(np.asfortranarray(SHAPES)), do(on_disk(tmp_path))
    np.testing.assert_array_equal(mapped, in_memory)
    np.testing.assert_allclose(in_memory, expected, rtol=0, atol=1e-13 * abs(expected).max())


@pytest.mark.parametrize(("memory", "disk"), [(8 * N * M * 10 + 1e3, False), (8 * N * M * 10 - 1e3, True)])
def test_a_basis_beyond_its_share_of_memory_goes_on_disk(memory, disk, tmp_path):
    with solver_settings(SolverSettings(memory=memory, scratch=tmp_path)):
        Phi = new_basis(N, M)
    assert (mapped_in(Phi) == tmp_path) is disk
    assert Phi.shape == (N, M) and not Phi.any() and Phi.flags.f_contiguous
    with solver_settings(SolverSettings(memory=memory)):
        assert mapped_in(new_basis(N, M)) is None


def test_combinations_of_a_basis_on_disk_are_on_disk_unless_they_are_small(tmp_path):
    Phi = on_disk(tmp_path)
    # Views are on disk, too.
    assert mapped_in(Phi[5:, 3:9].T) == tmp_path
    assert mapped_in(shapes_beside(Phi, M)) == mapped_in(combined(Phi, SQUARE)) == tmp_path
    assert mapped_in(shapes_beside(Phi, 3)) is None
    assert chosen_columns(Phi, np.arange(M)) is Phi


def test_the_file_is_a_contiguous_float64_dataset(tmp_path):
    path = tmp_path / "basis.h5"
    with h5py.File(path, "w"):
        pass
    offset = add_dataset(path, "Phi", (M, N))
    with path.open("r+b") as file:
        file.seek(offset)
        file.write(np.ascontiguousarray(SHAPES.T).tobytes())
    with h5py.File(path) as file:
        assert file["Phi"].chunks is None and file["Phi"].dtype == np.dtype("<f8")
        np.testing.assert_array_equal(file["Phi"][()].T, SHAPES)


def test_nothing_is_left_in_the_folder(tmp_path):
    Phi = on_disk(tmp_path / "stages")
    assert not list((tmp_path / "stages").iterdir())
    np.testing.assert_array_equal(Phi, SHAPES)


def test_a_killed_process_leaves_nothing(tmp_path):
    text = f"""
        from pathlib import Path
        from cmsreduce.model import mapped_array
        import os, signal
        Phi = mapped_array(Path({str(tmp_path)!r}), 2000, 300)
        Phi[:] = 1.0
        os.kill(os.getpid(), signal.SIGKILL)
    """
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(text)], check=False)
    assert done.returncode == -signal.SIGKILL
    assert not list(tmp_path.iterdir())


def test_a_full_disk_is_reported_before_any_computation(tmp_path, monkeypatch):
    def full(*arguments):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(WriteError, match=r"3000 x 150 shapes.*No space left.*`solver.scratch`"):
        mapped_array(tmp_path, N, M)
    assert not list(tmp_path.iterdir())
