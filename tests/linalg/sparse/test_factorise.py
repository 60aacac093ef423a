"""Sparse factors of every installed solver, compared with dense algebra."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from threadpoolctl import threadpool_limits

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.machine import SolverSettings, allowed_threads, solver_settings
from cmsreduce.linalg.machine.settings import KnownFactors, KnownOrders
from cmsreduce.linalg.sparse import (
    BLOCK,
    InsufficientMemoryError,
    NotPositiveDefiniteError,
    factorise,
    pardiso,
    superlu,
)
from cmsreduce.linalg.sparse.factor_size import factor_cost
from cmsreduce.multifrontal import nested_dissection
from tests.frames import frame, line
from tests.solids import block


def where_installed(backend: str) -> object:
    return pytest.param(backend, marks=getattr(pytest.mark, backend))


SHOW_PIVOTS = (where_installed("pardiso"), "multifrontal", where_installed("cholmod"), "superlu", "superlu dissected")


@pytest.fixture(params=[*SHOW_PIVOTS, where_installed("mumps")])
def backend(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Solver of this test; SuperLU runs in its own order and in the order for large matrices."""
    with chosen(request.param, monkeypatch) as solver:
        yield solver


@pytest.fixture(params=SHOW_PIVOTS)
def pivoting(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Solver of this test, among those that show their pivots."""
    with chosen(request.param, monkeypatch) as solver:
        yield solver


@contextmanager
def chosen(name: str, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    solver, _, dissected = name.partition(" ")
    if dissected:
        monkeypatch.setattr(superlu, "_DISSECTED", 0)
    with solver_settings(SolverSettings(solver)):
        yield solver


def banded(n: int, seed: int) -> sp.csc_array:
    rng = np.random.default_rng(seed)
    C = sp.random_array((n, n), density=4 / n, rng=rng, data_sampler=rng.standard_normal)
    return sp.csc_array(C @ C.T + sp.diags_array(rng.uniform(0.5, 2.0, n)))


@cache
def mast(elements: int) -> sp.csc_array:
    """A plane beam of length 1 and EI = 2, clamped at its foot."""
    h, EI = 1.0 / elements, 2.0
    k = EI / h**3 * np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h * h, -6 * h, 2 * h * h]])
    k = np.vstack([k, -k[0], EI / h**3 * np.array([6 * h, 2 * h * h, -6 * h, 4 * h * h])])
    dofs = 2 * np.arange(elements)[:, None] + np.arange(4)
    i, j = np.repeat(dofs, 4, axis=1).ravel(), np.tile(dofs, 4).ravel()
    return sp.csc_array(sp.coo_array((np.tile(k.ravel(), elements), (i, j))))[2:, 2:]


def penalty() -> sp.csc_array:
    """A bar of unit springs; a spring of 1e12 holds row 0, and another one joins the last two rows."""
    K = sp.lil_array((12, 12))
    K[0, 0] = 1e12
    for e in range(11):
        K[e : e + 2, e : e + 2] += (1e12 if e == 10 else 1.0) * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return sp.csc_array(K)


CELLS = (6, 2, 3)
BRICKS = block("bricks", (3.0, 0.5, 0.7), CELLS, held=range(1, 13))
TOWER = frame(
    "tower",
    [[i % 2, i // 2 % 2, i // 4] for i in range(20)],
    [(i, i + 4) for i in range(1, 17)]
    + [(4 * s + a, 4 * s + b) for s in range(5) for a, b in ((1, 2), (2, 4), (4, 3), (3, 1))],
    held=(1, 2, 3, 4),
)
SPECTRA = {body.name: la.eigvalsh(body.K.toarray(), body.M.toarray()) for body in (BRICKS, TOWER)}
BODIES = {"solid": BRICKS.K, "frame": TOWER.K, "mast": mast(60), "penalty": penalty(), "banded": banded(150, 3)}


@pytest.mark.parametrize("name", BODIES)
def test_solutions_are_exact_for_a_matrix_rounded_once(backend, name):
    A = BODIES[name]
    b = np.random.default_rng(0).standard_normal((A.shape[0], 5))
    x = factorise(A)(b)
    # Backward error of each row: its residual over the sum of its terms.
    missed = abs(A @ x - b) / (abs(A) @ abs(x) + abs(b))
    assert missed.max() < 20 * np.finfo(float).eps


@pytest.mark.parametrize("columns", [None, 0, 1, BLOCK, BLOCK + 1, 3 * BLOCK], ids=str)
def test_solves_for_any_number_of_columns(backend, columns):
    A = BODIES["banded"]
    x = np.random.default_rng(0).standard_normal(150 if columns is None else (150, columns))
    np.testing.assert_allclose(factorise(A)(A @ x), x, rtol=0, atol=1e-11)


@pytest.mark.parametrize("layout", [np.ascontiguousarray, np.asfortranarray, lambda b: np.repeat(b, 2, 1)[:, ::2]])
def test_any_layout_of_columns_gives_the_same_and_stays_as_it_was(backend, layout):
    A = BODIES["solid"]
    b = np.random.default_rng(1).standard_normal((A.shape[0], 7))
    b[:, [0, 4]] = 0.0
    given = layout(b)
    x = factorise(A)(given)
    np.testing.assert_array_equal(given, b)
    assert not x[:, [0, 4]].any()
    dense = la.solve(A.toarray(), b, assume_a="pos")
    np.testing.assert_allclose(x, dense, rtol=0, atol=1e-10 * abs(dense).max())


def test_a_bar_stretches_as_it_should(backend):
    # Without lateral contraction u = F L / (E A) at the end for any elements.
    A = BODIES["solid"]
    end = BRICKS.n - 3 * 12
    push = np.zeros((CELLS[1] + 1, CELLS[2] + 1))
    for i in range(CELLS[1]):
        for k in range(CELLS[2]):
            push[i : i + 2, k : k + 2] += 1e6 / 4 / (CELLS[1] * CELLS[2])
    force = np.zeros(BRICKS.n)
    force[end::3] = push.ravel()
    np.testing.assert_allclose(factorise(A)(force)[end::3], 1e6 * 3.0 / (70e9 * 0.5 * 0.7), rtol=1e-11)


def test_penalty_springs_cost_no_digits(backend):
    # A unit force at the end: 1e-12 + ten springs in series, the last spring rigid.
    tip = factorise(BODIES["penalty"])(np.eye(1, 12, 11)[0])
    np.testing.assert_allclose(tip, np.append(np.arange(11.0), 10.0), rtol=0, atol=1e-10)


@pytest.mark.parametrize("name", BODIES)
def test_pivots_multiply_to_the_determinant(pivoting, name):
    factor = factorise(BODIES[name])
    assert factor.inertia_known
    # The springs of a chain multiply to its determinant; dense algebra keeps four digits of it.
    log_det = 24 * np.log(10) if name == "penalty" else np.linalg.slogdet(BODIES[name].toarray())[1]
    assert np.log(factor.pivots).sum() == pytest.approx(log_det, rel=1e-11)


def test_pivots_stand_at_their_rows(pivoting):
    # Pairs of rows in a random order. The pivot of the first row of a pair is its own diagonal entry.
    rng = np.random.default_rng(5)
    pairs = 30
    a, c = rng.uniform(1, 9, (2, pairs))
    b = 0.5 * np.sqrt(a * c)
    A = sp.block_diag([np.array([[a[k], b[k]], [b[k], c[k]]]) for k in range(pairs)])
    order = rng.permutation(2 * pairs)
    pivots = np.empty(2 * pairs)
    pivots[order] = factorise(sp.csc_array(sp.csc_array(A)[order][:, order])).pivots
    for first, second, k in zip(pivots[::2], pivots[1::2], range(pairs), strict=True):
        left_of_c, left_of_a = c[k] - b[k] ** 2 / a[k], a[k] - b[k] ** 2 / c[k]
        assert [first, second] == pytest.approx([a[k], left_of_c]) or [first, second] == pytest.approx(
            [left_of_a, c[k]]
        )


@pytest.mark.parametrize("name", ["solid", "frame", "banded"])
def test_a_pivot_is_between_all_others_held_and_all_others_free(pivoting, name):
    A = BODIES[name].toarray()
    pivots, free = factorise(BODIES[name]).pivots, 1 / np.linalg.inv(A).diagonal()
    assert np.all(pivots > free * (1 - 1e-9))
    assert np.all(pivots < A.diagonal() * (1 + 1e-9))
    # When the first row is eliminated, all others are held; when the last row is, all others are free.
    assert np.isclose(pivots, A.diagonal(), rtol=1e-12).any()
    assert np.isclose(pivots, free, rtol=1e-9).any()


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.93])
def test_negative_pivots_are_the_inertia(backend, seed, share):
    A = banded(120, seed)
    lam = la.eigvalsh(A.toarray())
    below = int(share * lam.size)
    shift = (lam[below - 1] + lam[below]) / 2 if below else lam[0] / 2
    factor = factorise(sp.csc_array(A - shift * sp.eye_array(120)), definite=False)
    assert factor.negative_pivots == below


@pytest.mark.parametrize("side", [-1e-6, 1e-6])
@pytest.mark.parametrize("body", [BRICKS, TOWER], ids=lambda body: body.name)
def test_inertia_near_an_eigenvalue(backend, body, side):
    lam = SPECTRA[body.name]
    for mode in (1, 4, 9):
        sigma = lam[mode] * (1 + side)
        factor = factorise(sp.csc_array(body.K - sigma * body.M), definite=False)
        assert factor.negative_pivots == np.count_nonzero(lam < sigma)


def test_inertia_at_an_eigenvalue_is_that_of_one_side_or_refused(backend):
    lam = la.eigvalsh(BODIES["banded"].toarray())
    for mode in (0, 60, 149):
        A = sp.csc_array(BODIES["banded"] - lam[mode] * sp.eye_array(150))
        try:
            factor = factorise(A, definite=False)
        except NotPositiveDefiniteError:
            continue
        assert not factor.inertia_known or factor.negative_pivots in (mode, mode + 1)


def test_a_shifted_matrix_is_solved(backend):
    lam = SPECTRA[BRICKS.name]
    A = sp.csc_array(BRICKS.K - (lam[5] + lam[6]) / 2 * BRICKS.M)
    x = np.random.default_rng(2).standard_normal((BRICKS.n, 3))
    np.testing.assert_allclose(factorise(A, definite=False)(A @ x), x, rtol=0, atol=1e-8)


@pytest.mark.parametrize("stored", [False, True], ids=["absent", "stored"])
def test_constraints_with_zeros_on_the_diagonal(backend, stored):
    # K with eight multipliers: as many positive eigenvalues as K has rows, as many negative ones as constraints.
    K = BODIES["banded"]
    B = sp.csc_array(np.random.default_rng(3).standard_normal((8, 150)))
    A = sp.coo_array(sp.block_array([[K, B.T], [B, None]]))
    if stored:
        zeros = np.arange(150, 158)
        ends = (np.append(A.coords[0], zeros), np.append(A.coords[1], zeros))
        A = sp.coo_array((np.append(A.data, np.zeros(8)), ends), A.shape)
    A = sp.csc_array(A)
    x = np.random.default_rng(4).standard_normal((158, 2))
    factor = factorise(A, definite=False)
    np.testing.assert_allclose(factor(A @ x), x, rtol=0, atol=1e-9)
    assert not factor.inertia_known or factor.negative_pivots == 8


def pair() -> np.ndarray:
    """Rows 2 and 3 slide together; their diagonal entries are larger than that of row 0."""
    A = np.diag([0.1, 2.0, 5.0, 5.0, 3.0])
    A[2, 3] = A[3, 2] = -5.0
    return A


def dangling() -> np.ndarray:
    """A clamped bar whose last node has axial stiffness only: the node swings sideways."""
    K = line("bar", [0, 0, 0], [1, 0, 0], 3, held=(1,)).K.toarray()
    n = K.shape[0]
    grown = np.zeros((n + 3, n + 3))
    grown[:n, :n] = K
    ends = [n - 6, n]
    grown[np.ix_(ends, ends)] += 1e7 * np.array([[1, -1], [-1, 1]])
    grown[n + 1, n + 1] = 3.0
    skew = np.array([1.0, -1.0])
    grown[np.ix_([n + 1, n + 2], [n + 1, n + 2])] = 3.0 * np.outer(skew, skew)
    return grown


@pytest.mark.parametrize(
    ("A", "rows"),
    [
        (pair(), {2, 3}),
        (np.diag([1.0, 0.0, 2.0]), {1}),
        (dangling(), {19, 20}),
        (np.diag([1.0, -1e-3, 2.0]), {1}),
    ],
    ids=["two rows slide together", "empty row", "a node swings", "negative"],
)
def test_a_row_that_is_not_held_is_named(backend, A, rows):
    with pytest.raises(NotPositiveDefiniteError) as caught:
        factorise(sp.csc_array(A), what="the block")
    assert caught.value.row in rows
    assert str(caught.value).startswith("the block is ")


@pytest.mark.parametrize("seed", range(15))
def test_free_frames_are_singular_whatever_rounding_leaves(backend, seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 7))
    body = frame("free", rng.standard_normal((n, 3)), [(k, k + 1) for k in range(1, n)])
    with pytest.raises(NotPositiveDefiniteError):
        factorise(body.K)


def test_a_thousand_elements_in_a_row_are_held_by_one_clamp(backend):
    K = mast(1000)
    tip = np.zeros(K.shape[0])
    tip[-2] = 1.0
    # A condition number of 1e13 leaves three digits of L^3 / 3 EI.
    assert factorise(K)(tip)[-2] == pytest.approx(1 / (3 * 2.0), rel=1e-3)


def test_inertia_is_read_or_refused_where_both_diagonal_entries_are_zero(backend):
    factor = factorise(sp.csc_array([[0.0, 1.0], [1.0, 0.0]]), definite=False)
    np.testing.assert_allclose(factor(np.array([2.0, 3.0])), [3.0, 2.0])
    if factor.inertia_known:
        assert factor.negative_pivots == 1
    else:
        with pytest.raises(MatrixError, match="off the diagonal"):
            _ = factor.negative_pivots


@pytest.mark.parametrize("definite", [True, False])
def test_a_factor_that_outgrows_the_memory_is_refused(backend, definite):
    A = BODIES["solid"]
    fewest = factor_cost(A, nested_dissection(A)).nnz
    settings = SolverSettings(backend, memory=1e3)
    with solver_settings(settings), pytest.raises(InsufficientMemoryError, match="GiB may be used") as caught:
        factorise(A, definite=definite, what="the body")
    assert str(caught.value).startswith(f"the body ({A.shape[0]} rows): its factor has ")
    entries = float(str(caught.value).split("its factor has ")[1].split()[0])
    # PARDISO counts the padding of its blocks, a large share of a small factor.
    assert 0.8 * fewest < entries < 1.6 * fewest
    assert not settings.work
    with solver_settings(SolverSettings(backend, memory=1e9)) as settings:
        factorise(A, definite=definite)
    assert [work.rows for work in settings.work] == [A.shape[0]]


def test_two_threads_give_what_one_gives(backend):
    A = block("cube", (1.0, 1.0, 1.0), (6, 6, 6), held=range(1, 50)).K
    b = np.random.default_rng(6).standard_normal((A.shape[0], 20))
    found = []
    for threads in (1, 2):
        with threadpool_limits(threads):
            factor = factorise(A)
            found.append((factor(b), 0.0 if backend == "mumps" else np.log(factor.pivots).sum()))
    (x, log_det), (x2, log_det2) = found
    np.testing.assert_allclose(x2, x, rtol=0, atol=1e-12 * abs(x).max())
    assert log_det2 == pytest.approx(log_det, rel=1e-14)


def test_bodies_worked_on_at_once_share_the_factor_of_like_matrices(backend):
    """PARDISO, MUMPS and CHOLMOD write into a factor while they solve: two solves at once gave garbage, or an abort."""
    A = block("plate", (1.0, 1.0, 0.1), (16, 16, 2), held=range(1, 60)).K
    rng = np.random.default_rng(8)
    loads = [rng.standard_normal((A.shape[0], 12)) for _ in range(24 if backend == "pardiso" else 4)]
    factor = factorise(A)
    with allowed_threads(1), ThreadPoolExecutor(2) as pool:
        found = list(pool.map(factor, loads))
    for x, b in zip(found, loads, strict=True):
        assert np.linalg.norm(A @ x - b) < 1e-8 * np.linalg.norm(b)


@pytest.mark.parametrize("kept", [KnownFactors, KnownOrders])
def test_threads_store_and_drop_what_is_known_at_once(kept):
    known, arrays = kept(), [np.arange(k, k + 40, dtype=np.int32) for k in range(60)]

    def work(k: int) -> None:
        for own in arrays[k:] + arrays[:k]:
            if isinstance(known, KnownFactors):
                known.store([own], own, 1.0, 20.0)
                known.find([own])
            else:
                known.store(own, own, own)
                known.of_rows(k)

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(work, range(60)))
    if isinstance(known, KnownFactors):
        # They may take a quarter of the limit; one that is made anew drops no other.
        known.store([arrays[7]], arrays[7], 1.0, 20.0)
        known.store([arrays[7]], arrays[7], 1.0, 20.0)
        assert sum(known.find([own]) is own for own in arrays) == 5
    else:
        assert all(known.find(own, own) is own for own in arrays)


def test_without_a_library_small_matrices_load_no_compiled_loops(monkeypatch):
    monkeypatch.setattr("cmsreduce.linalg.sparse.factorisation.installed", lambda backend: backend != "pardiso")
    monkeypatch.setattr("cmsreduce.linalg.sparse.factorisation._COMPILED", 1500)
    K = sp.csc_array(sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(1500, 1500)))
    with solver_settings(SolverSettings()) as settings:
        factorise(sp.csc_array(K[:-1, :-1]))
        factorise(K)
    assert [each.backend for each in settings.work] == ["superlu", "multifrontal"]


def test_a_solver_that_is_not_installed_is_named(monkeypatch):
    monkeypatch.setattr("cmsreduce.linalg.sparse.factorisation.installed", lambda backend: backend == "superlu")
    with solver_settings(SolverSettings("cholmod")), pytest.raises(MatrixError, match="'cholmod' is not installed"):
        factorise(BODIES["banded"])


def test_a_message_names_what_a_solver_lacks(monkeypatch):
    monkeypatch.setattr("cmsreduce.linalg.sparse.factorisation.lacks", lambda: "METIS (pip install pymetis)")
    monkeypatch.setattr("cmsreduce.linalg.sparse.factorisation.installed", lambda backend: backend == "superlu")
    with (
        solver_settings(SolverSettings("multifrontal")),
        pytest.raises(MatrixError, match=r"not installed here: it lacks METIS \(pip install pymetis\); installed: "),
    ):
        factorise(BODIES["banded"])


def test_without_metis_superlu_takes_its_own_order(monkeypatch):
    monkeypatch.setattr(superlu, "dissection_installed", lambda: False)
    monkeypatch.setattr(superlu, "_DISSECTED", 0)
    A = BODIES["solid"]
    x = np.random.default_rng(0).standard_normal(A.shape[0])
    with solver_settings(SolverSettings("superlu")):
        np.testing.assert_allclose(factorise(A)(A @ x), x, rtol=0, atol=1e-9)


class Counted(KnownOrders):
    """Counts the orders that are stored."""

    found = 0

    def store(self, starts, indices, order):
        self.found += 1
        super().store(starts, indices, order)


@pytest.mark.pardiso
@pytest.mark.parametrize("precision", ["double", "single"])
def test_the_order_of_k_serves_k_less_sigma_m(precision):
    """K may store zeros that K - sigma M does not have; both use one order."""
    body = block("bar", (2.0, 0.2, 0.2), (40, 4, 4), held=range(1, 26))
    M, entries, ends = sp.diags_array(body.M.diagonal()), sp.coo_array(body.K), np.arange(100)
    rows, columns = (
        np.concatenate([a, b, c])
        for a, b, c in zip(entries.coords, (ends, ends + 900), (ends + 900, ends), strict=True)
    )
    K = sp.csc_array(sp.coo_array((np.concatenate([entries.data, np.zeros(200)]), (rows, columns)), shape=body.K.shape))
    shifted = sp.csc_array(K - 1e-3 * K.diagonal().max() / body.M.diagonal().max() * M)
    assert K.nnz > shifted.nnz == np.count_nonzero(K.data)
    settings = SolverSettings("pardiso", precision=precision, orders=Counted())
    x = np.random.default_rng(0).standard_normal((body.n, 3))
    with solver_settings(settings):
        for A in (shifted, K):
            b = A @ x
            missed = abs(A @ factorise(A, definite=False)(b) - b) / (abs(A) @ abs(x) + abs(b))
            assert missed.max() < 1e-12
    assert settings.orders.found == 1
    assert len({each.entries for each in settings.work}) == 1


@pytest.mark.pardiso
@pytest.mark.parametrize("few, threads", [(2**20, 1), (10, 3)], ids=["few rows", "many rows"])
def test_pardiso_works_on_few_rows_by_one_thread(monkeypatch, few, threads):
    taken, called, A = [], pardiso.pardiso, banded(400, 5)
    monkeypatch.setattr(pardiso, "_FEW_ROWS", few)
    monkeypatch.setattr(pardiso, "pardiso", lambda *given: (taken.extend(given[9:]), called(*given))[1])
    with solver_settings(SolverSettings("pardiso", threads=3)):
        np.testing.assert_allclose(factorise(A)(A @ np.ones(400)), 1.0, rtol=0, atol=1e-10)
    assert len(taken) >= 3 and set(taken) == {threads}
