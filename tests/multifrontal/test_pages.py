"""Entries in a file give the numbers of entries in memory, to the last bit, and leave nothing behind."""

import mmap
from pathlib import Path

import numpy as np
import pytest

from cmsreduce.multifrontal import CholeskyFactor, NotPositiveDefiniteError, nested_dissection
from cmsreduce.multifrontal import pages as module
from tests.multifrontal.matrices import lattice

CUBE = lattice(12, 12, 12)
ORDER = nested_dissection(CUBE)
SCALE = 2.0 ** -np.round(np.log2(CUBE.diagonal()) / 2)
advised = pytest.mark.skipif(not hasattr(mmap, "MADV_DONTNEED"), reason="this system takes no advice on pages")


def in_a_file(path):
    return lambda count, real: np.memmap(path, dtype=real, mode="w+", shape=(count,))


@pytest.fixture(params=[2**14, 2**30], ids=["many pieces", "one piece"])
def piece(request, monkeypatch):
    monkeypatch.setattr(module, "_PIECE", request.param)


@pytest.mark.parametrize("scale", [None, SCALE], ids=["double", "single"])
@pytest.mark.parametrize("threads", [1, 2])
def test_a_factor_in_a_file_is_that_in_memory(tmp_path, piece, threads, scale):
    b = np.random.default_rng(0).standard_normal((CUBE.shape[0], 5))
    memory = CholeskyFactor(CUBE, ORDER, threads=threads, scale=scale)
    mapped = CholeskyFactor(CUBE, ORDER, threads=threads, scale=scale, allocate=in_a_file(tmp_path / "entries"))
    assert (tmp_path / "entries").stat().st_size == mapped.size.stored == memory.size.stored
    np.testing.assert_array_equal(mapped.solve(b), memory.solve(b))
    np.testing.assert_array_equal(mapped.pivots, memory.pivots)
    np.testing.assert_array_equal(mapped._blocks.values, memory._blocks.values)


@advised
def test_each_piece_is_released_when_it_is_written_and_read_twice_in_a_solve(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_PIECE", 2**16)
    released = []
    plain = module.Pages.release
    monkeypatch.setattr(module.Pages, "release", lambda self, piece: (released.extend(piece), plain(self, piece)))
    factor = CholeskyFactor(CUBE, ORDER, threads=2, allocate=in_a_file(tmp_path / "entries"))
    every = list(range(factor._tree.parent.size))
    assert sorted(released) == every
    released.clear()
    factor.solve(np.ones((CUBE.shape[0], 3)))
    assert sorted(released) == sorted(2 * every)


@advised
@pytest.mark.skipif(not Path("/proc/self/smaps").exists(), reason="the pages of a mapping are listed by Linux alone")
def test_little_of_a_file_stays_in_the_process(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_PIECE", 2**18)
    factor = CholeskyFactor(CUBE, ORDER, allocate=in_a_file(tmp_path / "entries"))
    factor.solve(np.ones((CUBE.shape[0], 8)))
    lines = Path("/proc/self/smaps").read_text().splitlines()
    at = next(number for number, line in enumerate(lines) if line.endswith(str(tmp_path / "entries")))
    resident = next(line for line in lines[at:] if line.startswith("Rss:"))
    assert float(resident.split()[1]) * 1024 < 0.1 * factor.size.stored


def test_a_pivot_that_fails_leaves_no_mapping(tmp_path):
    A = CUBE.copy()
    A[1700, 1700] *= -1
    with pytest.raises(NotPositiveDefiniteError):
        CholeskyFactor(A, ORDER, threads=2, allocate=in_a_file(tmp_path / "entries"))
    maps = Path("/proc/self/maps")
    assert not maps.exists() or str(tmp_path) not in maps.read_text()
