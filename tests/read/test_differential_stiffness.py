"""A user's geometric stiffness: put in the rows of the stiffness matrix, or refused if it does not fit that matrix."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from pyyeti.nastran import op4

from cmsreduce.errors import DofMapError, MatrixError
from cmsreduce.mechanics import bars_stiffness
from cmsreduce.model import FEModel, UnitLoad
from cmsreduce.read import MatrixSource, read_differential_stiffness
from tests.frames import BAR, line
from tests.mechanics.test_geometric_stiffness import chain


@pytest.fixture(scope="module")
def body() -> FEModel:
    return line("arm", [0, 0, 0], [1, 0.2, 0], 4)


@pytest.fixture(scope="module")
def stress(body: FEModel) -> np.ndarray:
    held = body.dofs.rows_of(1, range(1, 7))
    return bars_stiffness(body, chain(4, section=BAR), [UnitLoad("centrifugal", "zz")], held=held).matrices[0].toarray()


def stored(folder: Path, A: np.ndarray, kind: str = "op4") -> MatrixSource:
    path = folder / f"kg.{kind}"
    if kind == "op4":
        op4.write(str(path), {"KDAA": A})
    elif kind == "npz":
        sp.save_npz(path, sp.csc_array(A))
    elif kind == "mtx":
        scipy.io.mmwrite(path, sp.coo_array(A))
    else:
        scipy.io.savemat(path, {"KDAA": A})
    return MatrixSource(path, "KDAA" if kind in ("op4", "mat") else None)


@pytest.mark.parametrize("kind", ["op4", "npz", "mtx", "mat"])
def test_it_is_read_from_every_format_of_matrices(tmp_path: Path, body: FEModel, stress: np.ndarray, kind: str) -> None:
    found, remark = read_differential_stiffness(stored(tmp_path, stress, kind), body, "centrifugal zz")
    np.testing.assert_allclose(found.toarray(), stress, atol=1e-12 * abs(stress).max())
    assert remark == ""


def shuffled(A: np.ndarray, body: FEModel) -> np.ndarray:
    """The matrix with two nodes exchanged: forces still balance."""
    order = np.arange(body.n)
    order[0:6], order[18:24] = np.arange(18, 24), np.arange(0, 6)
    return A[np.ix_(order, order)]


def components_first(A: np.ndarray, body: FEModel) -> np.ndarray:
    order = np.lexsort((body.dofs.node, body.dofs.component))
    return A[np.ix_(order, order)]


REFUSED = {
    "too small": (lambda A, body: A[:-6, :-6], MatrixError, "24 x 24, but the stiffness has 30 rows"),
    "not symmetric": (lambda A, body: A + np.triu(A), MatrixError, "not symmetric"),
    "not finite": (lambda A, body: np.where(np.eye(body.n) > 0, np.nan, A), MatrixError, "not finite"),
    "nodes in another order": (shuffled, DofMapError, "does not couple"),
    "dofs in another order": (components_first, DofMapError, "another order"),
    "with the softening by spin": (lambda A, body: A - body.M.toarray(), DofMapError, "omega"),
}


@pytest.mark.parametrize("change, error, message", REFUSED.values(), ids=REFUSED.keys())
def test_a_matrix_that_does_not_fit_the_stiffness_is_refused(
    tmp_path: Path, body: FEModel, stress: np.ndarray, change, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message) as caught:
        read_differential_stiffness(stored(tmp_path, change(stress, body)), body, "centrifugal zz")
    assert "kg.op4 (centrifugal zz)" in str(caught.value)
