"""Solves of a damped body at one frequency: against dense algebra, and the size of their factors."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import eigsh

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.machine import SolverSettings, solver_settings
from cmsreduce.linalg.response import DynamicStiffness, ResonanceError, damped_solve, dynamic_stiffness
from cmsreduce.linalg.response.damped_solve import through_real_factor
from cmsreduce.linalg.sparse import InsufficientMemoryError, factorise, installed_backends
from tests.solids import block

BODY = block("bar", [0.6, 0.1, 0.12], [9, 3, 3], held=range(1, 17))
K, M = sp.csc_array(BODY.K), sp.csc_array(BODY.M)
OMEGA = 2 * np.pi * 900.0
LOAD = np.eye(BODY.n)[:, 5:440:6]


def dashpot(c: float) -> sp.csc_array:
    u = sp.csc_array(([1.0, -1.0], ([20, 200], [0, 0])), shape=(BODY.n, 1))
    return sp.csc_array(c * u @ u.T)


def spinning() -> sp.csc_array:
    """Forces of a body that spins about x: y and z of each node, by their mass."""
    turn = np.array([[0.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    G = sp.csc_array(sp.kron(sp.eye_array(BODY.n // 3), turn))
    return sp.csc_array(200 * (M @ G + G @ M))


LAWS = {
    "none": (None, None),
    "Rayleigh": (40 * M + 1e-5 * K, None),
    "beyond critical": (2 * OMEGA * M, None),
    "structural": (None, 0.02 * K),
    "a strong damper": (dashpot(1e6), None),
    "a damper and structural": (dashpot(1e3), 0.01 * K),
    "spinning": (spinning() + 1e-5 * K, None),
}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("backend", ["auto", "superlu"])
def test_motions_are_those_of_dense_algebra(law: str, backend: str) -> None:
    D, loss = LAWS[law]
    A = K.toarray() - OMEGA**2 * M.toarray() + 0j
    for factor, part in ((1j * OMEGA, D), (1j, loss)):
        A += 0 if part is None else factor * part.toarray()
    expected = np.linalg.solve(A, LOAD)
    with solver_settings(SolverSettings(backend)):
        found = DynamicStiffness(K, M, D, loss).solve(LOAD, OMEGA)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * abs(expected).max())


@pytest.mark.parametrize("law", [law for law in LAWS if law not in ("none", "spinning")])
def test_damped_motions_converge_through_a_real_factor(law: str) -> None:
    """At a resonance, where A is singular, and at half-power points: real equations of twice the rows miss a damper."""
    D, loss = LAWS[law]
    (square,) = eigsh(K, 1, M, sigma=OMEGA**2, return_eigenvectors=False)
    for omega in np.sqrt(square) * np.array([0.995, 1.0, 1.005]):
        Z = DynamicStiffness(K, M, D, loss)
        found, A = through_real_factor(*Z._parts(omega), LOAD), Z.at(omega).toarray()
        assert found is not None
        expected = np.linalg.solve(A, LOAD)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * abs(expected).max())


@pytest.mark.skipif("multifrontal" not in installed_backends(), reason="needs numba and pymetis")
def test_a_damped_factor_has_the_order_of_the_symmetric_solver_and_its_memory_is_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A real factor is no larger than that of the stiffness; one of twice the rows takes four times the entries."""
    body = block("solid", [0.6, 0.5, 0.4], [11, 10, 8], held=range(1, 11))
    stiffness = sp.csc_array(body.K)
    load = np.eye(body.n)[:, :2]
    local = sp.csc_array(([1e3], ([7], [7])), shape=body.K.shape)
    with solver_settings(SolverSettings("multifrontal")) as settings:
        factorise(stiffness)
        for steps in (damped_solve._STEPS, 0):
            monkeypatch.setattr(damped_solve, "_STEPS", steps)
            for D in (sp.csc_array(1e-5 * body.K), local):
                DynamicStiffness(stiffness, sp.csc_array(body.M), D).solve(load, 2 * np.pi * 500.0)
    alone, *real, _, whole, _, beside = settings.work
    assert [(each.rows, each.entries) for each in real] == [(body.n, alone.entries)] * 2
    assert (whole.rows, beside.rows) == (2 * body.n, 2 * body.n)
    assert whole.entries < 4.5 * alone.entries
    # One damper joins both halves in one row only.
    assert beside.entries < 2.3 * alone.entries
    Z = DynamicStiffness(stiffness, sp.csc_array(body.M), sp.csc_array(1e-5 * body.K))
    with solver_settings(SolverSettings("multifrontal", memory=1e6)), pytest.raises(InsufficientMemoryError):
        Z.solve(load, 2 * np.pi * 500.0)


def test_a_resonance_without_damping_is_named() -> None:
    two = sp.csc_array([[2.0, -1.0], [-1.0, 2.0]])
    with pytest.raises(ResonanceError, match=r"infinite at 0\.159155 Hz"):
        DynamicStiffness(two, sp.csc_array(np.eye(2))).solve(np.eye(2), 1.0)


@pytest.mark.parametrize("law", ["none", "beyond critical"])
@pytest.mark.parametrize("digits", [1e-3, 0.5])
def test_a_factor_of_few_digits_is_refined_and_a_wrong_one_is_refused(
    law: str, digits: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Half of every motion is lost in a wrong one; nothing else looks at what the last solver gives."""
    D, _ = LAWS[law]

    def rough(A: sp.csc_array, **options: object) -> Callable[[np.ndarray], np.ndarray]:
        exact, shares = factorise(A, **options), 1 + digits * np.random.default_rng(0).choice([-1.0, 1.0], A.shape[0])
        return lambda f: shares[:, None] * exact(f)

    expected = DynamicStiffness(K, M, D).solve(LOAD, OMEGA)
    monkeypatch.setattr(dynamic_stiffness, "factorise", rough)
    monkeypatch.setattr(dynamic_stiffness, "through_real_factor", lambda *_: None)
    if digits > 0.1:
        with pytest.raises(MatrixError, match="does not meet its equations"):
            DynamicStiffness(K, M, D).solve(LOAD, OMEGA)
    else:
        found = DynamicStiffness(K, M, D).solve(LOAD, OMEGA)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8 * abs(expected).max())


def test_wide_loads_take_little_memory_beside_the_factor(monkeypatch: pytest.MonkeyPatch) -> None:
    D = LAWS["Rayleigh"][0]
    together, solved = [], damped_solve._solved
    monkeypatch.setattr(damped_solve, "_solved", lambda *a: (together.append(a[2].shape[1]), solved(*a))[1])
    monkeypatch.setattr(damped_solve, "_MOST_BYTES", 3 * 8 * 25 * BODY.n)
    A = sp.csc_array(K - OMEGA**2 * M)
    found = through_real_factor(A, sp.csc_array(OMEGA * D), LOAD[:, :7])
    assert together == [3, 3, 1]
    np.testing.assert_allclose(found, DynamicStiffness(K, M, D).solve(LOAD[:, :7], OMEGA), rtol=0, atol=1e-10)
