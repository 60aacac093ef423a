"""Compiled code is cached in a folder that can be written, until one of its sources changes."""

from pathlib import Path

import numpy as np
import pytest
from numba.core import config

from cmsreduce.multifrontal import loops
from cmsreduce.multifrontal.loops import loop


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
