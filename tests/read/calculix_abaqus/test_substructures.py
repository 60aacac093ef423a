"""Substructures of Abaqus and CalculiX as text, condensed here."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.errors import DofMapError, ReadError
from cmsreduce.model import SCALAR
from cmsreduce.read import MatrixSource, matrix_names, read_body, read_matrix
from tests.frames import frame

XYZ = [[0.0, 0.0, 0.0], [0.3, 0.1, 0.0], [0.6, 0.0, 0.1], [0.5, 0.4, 0.2]]
NODES = (3, 1, 4)
MESH = (
    "*NODE\n" + "".join(f"{k + 1}, {x}, {y}, {z}\n" for k, (x, y, z) in enumerate(XYZ)) + "*ELEMENT, TYPE=B31\n1,1,2\n"
)


def full() -> tuple[np.ndarray, np.ndarray]:
    body = frame("frame", XYZ, [(1, 2), (2, 3), (2, 4), (3, 4)])
    return body.K.toarray(), body.M.toarray()


def condensed(modes: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and mass of a frame on its nodes 3, 1 and, without rotations, 4, and in its lowest modes there held."""
    K, M = full()
    kept = np.r_[12:18, 0:6, 18:21]
    others = np.setdiff1d(np.arange(24), kept)
    inside = np.ix_(others, others)
    T = np.zeros((24, 15 + modes))
    T[kept, :15] = np.eye(15)
    T[others, :15] = -la.solve(K[inside], K[np.ix_(others, kept)])
    T[others, 15:] = la.eigh(K[inside], M[inside])[1][:, :modes]
    return T.T @ K @ T, T.T @ M @ T


def text(K: np.ndarray, M: np.ndarray, nodes: Sequence[int] = NODES, unsymmetric: bool = False) -> str:
    """The file as Abaqus writes it: four numbers a line, and a new line for each row."""
    lines = ["**", "** GENERATION OF SUBSTRUCTURE Z1", "*USER ELEMENT, NODES=         3, LINEAR", "** ELEMENT NODES"]
    lines += [f"**{nodes[0]:11d}, {nodes[1]:11d}, ", f"**{nodes[2]:11d}", " 1, 2, 3, 4, 5, 6", " 3, 1, 2, 3"]
    for name, A in (("STIFFNESS", K), ("MASS", M)):
        lines.append(f"*MATRIX,TYPE={name}")
        for i, row in enumerate(A):
            part = row if unsymmetric and name == "STIFFNESS" else row[: i + 1]
            lines += [", ".join(f"{value:.13E}" for value in part[at : at + 4]) + "," for at in range(0, len(part), 4)]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("unsymmetric", [False, True])
def test_matrices_and_dofs(tmp_path: Path, unsymmetric: bool) -> None:
    K, M = condensed()
    path = tmp_path / "sub.mtx"
    path.write_text(text(K, M, unsymmetric=unsymmetric))
    assert [(info.name, info.rows) for info in matrix_names(path)] == [("STIFFNESS", 15), ("MASS", 15)]
    for name, A in (("stiffness", K), ("mass", M)):
        found = read_matrix(path, name)
        assert abs(found.A - A).max() <= 1e-12 * abs(A).max()
        assert found.rounding == pytest.approx(5e-14)
        assert found.dofs is not None
        assert found.dofs.labels == [
            f"{n}.{c}" for n, last in zip(NODES, (6, 6, 3), strict=True) for c in range(1, last + 1)
        ]


def test_rows_are_proven_by_the_mesh(tmp_path: Path) -> None:
    K, M = condensed()
    (tmp_path / "mesh.inp").write_text(MESH)
    path = tmp_path / "sub.mtx"
    path.write_text(text(K, M))
    sources = [MatrixSource(path, name) for name in ("STIFFNESS", "MASS")]
    body = read_body("x", stiffness=sources[0], mass=sources[1], geometry=tmp_path / "mesh.inp")
    lam = la.eigvalsh(body.K.toarray(), body.M.toarray())
    np.testing.assert_allclose(lam[6:], la.eigvalsh(K, M)[6:], rtol=1e-8)
    path.write_text(text(K, M, (1, 3, 4)))
    with pytest.raises(DofMapError, match="row order of the stiffness matrix"):
        read_body("x", stiffness=sources[0], mass=sources[1], geometry=tmp_path / "mesh.inp")


@pytest.mark.parametrize("component", ["1", "UX", "0"])
def test_modes_are_numbers_without_a_place(tmp_path: Path, component: str) -> None:
    """All nine modes: the superelement is the frame in other coordinates, and has its frequencies."""
    K, M = condensed(9)
    (tmp_path / "mesh.inp").write_text(MESH)
    scipy.io.mmwrite(tmp_path / "K.mtx", sp.coo_array(K), precision=17)
    scipy.io.mmwrite(tmp_path / "M.mtx", sp.coo_array(M), precision=17)
    dofs = [f"{n}.{c}" for n, last in zip(NODES, (6, 6, 3), strict=True) for c in range(1, last + 1)]
    modes = [f"{101 + k}{' ' if component == 'UX' else '.'}{component}" for k in range(9)]
    (tmp_path / "rows.txt").write_text("\n".join([*dofs, *modes]) + "\n")
    body = read_body(
        "x",
        stiffness=MatrixSource(tmp_path / "K.mtx"),
        mass=MatrixSource(tmp_path / "M.mtx"),
        geometry=tmp_path / "mesh.inp",
        rows=tmp_path / "rows.txt",
    )
    assert (body.dofs.component[-9:] == SCALAR).all()
    np.testing.assert_allclose(la.eigvalsh(body.K.toarray(), body.M.toarray())[6:], la.eigvalsh(*full())[6:], rtol=1e-8)


def test_a_node_that_the_deck_lacks_is_no_mode(tmp_path: Path) -> None:
    """Where each node has one row, a number without a place is a node that was left out."""
    K = 2 * np.eye(6) - np.eye(6, k=1) - np.eye(6, k=-1)
    scipy.io.mmwrite(tmp_path / "K.mtx", sp.coo_array(K))
    (tmp_path / "rows.txt").write_text("\n".join(f"{k}.1" for k in range(1, 7)))
    (tmp_path / "m.bdf").write_text("".join(f"GRID,{k},,{k}.,0.,0.\n" for k in (1, 2, 3, 5, 6)))
    source = MatrixSource(tmp_path / "K.mtx")
    with pytest.raises(DofMapError, match="1 nodes have rows in the matrices but no coordinates"):
        read_body("x", stiffness=source, mass=source, geometry=tmp_path / "m.bdf", rows=tmp_path / "rows.txt")


def test_calculix_lists_a_node_for_each_dof(tmp_path: Path) -> None:
    path = tmp_path / "sub.mtx"
    head = "**\n*USER ELEMENT,NODES=         3,LINEAR\n** ELEMENT NODES\n** 7, 7, 9,\n"
    path.write_text(
        f"{head}         1\n         2,         3\n         3,         1\n*MATRIX,TYPE=STIFFNESS\n1,\n2,3,\n4,5,6,\n"
    )
    found = read_matrix(path)
    assert found.dofs is not None and found.dofs.labels == ["7.1", "7.3", "9.1"]
    assert found.A.toarray().tolist() == [[1, 2, 4], [2, 3, 5], [4, 5, 6]]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("** ELEMENT NODES\n", "", "nodes of the substructure are not there"),
        ("** ", "** 2, -1, ", "nodes of the substructure are not there"),
        (" 3, 1, 2, 3", " 3, 1, 2, 3, 11", "dof 11 of the substructure is no displacement"),
        (" 3, 1, 2, 3\n", "", r"has 120 numbers, and its 18 dofs ask for 171 \(or 324"),
        ("MASS\n", "MASS\n1.0, ", "matrix 'MASS' has 121 numbers"),
        ("*MATRIX,TYPE=MASS", "*ELSE", r"'\*ELSE' in matrix 'STIFFNESS' is no number; write each substructure"),
        ("MASS\n", "MASS\nx, ", "'x, .*' in matrix 'MASS' is no number; write the file again"),
    ],
)
def test_damaged_files_are_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = tmp_path / "sub.mtx"
    content = text(*condensed())
    assert old in content
    head, _, rest = content.partition("** ELEMENT")
    path.write_text(head + f"** ELEMENT{rest}".replace(old, new, 1) if old == "** " else content.replace(old, new, 1))
    with pytest.raises(ReadError, match=message):
        for info in matrix_names(path):
            read_matrix(path, info.name)


def test_a_file_that_is_cut_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "sub.mtx"
    content = text(*condensed())
    path.write_text(content[: content.rindex("\n", 0, -2) + 1])
    with pytest.raises(ReadError, match=r"matrix 'MASS' has 117 numbers, and its 15 dofs ask for 120"):
        read_matrix(path, "MASS")
