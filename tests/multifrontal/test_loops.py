"""Compiled code is cached in a folder that can be written, until one of its sources changes."""

from pathlib import Path

import numpy as np
import pytest
from numba.core import config

from cmsreduce.multifrontal import CholeskyFactor, compile_loops, elimination, factor, fronts, loops, shift, shifted
from cmsreduce.multifrontal.loops import loop
from tests.multifrontal.matrices import lattice


@pytest.fixture
def folder(monkeypatch):
    loops.compiled_folder.cache_clear()
    yield loops.compiled_folder
    loops.compiled_folder.cache_clear()


def doubled(values: np.ndarray) -> float:
    total = 0.0
    for value in values:
        total += 2 * value
    return total


def test_code_is_cached_in_the_folder_that_is_set(folder, monkeypatch, tmp_path):
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    compiled = loop(doubled)
    assert compiled(np.arange(4.0)) == 12.0
    assert folder().parent == tmp_path and list(folder().rglob("*.nbi"))
    assert str(tmp_path) == config.CACHE_DIR


def test_the_next_folder_is_taken_if_one_cannot_be_written(folder, monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(loops, "_bases", lambda: iter([tmp_path / "file", tmp_path / "other"]))
    assert folder().parent == tmp_path / "other"
    folder.cache_clear()
    monkeypatch.setattr(loops, "_bases", lambda: iter([tmp_path / "file"]))
    with pytest.raises(RuntimeError, match="set NUMBA_CACHE_DIR"):
        loop(doubled)


def test_a_change_of_any_compiled_source_changes_the_checksum(tmp_path):
    caller, called, other = (tmp_path / f"{name}.py" for name in ("caller", "called", "other"))
    caller.write_text("from cmsreduce.multifrontal.loops import loop\n")
    called.write_text("from numba.extending import intrinsic\nWIDTH = 4\n")
    other.write_text("import numpy\n")
    before = loops._stamp(tmp_path)
    other.write_text("import scipy\n")
    assert loops._stamp(tmp_path) == before
    called.write_text("from numba.extending import intrinsic\nWIDTH = 8\n")
    assert loops._stamp(tmp_path) != before


def test_the_checksum_covers_all_compiled_sources():
    package = Path(loops.__file__).parent
    marked = {path.name for path in package.glob("*.py") if b"@loop" in path.read_bytes()}
    assert {"blas.py", "fronts.py", "substitution.py", "supernodes.py"} <= marked
    assert all(b"import loop" in (package / name).read_bytes() for name in marked)


def test_loops_of_any_pattern_are_compiled_beforehand(monkeypatch):
    called = []
    for module, name in ((elimination, "_couplings"), (shift, "_subtract")):
        compiled = getattr(module, name)
        monkeypatch.setattr(module, name, lambda *args, of=compiled: called.append(of) or of(*args))
    compile_loops()
    assert {each.__name__ for each in called} == {"_couplings", "_subtract"}
    assert all(each.signatures for each in called)


def test_long_indices_compile_nothing_more():
    """Products and sums of scipy may have indices of 64 bits."""
    A = lattice(4, 3, 2)
    long = A.copy()
    long.indices, long.indptr = A.indices.astype(np.int64), A.indptr.astype(np.int64)
    compile_loops()
    loops_of_patterns = (elimination._compared, factor.row_scale, fronts.eliminate, shift._subtract)
    before = [each.signatures.copy() for each in loops_of_patterns]
    b = np.arange(A.shape[0], dtype=float)[:, None]
    for indefinite in (False, True):
        short, same = (CholeskyFactor(each, indefinite=indefinite) for each in (A, long))
        np.testing.assert_array_equal(same.solve(b), short.solve(b))
    difference = shifted(long, long, 0.5)
    np.testing.assert_array_equal(difference.toarray(), A.toarray() / 2)
    assert [each.signatures for each in loops_of_patterns] == before
