"""Factors on disk and pages handed on: the same numbers, nothing left behind."""

import ctypes
import gc
from pathlib import Path

import numpy as np
import pytest

from cmsreduce.linalg import mkl_memory
from cmsreduce.linalg.eigenpairs import certified_modes, count_below
from cmsreduce.linalg.factorise import InsufficientMemoryError, factorise
from cmsreduce.linalg.mkl_memory import can_be_mapped, free_on_disk, handed_on, idle_bytes
from cmsreduce.linalg.solver_settings import SolverSettings, solver_settings
from tests.solids import block

linux = pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="pages are moved by Linux's own calls")
pytestmark = [pytest.mark.pardiso, linux]
BODY = block("beam", (3.0, 0.5, 0.4), (40, 7, 6), held=range(1, 57))
M_MMAP_THRESHOLD = -3
OMEGA = 2 * np.pi * 900.0


@pytest.fixture
def small_allocations(monkeypatch):
    """Entries of a test's factor count as many, and are mapped by malloc as those of a large one are."""
    ctypes.CDLL(None).mallopt(M_MMAP_THRESHOLD, 2**20)
    monkeypatch.setattr(mkl_memory, "_LARGE", 2**20)


def mapped_files(folder):
    return [line for line in Path("/proc/self/maps").read_text().splitlines() if str(folder) in line]


def needed(precision):
    with solver_settings(SolverSettings("pardiso", precision=precision)) as settings:
        factorise(BODY.K)
    return settings.work[0].mib * 2**20, settings.work[0].entries * {"single": 4, "double": 8}[precision]


@pytest.mark.parametrize("precision", ["single", "double"])
def test_what_does_not_fit_in_memory_is_on_disk(tmp_path, small_allocations, precision):
    assert can_be_mapped()
    b = np.random.default_rng(1).standard_normal((BODY.n, 9))
    expected = factorise(BODY.K)(b)
    whole, entries = needed(precision)
    settings = SolverSettings("pardiso", precision=precision, memory=whole - entries / 2, scratch=tmp_path / "new")
    with solver_settings(settings):
        factor = factorise(BODY.K)
        assert mapped_files(tmp_path) and not list((tmp_path / "new").iterdir())
        np.testing.assert_allclose(factor(b), expected, rtol=0, atol=1e-10 * abs(expected).max())
        del factor
        gc.collect()
    assert not mapped_files(tmp_path)


def test_single_precision_goes_to_disk_where_neither_fits(tmp_path, small_allocations):
    whole, entries = needed("single")
    with solver_settings(SolverSettings("pardiso", memory=whole - entries / 2, scratch=tmp_path)) as settings:
        count = count_below(BODY.K, BODY.M, OMEGA)
        factor = factorise(BODY.K)
        found = certified_modes(BODY.K, BODY.M, OMEGA, solve=factor, count=count)
        assert mapped_files(tmp_path)
    assert {work.precision for work in settings.work} == {"single"}
    expected = certified_modes(BODY.K, BODY.M, OMEGA)
    assert count == expected.omega.size > 5
    np.testing.assert_allclose(found.omega, expected.omega, rtol=1e-9)


def test_it_is_refused_where_the_disk_is_full_too(tmp_path, monkeypatch):
    whole, entries = needed("single")
    monkeypatch.setattr("cmsreduce.linalg.pardiso.free_on_disk", lambda folder: entries / 2)
    limited = SolverSettings("pardiso", memory=whole - entries / 2, scratch=tmp_path)
    with solver_settings(limited), pytest.raises(InsufficientMemoryError):
        factorise(BODY.K)


def test_without_a_folder_it_is_refused(small_allocations):
    whole, entries = needed("single")
    limited = SolverSettings("pardiso", memory=whole - entries / 2)
    with solver_settings(limited), pytest.raises(InsufficientMemoryError):
        factorise(BODY.K)


def test_room_is_that_of_the_folder_s_disk(tmp_path):
    assert 0 < free_on_disk(tmp_path / "not" / "yet") == pytest.approx(free_on_disk(tmp_path), rel=0.01)


def test_pages_are_handed_on_to_one_factor(small_allocations):
    b = np.random.default_rng(2).standard_normal((BODY.n, 3))
    expected = factorise(BODY.K)(b)
    count = count_below(BODY.K, BODY.M, OMEGA)
    left = idle_bytes()
    assert left > 4 * factorise(BODY.K, definite=False).cost.nnz
    # That one has taken them over, and is gone: nobody asked for its pages to be kept.
    assert idle_bytes() == 0
    with handed_on():
        factorise(BODY.K)
        gc.collect()
    assert idle_bytes() > 0
    np.testing.assert_allclose(factorise(BODY.K)(b), expected, rtol=0, atol=1e-12 * abs(expected).max())
    assert count == count_below(BODY.K, BODY.M, OMEGA)
