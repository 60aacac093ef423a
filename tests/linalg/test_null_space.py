"""Null spaces of constraints, rigid-body modes and mechanisms of frames."""

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.null_space import null_space, rigid_body_modes, row_basis, stiffness_null_space
from cmsreduce.model import rigid_body_shapes
from tests.frames import frame, line

XYZ = [[0, 0, 0], [1, 0, 0], [1, 1, 0.2], [0, 1, 0], [0.4, 0.5, 0.8]]
BARS = [(1, 2), (2, 3), (3, 4), (4, 1), (1, 5), (2, 5), (3, 5)]


def ranked(c: int, m: int, rank: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.standard_normal((c, rank)) @ rng.standard_normal((rank, m))


CONSTRAINTS = {
    "full rank": (ranked(4, 9, 4), 4),
    "dependent rows": (ranked(7, 9, 3), 3),
    "square": (ranked(5, 5, 5), 5),
    "more rows than columns": (ranked(9, 4, 4), 4),
    "unlike units": (np.diag([1e4, 1.0, 1e-3]) @ ranked(3, 6, 3), 3),
    "zero rows": (np.vstack([np.zeros((2, 6)), ranked(2, 6, 2)]), 2),
    "nothing but zeros": (np.zeros((3, 4)), 0),
    "no rows": (np.zeros((0, 4)), 0),
    "no columns": (np.zeros((3, 0)), 0),
}


@pytest.mark.parametrize(("A", "rank"), CONSTRAINTS.values(), ids=CONSTRAINTS)
def test_null_space(A, rank):
    N, found = null_space(A)
    assert (found, N.shape) == (rank, (A.shape[1], A.shape[1] - rank))
    np.testing.assert_allclose(N.T @ N, np.eye(N.shape[1]), atol=1e-13)
    sizes = np.linalg.norm(A, axis=1, keepdims=True)
    np.testing.assert_allclose((A / np.where(sizes > 0, sizes, 1)) @ N, 0, atol=1e-13)


@pytest.mark.parametrize(("A", "rank"), [case for name, case in CONSTRAINTS.items() if name != "no columns"])
def test_row_basis(A, rank):
    U = row_basis(A)
    assert U.shape == (rank, A.shape[0])
    if rank:
        s = la.svdvals(U @ A)
        assert s[-1] > 1e-8 * s[0]
        assert null_space(np.vstack([U @ A, A]))[1] == rank


def held(*rows: int):
    """The frame with rows taken out."""
    body = frame("frame", XYZ, BARS)
    keep = np.setdiff1d(np.arange(body.n), rows)
    R = rigid_body_shapes(body.dofs, body.nodes)
    return body.K[keep][:, keep], body.M[keep][:, keep], R[keep]


def hinged():
    """Two bars that share the translations of their middle node only: three mechanisms beside six rigid motions."""
    one, two = line("one", [0, 0, 0], [1, 0, 0], 2), line("two", [1, 0, 0], [1.5, 0.8, 0.3], 2)
    T = np.zeros((36, 33))
    T[:18, :18] = np.eye(18)
    T[18:21, 12:15] = np.eye(3)
    T[21:, 18:] = np.eye(15)
    R = np.vstack([rigid_body_shapes(body.dofs, body.nodes) for body in (one, two)])
    K, M = (la.block_diag(*(getattr(body, A).toarray() for body in (one, two))) for A in "KM")
    return sp.csc_array(T.T @ K @ T), sp.csc_array(T.T @ M @ T), la.lstsq(T, R)[0]


BODIES = {
    "free": (held(), 6),
    "one node pinned": (held(0, 1, 2), 3),
    "two nodes pinned": (held(0, 1, 2, 6, 7, 8), 1),
    "statically determinate": (held(0, 1, 2, 7, 8, 14), 0),
    "clamped": (held(*range(6)), 0),
    "rolls along x": (held(1, 2, 3, 4, 5), 1),
    "hinge in the middle": (hinged(), 9),
}


@pytest.mark.parametrize("geometry", [True, False], ids=["geometry", "no geometry"])
@pytest.mark.parametrize(("body", "count"), BODIES.values(), ids=BODIES)
def test_rigid_motions_and_mechanisms_are_counted(body, count, geometry):
    K, M, R = body
    Phi = rigid_body_modes(K, M, R if geometry else None, 2.0**-53, "body")
    assert Phi.shape == (K.shape[0], count)
    np.testing.assert_allclose(Phi.T @ (M @ Phi), np.eye(count), atol=1e-11)
    assert abs(K @ Phi).max(initial=0.0) < 1e-11 * abs(K).max() * abs(Phi).max(initial=1.0)
    # As many zero frequencies as any dense solver sees.
    lam = la.eigvalsh(K.toarray(), M.toarray())
    assert np.count_nonzero(lam < 1e-9 * np.median(lam)) == count


@pytest.mark.parametrize("geometry", [True, False], ids=["geometry", "no geometry"])
def test_a_body_beyond_dense_algebra(geometry):
    body = line("mast", [0, 0, 0], [3, 1, 0.5], 110)
    R = rigid_body_shapes(body.dofs, body.nodes) if geometry else None
    Phi = rigid_body_modes(body.K, body.M, R, body.rounding, "mast")
    assert Phi.shape == (666, 6)
    # All of the mass takes part in translation.
    T = rigid_body_shapes(body.dofs, body.nodes)[:, :3]
    np.testing.assert_allclose(((Phi.T @ (body.M @ T)) ** 2).sum(axis=0), 2700 * 4e-4 * np.sqrt(10.25), rtol=1e-9)


@pytest.mark.parametrize("elements", [20, 60, 100])
@pytest.mark.parametrize(("digits", "rounding"), [(None, 6e-8), (9, 5e-10), (8, 5e-9)], ids=["single", "9", "8"])
def test_coarse_files_do_not_turn_bending_into_a_mechanism(elements, digits, rounding):
    body = line("slender", [0, 0, 0], [1.3, 0.7, 0.2], elements)
    K = body.K.copy()
    K.data = K.data.astype(np.float32) if digits is None else np.array([float(f"{x:.{digits - 1}e}") for x in K.data])
    K = sp.csc_array((K + K.T) / 2)
    R = rigid_body_shapes(body.dofs, body.nodes)
    assert rigid_body_modes(K, body.M, R, rounding, "slender").shape[1] == 6
    if elements < 60:
        assert stiffness_null_space(K, rounding).shape[1] == 6


def test_an_unheld_scalar_dof_is_a_motion_of_its_own():
    K, M = sp.diags_array([4.0, 0.0, 2.0], format="csc"), sp.diags_array([1.0, 9.0, 1.0], format="csc")
    np.testing.assert_allclose(abs(rigid_body_modes(K, M, None, 2.0**-53, "body")), [[0], [1 / 3], [0]], atol=1e-15)


def test_a_motion_without_mass_is_refused():
    body = line("rod", [0, 0, 0], [1, 0, 0], 3)
    spin = body.dofs.component == 4
    M = body.M.toarray()
    M[np.ix_(spin, spin)] = 0.0
    with pytest.raises(MatrixError, match=r"'rod'.*carries no mass"):
        rigid_body_modes(body.K, sp.csc_array(M), rigid_body_shapes(body.dofs, body.nodes), body.rounding, "rod")
