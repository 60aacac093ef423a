"""A mesh that a run asks for several times is read once by its library, and again when its content is another."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import h5py
import meshio
import numpy as np
import pytest

from cmsreduce.errors import ReadError
from cmsreduce.read import read_cells, read_geometry, read_matrix
from cmsreduce.read.libraries import arrays, arrays_of
from tests.read.mesh.test_universal import write as write_universal

POINTS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]])


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """Grows with each process that is started."""
    calls, run = list[object](), subprocess.run

    def count(command: object, **named: object) -> object:
        calls.append(command)
        return run(command, **named)

    monkeypatch.setattr("cmsreduce.read.libraries.arrays.subprocess.run", count)
    return calls


def written(path: Path, points: np.ndarray) -> Path:
    meshio.Mesh(points, [("tetra", [[0, 1, 2, 3]])]).write(path)
    return path


@pytest.mark.parametrize("name", ["a.msh", "a.vtu", "a.vtk", "a.mesh", "a.meshb", "a.mdpa"])
def test_nodes_and_elements_need_one_process(tmp_path: Path, started: list[object], name: str) -> None:
    path = written(tmp_path / name, POINTS)
    first = read_geometry(path)
    assert {kind: cells.tolist() for kind, cells in read_cells(path).items()} == {"tetra": [[1, 2, 3, 4]]}
    np.testing.assert_array_equal(read_geometry(path).nodes.xyz, first.nodes.xyz)
    assert len(started) == 1


def med(path: Path) -> None:
    written(path, POINTS)


def universal(path: Path) -> None:
    pytest.importorskip("pyuff", reason="needs pyuff (pip install 'cmsreduce[uff]')")
    write_universal(path, 2411)


def ansys(example: str) -> Callable[[Path], None]:
    def copied(path: Path) -> None:
        reader = pytest.importorskip("ansys.mapdl.reader", reason="needs ansys-mapdl-reader")
        shutil.copy(Path(reader.__file__).parent / "examples" / example, path)

    return copied


@pytest.mark.parametrize(
    ("name", "make"),
    [("a.med", med), ("a.unv", universal), ("a.cdb", ansys("sector.cdb")), ("job.rst", ansys("file.rst"))],
)
def test_other_files_of_libraries_need_one_process(
    tmp_path: Path, started: list[object], name: str, make: Callable[[Path], None]
) -> None:
    make(tmp_path / name)
    first = read_geometry(tmp_path / name)
    read_cells(tmp_path / name)
    np.testing.assert_array_equal(read_geometry(tmp_path / name).nodes.xyz, first.nodes.xyz)
    assert len(started) == 1


@pytest.mark.parametrize("name", ["job0.rst", "job10.RST"])
def test_a_distributed_result_is_read_anew(tmp_path: Path, started: list[object], name: str) -> None:
    """Parts of it lie in job1.rst and so on, which may change."""
    ansys("file.rst")(tmp_path / name)
    for processes in (1, 2):
        read_geometry(tmp_path / name)
        assert len(started) == processes


def test_matrices_of_ansys_need_one_process(tmp_path: Path, started: list[object]) -> None:
    ansys("file.full")(tmp_path / "file.full")
    for name in ("K", "M", "K"):
        assert read_matrix(tmp_path / "file.full", name).A.shape == (900, 900)
    assert len(started) == 1


def refused(reason: str) -> ReadError:
    return ReadError(reason)


def test_a_fifth_file_drops_the_one_asked_for_longest_ago(tmp_path: Path, started: list[object]) -> None:
    files = [written(tmp_path / f"{k}.vtu", (k + 1) * POINTS) for k in range(5)]
    for path in (*files[:4], files[0], files[4]):
        arrays_of(path, "mesh", refused)
    assert len(started) == 5
    for path in (files[0], files[2], files[3], files[4]):
        arrays_of(path, "mesh", refused)
    assert len(started) == 5
    np.testing.assert_array_equal(arrays_of(files[1], "mesh", refused)["points"], 2 * POINTS)
    assert len(started) == 6


def test_large_arrays_are_not_held(tmp_path: Path, started: list[object], monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(tmp_path / "a.vtu", POINTS)
    held = sum(array.nbytes for array in arrays_of(path, "mesh", refused).values())
    arrays._HELD.clear()
    for limit, processes in ((held - 1, 3), (held, 4)):
        monkeypatch.setattr(arrays, "_BYTES_HELD", limit)
        for _ in range(2):
            arrays_of(path, "mesh", refused)
        assert len(started) == processes


def test_arrays_that_are_held_cannot_be_written(tmp_path: Path) -> None:
    path = written(tmp_path / "a.vtu", POINTS)
    for _ in range(2):
        arrays = arrays_of(path, "mesh", refused)
        assert not any(array.flags.writeable for array in arrays.values())
        # The mapping is the caller's own.
        arrays.clear()


def test_another_content_is_read_anew(tmp_path: Path, started: list[object]) -> None:
    """Also under the time of the first one, as a copy that keeps times has it."""
    path = written(tmp_path / "a.vtu", POINTS)
    state = path.stat()
    for factor in (1.0, 2.0, 1.0):
        written(path, factor * POINTS)
        os.utime(path, ns=(state.st_atime_ns, state.st_mtime_ns))
        np.testing.assert_array_equal(read_geometry(path).nodes.xyz, factor * POINTS)
    path.write_text("no mesh any more")
    with pytest.raises(ReadError, match="no geometry in a format that is known"):
        read_geometry(path)
    assert len(started) == 3


def test_arrays_beside_the_file_are_read_anew(tmp_path: Path) -> None:
    """An .xdmf file stays as it is when the .h5 file beside it changes."""
    path = written(tmp_path / "a.xdmf", POINTS)
    before = path.read_bytes()
    np.testing.assert_array_equal(read_geometry(path).nodes.xyz, POINTS)
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        (points,) = (name for name, item in file.items() if item.shape == POINTS.shape and item.dtype.kind == "f")
        file[points][...] = 2 * POINTS
    assert path.read_bytes() == before
    np.testing.assert_array_equal(read_geometry(path).nodes.xyz, 2 * POINTS)
