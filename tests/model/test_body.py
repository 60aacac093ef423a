"""Bodies refuse matrices and inertias that no structure has."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.errors import DofMapError, MatrixError, SceneError
from cmsreduce.model import Damping, DofTable, FEModel, Interface, Nodes, RigidBody

DOFS = DofTable([1, 1, 2], [1, 2, 1])
GOOD = np.diag([3.0, 2.0, 1.0])


def with_entry(i, j, value):
    A = GOOD.copy()
    A[i, j] = value
    return sp.csc_array(A)


REFUSED = {
    "another size": ({"M": sp.csc_array(np.eye(2))}, r"mass matrix M is 2 x 2, but the dof table has 3 rows"),
    "not a number": ({"K": with_entry(1, 1, np.nan)}, r"stiffness matrix K holds nan at row 2 \(1\.2\), column 2"),
    "infinite": ({"M": with_entry(2, 2, np.inf)}, r"mass matrix M holds inf at row 3 \(2\.1\)"),
    "one triangle": (
        {"K": with_entry(0, 2, 0.3)},
        r"not symmetric: .* by 1\.00e-01 .*rows (1\.1 and 2\.1|2\.1 and 1\.1)",
    ),
    "upper triangle": ({"M": with_entry(0, 2, 0.3)}, r"holds its upper triangle only\. .* A \+ A\.T - diag\(A\)"),
    "lower triangle": ({"M": with_entry(2, 0, 0.3)}, r"holds its lower triangle only"),
    "turned": (
        {"K": sp.csc_array([[3.0, 0.3, 0], [-0.3, 2, 0], [0, 0, 1]])},
        r"passive structure is symmetric: name another matrix",
    ),
    "Lagrange multiplier": (
        {"K": sp.csc_array([[1e10, -1e10, 1.0], [-1e10, 1e10, -1.0], [1.0, -1.0, 0]])},
        r"not positive semidefinite: its diagonal is 0 at row 3 \(2\.1\), which has -?1 at 1\.[12], .* Lagrange",
    ),
    "mass cut after whole lines": (
        {"M": sp.csc_array([[2.0, 0.5, 0.5], [0.5, 2.0, 0.5], [0.5, 0.5, 0]])},
        r"its diagonal is 0 at row 3 \(2\.1\), which has 0\.5 at 1\.[12], as where a file was cut: write it again$",
    ),
    "two multipliers for each support": (
        {"K": sp.csc_array([[9.0, 5.0, 5.0], [5.0, -5.0, 5.0], [5.0, 5.0, -5.0]])},
        r"its diagonal is -5 at row 2 \(1\.2\)\. .* multipliers, as code_aster writes them .* by elimination",
    ),
    "unsymmetric damping": ({"D": with_entry(0, 1, 0.3)}, r"damping matrix D is not symmetric"),
    "penalty": (
        {"K": sp.csc_array([[1e36, 0.5, 0], [0.5, 1e36, 0], [0, 0, 1.0]])},
        r"holds 2 rows by a penalty, first 1\.1: 1e\+36 on the diagonal, as Abaqus",
    ),
    "damping twice": ({"D": sp.csc_array(GOOD), "damping": Damping(modal=0.1)}, "a damping matrix or a damping law"),
}


@pytest.mark.parametrize(("change", "message"), REFUSED.values(), ids=REFUSED)
def test_refused(change, message):
    given = {"K": sp.csc_array(GOOD), "M": sp.csc_array(GOOD)} | change
    with pytest.raises(MatrixError, match=f"body 'b': .*{message}|body 'b': give {message}"):
        FEModel("b", dofs=DOFS, **given)


@pytest.mark.parametrize(("rounding", "accepted"), [(2.0**-53, False), (6e-8, True)], ids=["double", "single"])
def test_symmetry_is_asked_to_the_digits_of_the_file(rounding, accepted):
    K = GOOD.copy()
    K[0, 1], K[1, 0] = 1.0, 1.0 + 1e-6
    if accepted:
        body = FEModel("b", sp.csc_array(K), sp.csc_array(GOOD), DOFS, rounding=rounding)
        assert body.K[0, 1] == body.K[1, 0] == pytest.approx(1.0 + 5e-7, abs=1e-12)
    else:
        with pytest.raises(MatrixError, match="not symmetric"):
            FEModel("b", sp.csc_array(K), sp.csc_array(GOOD), DOFS, rounding=rounding)


def test_an_entry_without_its_mirror_is_halved_if_it_is_rounding():
    body = FEModel("b", with_entry(0, 2, 1e-17), sp.csc_array(GOOD), DOFS)
    assert body.K[0, 2] == body.K[2, 0] == 5e-18


def test_round_off_beside_a_zero_on_the_diagonal_is_no_multiplier():
    A = sp.csc_array([[1e10, 0, 1e-6], [0, 1e10, 0], [1e-6, 0, 0]])
    assert FEModel("b", A, sp.csc_array(GOOD), DOFS).K[0, 2] == 1e-6


def test_a_changed_body_is_checked_where_it_changes():
    body = FEModel("b", sp.csc_array(GOOD), sp.csc_array(GOOD), DOFS)
    other = replace(body, name="c", M=sp.csc_array(2 * GOOD))
    assert other.K is body.K
    assert other.M[0, 0] == 6
    with pytest.raises(MatrixError, match="stiffness matrix K is not symmetric"):
        replace(other, K=with_entry(0, 2, 0.3))
    with pytest.raises(MatrixError, match="K is 3 x 3, but the dof table has 2 rows"):
        replace(other, dofs=DOFS[np.array([0, 1])])


def test_a_node_without_coordinates():
    with pytest.raises(DofMapError, match=r"1 nodes have rows .* no coordinates .* the first is 2"):
        FEModel("b", sp.csc_array(GOOD), sp.csc_array(GOOD), DOFS, Nodes.in_basic([1], [[0, 0, 0]]))


def test_rows_of_an_interface_are_node_by_node():
    dofs = DofTable([7, 7, 3, 3, 5], [2, 1, 1, 2, 1])
    face = Interface("f", np.array([3, 7]), ((1, 2), (1,)), np.zeros((2, 3)), np.eye(3))
    body = FEModel("b", sp.csc_array(np.eye(5)), sp.csc_array(np.eye(5)), dofs, interfaces={"f": face})
    assert body.interface_rows("f").tolist() == [2, 3, 1]
    with pytest.raises(SceneError, match=r"'b' has no interface 'g' \(it has: f\)"):
        body.interface_rows("g")


INERTIAS = {
    "a ball": (np.eye(3), True),
    "a slender rod": (np.diag([0.0, 1.0, 1.0]), True),
    "a flat plate": (np.diag([1.0, 2.0, 3.0]), True),
    "a rod whose digits are rounded": (np.diag([-1e-8, 1.0, 1.0]), True),
    "products too large": (np.array([[1.0, 2.0, 0], [2.0, 1.0, 0], [0, 0, 1.0]]), False),
    "no body": (np.diag([1.0, 1.0, 2.1]), False),
    "negative": (np.diag([-1.0, 1.0, 1.0]), False),
}


@pytest.mark.parametrize(("inertia", "exists"), INERTIAS.values(), ids=INERTIAS)
def test_inertias(inertia, exists):
    if exists:
        assert RigidBody("r", 1.0, np.zeros(3), inertia).mass == 1.0
    else:
        with pytest.raises(MatrixError, match="'r': no mass distribution has principal inertias"):
            RigidBody("r", 1.0, np.zeros(3), inertia)


@pytest.mark.parametrize("mass", [0.0, -1.0, float("nan")])
def test_masses(mass):
    with pytest.raises(MatrixError, match="is not positive"):
        RigidBody("r", mass, np.zeros(3), np.eye(3))


def test_matrices_made_of_long_indices_have_short_ones():
    """Entries with coordinates of 64 bits, as numpy counts: all matrices made of the body's would be longer, too."""
    at = np.arange(3)
    long = sp.csc_array(sp.coo_array((GOOD.diagonal(), (at, at)), shape=(3, 3)))
    assert long.indices.dtype == np.int64
    body = FEModel("b", long, long, DOFS, D=long)
    for A in (body.K, body.M, body.D):
        assert A.indices.dtype == A.indptr.dtype == np.int32
        assert np.array_equal(A.toarray(), GOOD)
