"""Flexibility models against closed forms and the body solved point by point."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.response import RESPONSE_TOLERANCE, DynamicStiffness, ResonanceError, adaptive_flexibility
from cmsreduce.linalg.response.flexibility_shapes import FlexibilityShapes, UnconfirmedError
from tests.frames import frame, line
from tests.solids import block


def chain(n, k=1.0, m=1.0, held=True):
    """Equal masses in a row on equal springs, the first one on a spring to ground if held."""
    K = sp.diags_array([-np.ones(n - 1), np.full(n, 2.0), -np.ones(n - 1)], offsets=[-1, 0, 1], format="lil")
    K[n - 1, n - 1] = 1
    if not held:
        K[0, 0] = 1
    return sp.csc_array(k * K), sp.csc_array(m * sp.eye_array(n))


def unit(n, *rows):
    return np.eye(n)[:, list(rows)]


def balanced(F, M, R):
    return F - M @ R @ np.linalg.solve(R.T @ (M @ R), R.T @ F)


def test_end_of_a_held_chain():
    """sin N t / (k' (sin (N+1) t - sin N t)) with cos t = 1 - w^2 m / 2k', k' = k (1 + i eta)."""
    n, eta = 1500, 0.002
    K, M = chain(n)
    w = np.linspace(1e-3, 0.35, 900)
    Z = DynamicStiffness(K, M, loss=sp.csc_array(eta * K))
    found = adaptive_flexibility(Z, unit(n, n - 1), w, rigid=np.empty((n, 0)))(w)
    stiff = 1 + 1j * eta
    t = 2 * np.arcsin(w / (2 * np.sqrt(stiff)))
    expected = np.sin(n * t) / (stiff * (np.sin((n + 1) * t) - np.sin(n * t)))
    assert found.error.max() < RESPONSE_TOLERANCE
    np.testing.assert_allclose(found.Y[:, 0, 0], expected, rtol=1e-6)


def test_a_band_above_all_modes_of_a_body():
    """All modes are shapes, so that nothing of the loads is left outside them."""
    K, M = chain(30)
    loss, w, loads = sp.csc_array(0.01 * K), np.linspace(0.01, 50.0, 300), np.eye(30)
    found = adaptive_flexibility(DynamicStiffness(K, M, loss=loss), loads, w, rigid=np.empty((30, 0)))(w)
    expected = [np.linalg.inv(((1 + 0.01j) * K - each**2 * M).toarray()) for each in w]
    np.testing.assert_allclose(found.Y, expected, atol=1e-9 * abs(np.array(expected)).max())


def test_end_of_a_free_chain_far_below_its_first_mode():
    """Elastic part: (sin N t - sin (N-1) t) / (2 k' sin N t (cos t - 1)) without its rigid part -1/(N m w^2)."""
    n, eta = 700, 0.01
    K, M = chain(n, held=False)
    R = np.ones((n, 1))
    w = np.geomspace(2e-4, 0.2, 300)
    Z = DynamicStiffness(K, M, loss=sp.csc_array(eta * K))
    found = adaptive_flexibility(Z, balanced(unit(n, 0), M, R), w, rigid=R)(w)
    stiff = 1 + 1j * eta
    t = 2 * np.arcsin(w / (2 * np.sqrt(stiff)))
    complete = (np.sin(n * t) - np.sin((n - 1) * t)) / (-4 * stiff * np.sin(n * t) * np.sin(t / 2) ** 2)
    np.testing.assert_allclose(found.Y[:, 0, 0], complete + 1 / (n * w**2), rtol=1e-6)
    # Statics of the free chain: sum over all springs of (share of the mass beyond the spring)^2 / k.
    static = np.sum((np.arange(1, n) / n) ** 2)
    np.testing.assert_allclose(found.Y[0, 0, 0], static / (1 + 1j * eta), rtol=2e-3)


def coupled_twins():
    """Two equal cantilevers joined by a soft spring: modes in pairs with relative distances of 1e-7."""
    one = line("mast", [0, 0, 0], [0, 0, 2], 60, held=(1,))
    n = one.n
    K = sp.block_diag([one.K, one.K], format="lil")
    ends = [n - 6, 2 * n - 6]
    K[np.ix_(ends, ends)] += 1e-3 * np.array([[1, -1], [-1, 1]])
    K, M = sp.csc_array(K), sp.block_diag([one.M, one.M], format="csc")
    return K, M, unit(2 * n, n - 6, n - 5, 2 * n - 6, n - 4), np.empty((2 * n, 0)), 2 * np.pi * 400


def rigid_motions(body):
    """Rigid motions of a solid, whose nodes have three translations."""
    R = np.zeros((body.n, 6))
    for c in range(3):
        R[c::3, c] = 1
        R[:, 3 + c] = np.cross(np.eye(3)[c], body.nodes.xyz).ravel()
    return R


def square_beam():
    """A free solid of square section: bending modes in pairs of equal frequency."""
    body = block("beam", [1.0, 0.1, 0.1], [16, 3, 3])
    R = rigid_motions(body)
    F = balanced(unit(body.n, 0, 1, body.n - 1, body.n // 2), body.M, R)
    return sp.csc_array(body.K), sp.csc_array(body.M), F, R, 2 * np.pi * 6000


def lattice():
    """Masses on a 21 x 30 grid of springs, tied softly to ground: many modes, many of them repeated."""
    a, b = (sp.diags_array([-np.ones(n - 1), np.full(n, 2.0), -np.ones(n - 1)], offsets=[-1, 0, 1]) for n in (21, 30))
    K = sp.csc_array(sp.kron(a, sp.eye_array(30)) + sp.kron(sp.eye_array(21), b) + 0.01 * sp.eye_array(630))
    return K, sp.csc_array(sp.eye_array(630)), unit(630, 0, 331, 629), np.empty((630, 0)), 1.0


def massless():
    """A frame whose rotations have no mass."""
    body = frame(
        "rack",
        [[0.02 * i, 0.03 * (i % 2), 0.001 * i] for i in range(60)],
        [(i, i + 1) for i in range(1, 60)],
        held=(1,),
    )
    M = body.M.tolil()
    rotations = [row for row in range(body.n) if row % 6 > 2]
    M[rotations] = 0
    M[:, rotations] = 0
    return (
        sp.csc_array(body.K),
        sp.csc_array(M),
        unit(body.n, body.n - 6, 20, body.n - 1),
        np.empty((body.n, 0)),
        2 * np.pi * 600,
    )


BODIES = {
    "twins": coupled_twins(),
    "square beam": square_beam(),
    "lattice": lattice(),
    "massless": massless(),
}


def dashpots(n, c, *pairs):
    rows = [row for pair in pairs for row in pair]
    u = sp.csc_array((np.tile([1.0, -1.0], len(pairs)), (rows, np.repeat(range(len(pairs)), 2))), shape=(n, len(pairs)))
    return sp.csc_array(c * u @ u.T)


def damping(law, K, M, top):
    """D and loss, with sizes chosen for the upper end of the band."""
    n = K.shape[0]
    stiff = abs(K.diagonal()).max()
    half = sp.diags_array(np.where(np.arange(n) < n // 2, 1.0, 3.0))
    uneven = sp.csc_array(half @ K @ half)
    D, loss = {
        "0.1 %": (None, 0.002 * K),
        "none": (None, None),
        "stiffness": (sp.csc_array(0.004 / top * K), None),
        "mass and stiffness": (sp.csc_array(1e-3 * top * M + 1e-3 / top * K), None),
        "dashpot": (dashpots(n, 0.02 * stiff / top, (0, n - 1)), 0.002 * K),
        "strong dashpots": (dashpots(n, 50 * stiff / top, (0, n - 1), (1, n // 2)), 0.01 * K),
        "uneven": (sp.csc_array(0.01 / top * uneven), None),
        "uneven loss": (None, sp.csc_array(0.003 * uneven)),
    }[law]
    return D, None if loss is None else sp.csc_array(loss)


LAWS = ("0.1 %", "none", "stiffness", "mass and stiffness", "dashpot", "strong dashpots", "uneven", "uneven loss")
# Loss vanishes on rigid motion, so a free body cannot have loss scaled dof by dof.
CASES = [(name, law) for name in BODIES for law in LAWS if (name, law) != ("square beam", "uneven loss")]


@pytest.mark.parametrize(("name", "law"), CASES)
def test_a_model_errs_by_no_more_than_its_bound(name, law):
    K, M, F, R, top = BODIES[name]
    D, loss = damping(law, K, M, top)
    damped_rigid = bool(R.size) and D is not None and abs(D @ R).max() > 1e-9 * abs(D).max() * abs(R).max()
    Z = DynamicStiffness(K, M, D, loss)
    grid = np.linspace(top / 400, top, 400)
    model = adaptive_flexibility(Z, F, grid, rigid=R, damped_rigid=damped_rigid)
    # Random frequencies, and resonances in the band.
    random = np.random.default_rng(3).uniform(top / 400, top, 6)
    peaks = resonances(name)
    some = np.concatenate([random, peaks[:: 1 + peaks.size // 6]])
    if law == "none":
        some = some[model.detuning(some) > 1e-6]
    found = model(some)
    assert found.error.max() < RESPONSE_TOLERANCE
    for k, w in enumerate(some):
        exact = solved(Z, F, w)
        scale = np.sqrt(np.outer(found.size[k], found.size[k]))
        error = float((abs(found.Y[k] - exact) / scale).max())
        # At a lightly damped resonance rounding dominates the error of the model and of a solve, which is made only
        # where it decides. With strong dashpots and massless dofs it is 1e-7 for the model and 3e-11 for a solve.
        if error >= max(1.5 * found.error[k], RESPONSE_TOLERANCE / 5):
            assert error < 5 * max(float((abs(Y - exact) / scale).max()) for Y in plainly_solved(Z, F, w))
        np.testing.assert_array_less(abs(np.diagonal(exact)) * (1 - 1e-5), found.size[k])


def test_a_body_without_a_mode_in_the_band():
    K, M, F, R, _ = BODIES["square beam"]
    Z = DynamicStiffness(K, M, loss=sp.csc_array(0.01 * K))
    grid = 2 * np.pi * np.linspace(1, 100, 30)
    found = adaptive_flexibility(Z, np.hstack([F, 0 * F[:, :1]]), grid, rigid=R)(grid[-1:])
    np.testing.assert_allclose(found.Y[0, :-1, :-1], solved(Z, F, grid[-1]), rtol=1e-6)
    assert not found.Y[0, -1].any()


@pytest.mark.parametrize("law", ["0.1 %", "stiffness"])
@pytest.mark.parametrize(
    ("thickness", "face_loads"),
    [(1e-3, True), (5e-4, False)],
    ids=["rigid part of shapes", "response moved by rounding"],
)
def test_a_sheet_of_bricks(thickness, face_loads, law):
    """The sheet bends at 1e-5 of its highest frequency, so that rounding of K is large beside its bending stiffness."""
    body = block("sheet", [0.5, 0.4, thickness], [8, 6, 1])
    K, M, R, F = sp.csc_array(body.K), sp.csc_array(body.M), rigid_motions(body), unit(body.n, 2, body.n - 1)
    if face_loads:
        edge = body.nodes.xyz[:, 0] == 0
        F = np.hstack([np.kron(edge[:, None] / edge.sum(), np.eye(3)), F])
    F = balanced(F, M, R)
    # The first elastic mode is at 19.85 Hz for 1 mm.
    grid = 2 * np.pi * 19.85e3 * thickness * np.linspace(0.1, 7, 200)
    Z = DynamicStiffness(K, M, *damping(law, K, M, grid[-1]))
    model = adaptive_flexibility(Z, F, grid, rigid=R)
    for w in grid[100::33]:
        found, exact = model(np.array([w])), solved(Z, F, w)
        error = abs(found.Y[0] - exact) / np.sqrt(np.outer(found.size[0], found.size[0]))
        assert error.max() < RESPONSE_TOLERANCE


def test_a_model_with_wrong_mass_is_not_confirmed(monkeypatch):
    K, M, F, R, top = BODIES["square beam"]
    honest = FlexibilityShapes.model
    monkeypatch.setattr(
        FlexibilityShapes,
        "model",
        lambda self, ceiling: replace((m := honest(self, ceiling)), mass=m.mass * 1.001),
    )
    for D in (None, damping("uneven", K, M, top)[0]):
        with pytest.raises(UnconfirmedError, match=r"errs by .* Hz where its bound is"):
            adaptive_flexibility(
                DynamicStiffness(K, M, D), F, np.linspace(1, top, 30), rigid=R, damped_rigid=D is not None
            )


def test_a_resonance_without_damping_has_no_response():
    K, M = chain(700)
    w = 2 * np.sin(np.pi * 3 / 2 / (2 * 700 + 1))
    model = adaptive_flexibility(
        DynamicStiffness(K, M), unit(700, 699), np.linspace(1e-3, 0.1, 50), rigid=np.empty((700, 0))
    )
    with pytest.raises(ResonanceError, match=f"infinite at {w / 2 / np.pi:.6g} Hz"):
        model(np.array([1e-3, w]))


def test_the_bound_is_infinite_above_the_modes():
    K, M = chain(700)
    Z = DynamicStiffness(K, M, loss=sp.csc_array(0.01 * K))
    model = adaptive_flexibility(Z, unit(700, 699), np.linspace(1e-3, 0.1, 50), rigid=np.empty((700, 0)))
    assert model(np.array([0.1])).error < RESPONSE_TOLERANCE
    assert model(np.array([0.13])).error == np.inf


def test_negative_stiffness_is_refused():
    K, M = chain(700)
    K = sp.csc_array(K - 3 * sp.diags_array(np.eye(700)[350]))
    with pytest.raises(MatrixError, match="not positive definite"):
        adaptive_flexibility(
            DynamicStiffness(K, M), unit(700, 699), np.linspace(1e-3, 0.1, 50), rigid=np.empty((700, 0))
        )


def solved(Z, F, w):
    """Flexibility by solves refined with residuals in extended precision."""
    A = sp.csr_array(Z.at(w))
    rows = np.repeat(np.arange(Z.n), np.diff(A.indptr))
    K, M, D, loss = (
        np.longdouble(0) if each is None else each[rows, A.indices].astype(np.longdouble)
        for each in (Z.K, Z.M, Z.D, Z.loss)
    )
    w = np.longdouble(w)
    entries = K - w**2 * M + 1j * (loss + w * D)
    factor = spla.splu(sp.csc_array(A))
    X = factor.solve(F.astype(complex)).astype(np.clongdouble)
    for _ in range(3):
        r = F - np.add.reduceat(entries[:, None] * X[A.indices], A.indptr[:-1], axis=0)
        X = X + factor.solve(r.astype(complex))
    return (F.T @ X).astype(complex)


def plainly_solved(Z, F, w):
    """Flexibility by plain solves: for one order of the rows rounding may be small by chance."""
    A = sp.csc_array(Z.at(w))
    for order in (np.arange(Z.n), *(np.random.default_rng(seed).permutation(Z.n) for seed in range(2))):
        X = spla.spsolve(sp.csc_array(A[order][:, order]), F[order].astype(complex))
        yield F[order].T @ X


@cache
def resonances(name):
    K, M, _, R, top = BODIES[name]
    massive = np.flatnonzero(M.diagonal())
    K, M = K.toarray(), M.toarray()
    rest = np.setdiff1d(np.arange(len(K)), massive)
    G = K[np.ix_(massive, massive)]
    if rest.size:
        G = G - K[np.ix_(massive, rest)] @ np.linalg.solve(K[np.ix_(rest, rest)], K[np.ix_(rest, massive)])
    w = np.sqrt(abs(la.eigh(G, M[np.ix_(massive, massive)], eigvals_only=True)))[R.shape[1] :]
    return w[w < top]
