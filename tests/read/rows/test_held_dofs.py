"""Rows of supports that programs leave in the matrices as equations of their own."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.errors import DofMapError
from cmsreduce.model import DofTable, FEModel
from cmsreduce.read import MatrixSource, prove_row_order, read_body
from cmsreduce.read.labelled_matrix import LabelledMatrix
from cmsreduce.read.rows import without_support_rows
from tests.solids import block


def with_support_rows(held: np.ndarray, k: float, m: float | None, folder: Path) -> tuple[FEModel, FEModel]:
    """A block as read from files in which the held rows and columns are zero but for their diagonal; and the block.

    A penalty stays beside the other numbers of its row, and a mass of None stays as it is.
    """
    body = block("bar", [1.0, 0.3, 0.2], [4, 2, 2])
    for name, A, one in (("k", body.K, k), ("m", body.M, m)):
        A = A.toarray()
        if one is not None and one < 1e20:
            A[held], A[:, held] = 0.0, 0.0
        if one is not None:
            A[held, held] = one
        sp.save_npz(folder / f"{name}.npz", sp.csc_array(A))
    assert body.nodes is not None
    mesh = meshio.Mesh(body.nodes.xyz, [("vertex", np.arange(len(body.nodes))[:, None])])
    mesh.write(folder / "mesh.vtu")
    sources = {"stiffness": MatrixSource(folder / "k.npz"), "mass": MatrixSource(folder / "m.npz")}
    return read_body("bar", geometry=folder / "mesh.vtu", **sources), body


@pytest.mark.parametrize(("k", "m"), [(1.0, 1.0), (1.0, 0.0), (1e9, 1.0), (1.0, 2.3e-308), (1.0, None), (1e30, None)])
@pytest.mark.parametrize(("components", "motions"), [((1,), 3), ((1, 2, 3), 0)], ids=["plane of symmetry", "clamped"])
def test_rows_of_supports_are_left_out(tmp_path: Path, k: float, m: float, components: tuple, motions: int) -> None:
    body = block("bar", [1.0, 0.3, 0.2], [4, 2, 2])
    assert body.nodes is not None
    end = body.nodes.id[body.nodes.xyz[:, 0] == body.nodes.xyz[:, 0].min()]
    held = np.flatnonzero(np.isin(body.dofs.node, end) & np.isin(body.dofs.component, components))
    found, body = with_support_rows(held, k, m, tmp_path)
    kept = np.setdiff1d(np.arange(body.n), held)
    exact = la.eigh(body.K.toarray()[np.ix_(kept, kept)], body.M.toarray()[np.ix_(kept, kept)], eigvals_only=True)
    own = la.eigh(found.K.toarray(), found.M.toarray(), eigvals_only=True)
    np.testing.assert_allclose(own[motions:], exact[motions:], rtol=1e-9)
    proof = prove_row_order(found)
    assert (proof.status, proof.motions) == ("proven", motions)
    assert f"{held.size} rows have nothing but one number on the diagonal" in found.remarks[0]


@pytest.mark.parametrize(("k", "m"), [(1.0, 1.0), (3e9, 1.0), (3e9, 0.0)])
@pytest.mark.parametrize("across", [False, True], ids=["rows", "columns"])
def test_rows_of_supports_whose_columns_stay_are_left_out(across: bool, k: float, m: float) -> None:
    """Programs that zero the rows alone leave an unsymmetric matrix, whose columns act on nothing; or the transpose."""
    body = block("bar", [1.0, 0.3, 0.2], [4, 2, 2])
    K, M = body.K.toarray(), body.M.toarray()
    K[:27], M[:27] = 0.0, 0.0
    K[range(27), range(27)], M[range(27), range(27)] = k, m
    K, M = (K.T, M.T) if across else (K, M)
    parts = [LabelledMatrix(sp.csc_array(A), "a", Path("a.npz"), "numpy", 0.0, body.dofs) for A in (K, M)]
    left, found, held = without_support_rows(body.dofs, parts, None)
    assert (len(left), len(held)) == (body.n - 27, 27)
    for one, A in zip(found, (body.K, body.M), strict=True):
        assert abs(one.A.toarray() - A.toarray()[27:, 27:]).max() == 0.0


@pytest.mark.parametrize(
    ("own", "mass"), [((1.0, 2.0), 1.0), ((4.0, 4.0), 3.0), ((0.0, 0.0), 1.0)], ids=["unlike", "alike", "no stiffness"]
)
def test_masses_of_their_own_are_no_supports(own: tuple[float, float], mass: float) -> None:
    """Two masses on springs to ground, or on none, are motions."""
    table = DofTable(np.repeat([1, 2, 3], 2), np.tile([1, 2], 3))
    K = np.diag([0.0, 5.0, 0.0, 5.0, 0.0, 5.0])
    K[1::2, 1::2] = 5 * np.eye(3) - 1
    K[0, 0], K[2, 2] = own
    parts = [LabelledMatrix(sp.csc_array(A), "a", Path("a.npz"), "numpy", 0.0, table) for A in (K, mass * np.eye(6))]
    left, _, held = without_support_rows(table, parts, None)
    assert (len(left), len(held)) == (6, 0)


def test_empty_rows_that_explain_the_forces_are_named(tmp_path: Path) -> None:
    body = block("bar", [1.0, 0.3, 0.2], [4, 2, 2])
    assert body.nodes is not None
    end = body.nodes.id[body.nodes.xyz[:, 0] == body.nodes.xyz[:, 0].min()]
    for components in ((1,), (1, 2, 3)):
        held = np.flatnonzero(np.isin(body.dofs.node, end) & np.isin(body.dofs.component, components))
        with pytest.raises(DofMapError, match=rf"Likely cause: {held.size} rows of the stiffness are empty"):
            with_support_rows(held, 0.0, 0.0, tmp_path)
