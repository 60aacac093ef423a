"""A mesh that a run asks for several times is read once by its library, and again when its content is another."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import h5py
import meshio
import numpy as np
import pytest

from cmsreduce.errors import ReadError
from cmsreduce.read import read_cells, read_geometry

POINTS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]])


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """Grows with each process that is started."""
    calls, run = list[object](), subprocess.run

    def count(command: object, **named: object) -> object:
        calls.append(command)
        return run(command, **named)

    monkeypatch.setattr("cmsreduce.read.libraries.subprocess.run", count)
    return calls


def written(path: Path, points: np.ndarray) -> Path:
    meshio.Mesh(points, [("tetra", [[0, 1, 2, 3]])]).write(path)
    return path


@pytest.mark.parametrize("name", ["a.msh", "a.vtu", "a.vtk"])
def test_nodes_and_elements_need_one_process(tmp_path: Path, started: list[object], name: str) -> None:
    path = written(tmp_path / name, POINTS)
    first = read_geometry(path)
    assert {kind: cells.tolist() for kind, cells in read_cells(path).items()} == {"tetra": [[1, 2, 3, 4]]}
    np.testing.assert_array_equal(read_geometry(path).nodes.xyz, first.nodes.xyz)
    assert len(started) == 1


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
