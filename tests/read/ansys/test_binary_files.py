"""Binary files and archives of ANSYS, read by ansys-mapdl-reader: the examples that come with the library."""

from __future__ import annotations

import importlib.util
import struct
import subprocess
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.errors import ReadError
from cmsreduce.read import MatrixSource, detect_format, matrix_names, read_body, read_cells, read_geometry
from cmsreduce.read.ansys.full_file import library_refused

LIBRARY = importlib.util.find_spec("ansys.mapdl") if importlib.util.find_spec("ansys") else None
installed = pytest.mark.skipif(LIBRARY is None, reason="needs ansys-mapdl-reader (pip install 'cmsreduce[ansys]')")


@pytest.fixture
def examples() -> Path:
    assert LIBRARY is not None and LIBRARY.submodule_search_locations
    return Path(LIBRARY.submodule_search_locations[0]) / "reader" / "examples"


@installed
def test_a_held_beam(examples: Path) -> None:
    """ANSYS 15, 40 bricks of 20 nodes, 63 dofs held; its frequencies in the manual of the library."""
    full = examples / "file.full"
    assert detect_format(full) == "ansys-full"
    assert [(info.name, info.rows) for info in matrix_names(full)] == [("K", 900), ("M", 900)]
    files = {"stiffness": MatrixSource(full, "K"), "mass": MatrixSource(full, "M")}
    body = read_body("beam", **files, geometry=examples / "file.rst", grounded=True)
    assert body.nodes is not None and not np.isin(np.arange(1, 22), body.dofs.node).any()
    hz = np.sqrt(la.eigh(body.K.toarray(), body.M.toarray(), eigvals_only=True, subset_by_index=[0, 3])) / 2 / np.pi
    np.testing.assert_allclose(hz, [1283.200, 1283.200, 5781.975, 6919.399], rtol=1e-6)


@installed
def test_elements_of_an_archive(examples: Path) -> None:
    cells = read_cells(examples / "sector.cdb")
    assert {kind: len(each) for kind, each in cells.items()} == {"hexahedron": 101, "wedge": 4}


@installed
def test_an_archive_of_nodes_alone(tmp_path: Path) -> None:
    """CDWRITE of a selection without elements; the message was about an attribute of None."""
    path = tmp_path / "nodes.cdb"
    rows = "".join(f"{k:9d}{0:9d}{0:9d}{0.1 * k:21.13E}{0.2:21.13E}{-0.3:21.13E}\n" for k in (7, 9, 12))
    path.write_text(f"/PREP7\nNBLOCK,6,SOLID,12,3\n(3i9,6e21.13e3)\n{rows}N,R5.3,LOC,-1,\n")
    nodes = read_geometry(path).nodes
    assert nodes.id.tolist() == [7, 9, 12] and read_cells(path) == {}
    np.testing.assert_allclose(nodes.xyz, [[0.7, 0.2, -0.3], [0.9, 0.2, -0.3], [1.2, 0.2, -0.3]])


@pytest.mark.parametrize(
    ("kind", "changes", "message"),
    [
        (8, {}, r"\.sub.*no matrices are read; write them as text"),
        (31, {}, "kind 31"),
        (4, {10: 1}, "a lumped mass, which .* \\*EXPORT"),
        (4, {13: 1}, "not symmetric"),
        (4, {20: 7}, "7 constraint equations"),
        (4, {1: -5}, "claims"),
    ],
)
def test_what_the_library_does_not_read_is_refused(
    tmp_path: Path, kind: int, changes: dict[int, int], message: str
) -> None:
    header = [changes.get(place, {1: 963, 2: 900}.get(place, 0)) for place in range(100)]
    path = tmp_path / "file.full"
    path.write_bytes(struct.pack("<103i", 100, -(2**31), kind, *[0] * 100) + struct.pack("<102i", 100, 0, *header))
    assert detect_format(path) == "ansys-full"
    with pytest.raises(ReadError, match=message):
        matrix_names(path)


def test_without_the_library_the_message_says_how_to_install_it() -> None:
    assert "pip install 'cmsreduce[ansys]'" in str(library_refused(Path("a.full"), "No module named 'ansys'"))


def test_a_busy_machine_is_not_taken_for_a_damaged_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def late(*args: object, **options: object) -> None:
        raise subprocess.TimeoutExpired("python", 30.0)

    monkeypatch.setattr("cmsreduce.read.libraries.arrays.subprocess.run", late)
    path = tmp_path / "body.cdb"
    path.write_text("NBLOCK,6,SOLID\n")
    with pytest.raises(ReadError, match=r"stopped after 30 s, .* less than 5 s of a processor: run again") as found:
        read_geometry(path)
    assert "damaged" not in str(found.value)
