"""Factors on disk give the same numbers and leave no file behind.

Each case runs in a process of its own: MKL looks up its allocator only once.
"""

import ast
import json
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

from cmsreduce.linalg.eigen import certified_modes
from cmsreduce.linalg.machine import SolverSettings, free_on_disk, solver_settings
from cmsreduce.linalg.sparse import InsufficientMemoryError, factorise
from tests.solids import block

ROOT = Path(__file__).resolve().parents[3]
linux = pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="files are mapped by Linux's own calls")
pytestmark = [pytest.mark.pardiso, linux]
OMEGA = 2 * np.pi * 900.0
# The entries of a test's factor count as those of a large factor, and malloc maps them in the same way
# (mallopt, M_MMAP_THRESHOLD).
SCRIPT = """
    import ctypes, gc, json, sys
    from pathlib import Path
    import numpy as np
    from cmsreduce.linalg.machine import mkl_memory
    from cmsreduce.linalg.sparse import pardiso
    from cmsreduce.linalg.eigen import certified_modes, count_below
    from cmsreduce.linalg.sparse.factorisation import factorise
    from cmsreduce.linalg.machine import SolverSettings, solver_settings
    from tests.linalg.machine.test_mkl_memory import OMEGA, body

    precision, memory, folder, earlier = sys.argv[1], float(sys.argv[2]), Path(sys.argv[3]), sys.argv[4] == "earlier"
    ctypes.CDLL(None).mallopt(-3, 2**23)
    mkl_memory._LARGE = 2**23

    def mapped():
        return any(str(folder) in line for line in Path("/proc/self/maps").read_text().splitlines())

    model = body()
    if earlier:
        factorise(model.K)
    allowed = {"memory": memory, "scratch": folder, "replace_allocators": "refused" not in sys.argv}
    with solver_settings(SolverSettings("pardiso", precision=precision, **allowed)) as settings:
        count = count_below(model.K, model.M, OMEGA)
        factor = factorise(model.K)
        result = {"mapped": mapped(), "files": len(list(folder.iterdir()))}
        b = np.random.default_rng(1).standard_normal((model.n, 3))
        result["residual"] = float(abs(model.K @ factor(b) - b).max())
        modes = certified_modes(model.K, model.M, OMEGA, solve=factor, count=count)
        result |= {"count": count, "omega": modes.omega.tolist()}
        result["precision"] = sorted({work.precision for work in settings.work})
        del factor, modes
        gc.collect()
    print(json.dumps(result | {"left": mapped()}))
"""


def body():
    return block("beam", (3.0, 0.5, 0.4), (50, 9, 8), held=range(1, 91))


def needed(precision):
    """Bytes of a factor with its work space, and bytes of its entries."""
    with solver_settings(SolverSettings("pardiso", precision=precision)) as settings:
        factorise(body().K)
    return settings.work[0].mib * 2**20, settings.work[0].entries * {"single": 4, "double": 8}[precision]


def in_a_process(precision, memory, folder, how="first"):
    arguments = [precision, str(memory), str(folder), how]
    command = [sys.executable, "-c", textwrap.dedent(SCRIPT), *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)


@pytest.mark.parametrize("precision", ["single", "double", "auto"])
def test_a_factor_that_does_not_fit_in_memory_is_on_disk(tmp_path, precision):
    whole, entries = needed("double" if precision == "double" else "single")
    done = in_a_process(precision, whole - entries / 2, tmp_path / "new")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["mapped"] and not result["left"] and result["files"] == 0
    assert result["precision"] == ["double" if precision == "double" else "single"]
    assert result["residual"] < 1e-9
    expected = certified_modes(body().K, body().M, OMEGA)
    assert result["count"] == expected.omega.size > 5
    np.testing.assert_allclose(result["omega"], expected.omega, rtol=1e-9)


def test_a_factor_is_refused_if_mkl_allocated_memory_before(tmp_path):
    whole, entries = needed("single")
    done = in_a_process("single", whole - entries / 2, tmp_path, "earlier")
    assert done.returncode == 1 and "InsufficientMemoryError" in done.stderr
    assert not list(tmp_path.iterdir())


def test_a_factor_is_refused_without_room_or_folder(tmp_path, monkeypatch):
    whole, entries = needed("single")
    monkeypatch.setattr("cmsreduce.linalg.sparse.pardiso.can_be_mapped", lambda: True)
    monkeypatch.setattr("cmsreduce.linalg.sparse.pardiso.free_on_disk", lambda folder: entries / 2)
    for scratch in (tmp_path, None):
        limited = SolverSettings("pardiso", memory=whole - entries / 2, scratch=scratch, replace_allocators=True)
        with solver_settings(limited), pytest.raises(InsufficientMemoryError):
            factorise(body().K)


def test_a_factor_is_refused_unless_allocators_may_be_replaced(tmp_path):
    whole, entries = needed("single")
    done = in_a_process("single", whole - entries / 2, tmp_path, "refused")
    assert done.returncode == 1 and "InsufficientMemoryError" in done.stderr
    assert not list(tmp_path.iterdir())


# Reduces a body large enough for both replacements, in a process that records every call of an allocator's functions.
UNTOUCHED = """
    import ctypes, sys
    from pathlib import Path
    from cmsreduce.linalg.machine import allocators, mkl_memory
    from cmsreduce.linalg.machine import SolverSettings, solver_settings
    from cmsreduce.reduce import CraigBampton
    from tests.solids import block

    changed = []
    allocators._LEAST_ROWS, mkl_memory._BYTES_A_ROW = 1000, 1e12
    class Watched:
        def __init__(self, library):
            self.__dict__["library"] = library
        def __getattr__(self, name):
            changed.append(name)
            return getattr(self.library, name)
    library, system = allocators._library, mkl_memory._system
    allocators._library = lambda: Watched(library())
    mkl_memory._system = lambda: Watched(system())

    body = block("bar", (1.0, 0.2, 0.2), (20, 4, 4))
    allowed = {"scratch": Path(sys.argv[1]), "replace_allocators": sys.argv[2] == "allowed"}
    with solver_settings(SolverSettings("pardiso", **allowed)):
        CraigBampton(1500.0).reduce(body, range(75))
    print(sorted({"mallopt", "mmap"} & set(changed) | ({"i_malloc"} if mkl_memory._ENTRIES.replaced else set())))
"""


@pytest.mark.parametrize(("how", "changed"), [("allowed", ["i_malloc", "mallopt"]), ("refused", [])])
def test_no_allocator_is_changed_unless_it_is_allowed(tmp_path, how, changed):
    command = [sys.executable, "-c", textwrap.dedent(UNTOUCHED), str(tmp_path), how]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=True)
    assert ast.literal_eval(done.stdout) == changed


def test_free_bytes_are_those_of_the_folder_s_disk(tmp_path):
    assert 0 < free_on_disk(tmp_path / "not" / "yet") == pytest.approx(free_on_disk(tmp_path), rel=0.01)
