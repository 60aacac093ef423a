"""Complex modes of joined bodies, each damped by a law of its own."""

from __future__ import annotations

import numpy as np
import pytest

from cmsreduce.assemble import assemble, damped_modes, system_modes
from cmsreduce.model import Configuration, Damping, Scene, System
from tests.assemble.rigs import joint, substructures
from tests.frames import line

TOP = 2 * np.pi * 300.0


def joined(elements: int, first: Damping, second: Damping) -> System:
    """Two bars in line, welded, floating free."""
    bodies = [
        line("near", [0, 0, 0], [0.5, 0, 0], elements, damping=first),
        line("far", [0.5, 0, 0], [1.2, 0, 0], elements, damping=second),
    ]
    scene = Scene(bodies=("near", "far"), band=(0.0, 300.0), joints=(joint("weld", "near.b", "far.a"),))
    return assemble(substructures(bodies), scene, Configuration("as built"))


def dense(A: object) -> np.ndarray:
    return np.asarray(A.toarray() if hasattr(A, "toarray") else A)


def companion_roots(system: System) -> np.ndarray:
    """Roots above the real axis to TOP from the companion matrix over all coordinates."""
    K, M = dense(system.K).astype(complex), dense(system.M)
    D = np.zeros_like(M) if system.D is None else dense(system.D)
    if system.loss is not None:
        K += 1j * dense(system.loss)
    zero = np.zeros_like(M)
    A = np.block([[zero, np.eye(len(M))], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
    s = np.linalg.eigvals(A)
    # Rigid roots, split by round-off, are far below the first mode at 60 Hz.
    s = s[(s.imag > 2 * np.pi * 10) & (abs(s) <= TOP)]
    return s[np.argsort(abs(s))]


@pytest.mark.parametrize("elements", [4, 20], ids=["at once", "by search"])
@pytest.mark.parametrize(
    ("first", "second"),
    [
        (Damping(rayleigh=(0.0, 1e-4)), Damping(rayleigh=(0.0, 1e-5))),
        (Damping(structural=0.1), Damping(structural=0.02)),
        (Damping(rayleigh=(0.0, 1e-4)), Damping(structural=0.1)),
        (Damping(), Damping(rayleigh=(0.0, 2e-4))),
    ],
    ids=["viscous", "structural", "both", "one undamped"],
)
def test_unlike_bodies(first: Damping, second: Damping, elements: int) -> None:
    system = joined(elements, first, second)
    modes = damped_modes(system, TOP, system_modes(system, 1.14 * TOP))
    assert modes is not None
    expected = companion_roots(system)
    assert modes.s.size == expected.size >= 4
    # The companion matrix keeps about eight digits of a root beside frequencies a thousand times as high.
    np.testing.assert_allclose(modes.s.imag, expected.imag, rtol=1e-6)
    np.testing.assert_allclose(modes.zeta, -expected.real / abs(expected), rtol=1e-4)
    momentum = modes.X.T @ (system.M @ system.rigid)
    np.testing.assert_allclose(momentum, 0.0, atol=1e-8)
    assert modes.real.size == 0


def test_one_law_in_both_bodies_is_the_law_of_the_system() -> None:
    law = Damping(rayleigh=(0.0, 1e-4))
    system = joined(20, law, law)
    w, Phi = system_modes(system, 1.14 * TOP)
    modes = damped_modes(system, TOP, (w, Phi))
    assert modes is not None
    w = w[w <= TOP]
    np.testing.assert_allclose(modes.omega, w, rtol=1e-9)
    np.testing.assert_allclose(modes.zeta, 1e-4 * w / 2, rtol=1e-8)


def test_without_damping_there_are_none() -> None:
    system = joined(4, Damping(), Damping())
    assert damped_modes(system, TOP, system_modes(system, TOP)) is None
