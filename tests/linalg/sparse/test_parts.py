"""Parts of a large matrix take the order of the whole; a kept factor is found again for an equal matrix only."""

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.linalg import sparse
from cmsreduce.linalg.machine import SolverSettings, settings, solver_settings
from cmsreduce.linalg.sparse import determinate_dofs, factorise, lend_order, part, principal_part, share_order


def plate(side: int) -> sp.csc_array:
    """Laplacian of a square grid, held a little everywhere."""
    line = sp.diags_array([2.0 * np.ones(side), -np.ones(side - 1), -np.ones(side - 1)], offsets=[0, 1, -1])
    one = sp.eye_array(side)
    return sp.csc_array(sp.kron(line, one) + sp.kron(one, line) + 1e-3 * sp.eye_array(side * side))


@pytest.fixture
def large(monkeypatch):
    """A matrix of 1600 rows counts as large."""
    for module in (sparse.parts, sparse.factorisation):
        monkeypatch.setattr(module, "LARGE", 1000)
    return plate(40)


def test_a_part_is_factorised_in_the_order_of_the_whole(large, monkeypatch):
    rows = np.setdiff1d(np.arange(large.shape[0]), [0, 41, 777])
    with solver_settings(SolverSettings()):
        order = share_order(large)
        with monkeypatch.context() as without:
            without.setattr(sparse.multifrontal, "nested_dissection", None)
            without.setattr(sparse.parts, "nested_dissection", None)
            inner = part(large, rows)
            factor = factorise(inner)
            again = share_order(large)
    assert np.array_equal(again, order)
    assert np.array_equal(np.sort(order), np.arange(large.shape[0]))
    assert abs(inner - large[rows][:, rows]).max() == 0
    assert factor.backend == "multifrontal"
    b = np.cos(np.arange(rows.size))
    assert np.linalg.norm(inner @ factor(b) - b) <= 1e-12 * np.linalg.norm(b)
    own = factorise(inner)
    assert factor.cost.nnz <= 1.3 * own.cost.nnz


@pytest.mark.parametrize("kept", [0.0, 0.01, 0.5, 1.0])
def test_rows_and_columns_are_cut_out_over_several_blocks(kept):
    """Unsymmetric, so that rows are not taken for columns; 9000 columns are three blocks."""
    rng = np.random.default_rng(3)
    A = sp.random_array((9000, 9000), density=1e-3, format="csc", rng=rng)
    rows = np.flatnonzero(rng.random(9000) < kept)
    inner, wanted = principal_part(A, rows), A[rows][:, rows]
    inner.check_format()
    assert inner.shape == wanted.shape
    assert inner.nnz == wanted.nnz
    assert (inner != wanted).nnz == 0


def test_a_matrix_may_borrow_the_order_of_another_of_as_many_rows(large):
    """A mass of three equal parts, such as that of a solid, is counted in the order of the stiffness."""
    mass = sp.csc_array(sp.diags_array(np.linspace(1.0, 2.0, large.shape[0])))
    with solver_settings(SolverSettings()):
        assert not np.array_equal(share_order(mass), order := share_order(large))
    with solver_settings(SolverSettings()):
        share_order(large)
        assert np.array_equal(share_order(mass, borrowed=True), order)
        assert share_order(plate(41), borrowed=True).size == 41**2


def test_a_mass_with_further_rows_is_ordered_as_the_stiffness_is_and_these_rows_last(large):
    m = large.shape[0] + 50
    rows = np.random.default_rng(2).permutation(m)[: large.shape[0]]
    # Two rows of the stiffness, such as those of a tied point, are not in the mass.
    rows[[4, 7]] = -1
    mass = sp.csc_array(sp.diags_array([np.ones(m), np.full(m - 1, 0.1), np.full(m - 1, 0.1)], offsets=[0, 1, -1]))
    with solver_settings(SolverSettings()):
        order = share_order(large)
        lend_order(large, rows, mass)
        found = share_order(mass)
    placed = rows[order]
    assert np.array_equal(found[: m - 52], placed[placed >= 0])
    assert np.array_equal(np.sort(found), np.arange(m))


def test_a_kept_factor_is_found_for_the_same_matrix_and_for_no_other(large):
    with solver_settings(SolverSettings()) as settings:
        first = factorise(large, kept=True)
        assert factorise(large.copy(), kept=True) is first
        assert len(settings.work) == 1
        changed = large.copy()
        changed.data[0] *= 1 + 1e-15
        assert factorise(changed, kept=True) is not first
        assert factorise(large) is not first


def test_factors_beyond_their_share_of_the_memory_are_not_kept(large):
    size = factorise(large).cost.bytes
    with solver_settings(SolverSettings(memory=3 * size)):
        assert factorise(large, kept=True) is not factorise(large, kept=True)


def test_kept_factors_leave_their_memory_to_new_ones(large, monkeypatch):
    with solver_settings(SolverSettings()) as current:
        first = factorise(large, kept=True)
        monkeypatch.setattr(settings, "available_memory", lambda: 0.0 if first in current.factors else 1e12)
        factorise(sp.csc_array(large * 2))
        assert first not in current.factors


def test_determinate_dofs_depend_on_the_span_alone():
    rng = np.random.default_rng(3)
    x, y = np.meshgrid(np.arange(5.0), np.arange(4.0))
    motions = np.zeros((40, 3))
    motions[0::2, 0] = motions[1::2, 1] = 1
    motions[0::2, 2], motions[1::2, 2] = -y.ravel(), x.ravel()
    chosen = determinate_dofs(motions)
    assert np.linalg.svd(motions[chosen], compute_uv=False)[-1] > 0.1
    for _ in range(5):
        mixed = motions @ rng.normal(size=(3, 3)) * (1 + 1e-9 * rng.normal(size=(40, 1)))
        assert np.array_equal(determinate_dofs(mixed), chosen)
