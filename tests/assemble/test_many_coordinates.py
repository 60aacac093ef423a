"""Modes of a system of many dense coordinates: up to a frequency alone, as closed forms give them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.assemble import system_modes
from cmsreduce.assemble.modes import _SMALL
from cmsreduce.errors import MatrixError
from cmsreduce.model import Configuration, System

LINKS = 310


def two_chains(massless: bool = False) -> System:
    """Two free chains of unit masses and springs that know nothing of each other, in coordinates of both."""
    K = 2 * np.eye(LINKS) - np.eye(LINKS, k=1) - np.eye(LINKS, k=-1)
    K[[0, -1], [0, -1]] = 1.0
    K, M = la.block_diag(K, K), np.eye(2 * LINKS)
    rigid = np.kron(np.eye(2), np.full((LINKS, 1), LINKS**-0.5))
    if massless:
        K, M, rigid = la.block_diag(K, [[0.0]]), la.block_diag(M, [[0.0]]), np.vstack([rigid, np.zeros((1, 2))])
    turn = la.block_diag(np.array([[3, 4], [-4, 3]]) / 5, np.eye(K.shape[0] - 2))
    K, M, rigid = turn @ K @ turn.T, turn @ M @ turn.T, turn @ rigid
    n, none = K.shape[0], np.empty((K.shape[0], 0))
    return System(
        Configuration("as built"), np.eye(n), M, K, None, None, none, none.T, none.T, rigid, {"chains": n}, (), ()
    )  # fmt: skip


def test_repeated_modes_below_a_frequency():
    system, count = two_chains(), 40
    assert system.N > _SMALL
    expected = np.repeat(2 * np.sin(np.arange(1, count + 1) * np.pi / 2 / LINKS), 2)
    # The second of the last pair is not left out by round-off.
    w, Phi = system_modes(system, float(expected[-1]))
    np.testing.assert_allclose(w, expected, rtol=1e-9)
    gram = Phi.T @ system.M @ Phi
    np.testing.assert_allclose(gram, np.eye(2 * count), rtol=0, atol=1e-10)
    assert abs(Phi.T @ system.M @ system.rigid).max() < 1e-10


@pytest.mark.parametrize("last", [3, 100, 2 * LINKS - 10], ids=["the first", "a third", "nearly all"])
def test_links_without_mass_follow_the_others(last):
    # A spring of 2 on each mass of one chain holds a point without mass, and moves nothing.
    system, size = two_chains(), 2 * LINKS + LINKS
    hold = np.hstack([-np.eye(LINKS), np.zeros((LINKS, LINKS)), np.eye(LINKS)])
    K, M = (la.block_diag(A, np.zeros((LINKS, LINKS))) for A in (system.K, system.M))
    follow = np.vstack([np.eye(2 * LINKS), np.eye(LINKS, 2 * LINKS)])
    w = np.sort(np.repeat(2 * np.sin(np.arange(1, LINKS) * np.pi / 2 / LINKS), 2))[:last]
    wide = replace(
        system, M=M, K=K + 2 * hold.T @ hold, rigid=follow @ system.rigid, T=np.eye(size), sizes={"chains": size}
    )
    found, Phi = system_modes(wide, float(w[-1]))
    np.testing.assert_allclose(found[:last], w, rtol=1e-9)
    np.testing.assert_allclose(Phi, follow @ Phi[: 2 * LINKS], rtol=0, atol=1e-9)


def chain(springs: np.ndarray) -> System:
    """A free chain of unit masses on such springs."""
    n = springs.size + 1
    hold = np.diff(np.eye(n), axis=0)
    K, rigid = hold.T @ (springs[:, None] * hold), np.full((n, 1), n**-0.5)
    return replace(two_chains(), M=np.eye(n), K=K, rigid=rigid, T=np.eye(n), sizes={"chains": n})


@pytest.mark.parametrize("digits", [5, 7])
def test_modes_are_orthogonal_to_rigid_motions_that_few_digits_resist(digits):
    system = chain(np.random.default_rng(0).uniform(0.3, 1.7, 799))
    K, stiff = np.zeros_like(system.K), np.nonzero(system.K)
    K[stiff] = [float(f"{value:.{digits - 1}e}") for value in system.K[stiff]]
    exact, w = (
        system_modes(replace(system, K=each, rounding=rounding), 0.05)[0]
        for each, rounding in ((system.K, 2.0**-53), (K, 0.5 * 10.0**-digits))
    )
    Phi = system_modes(replace(system, K=K, rounding=0.5 * 10.0**-digits), 0.05)[1]
    assert abs(Phi.T @ system.rigid).max() < 1e-12
    np.testing.assert_allclose(w, exact, rtol=3 * 10.0 ** (3 - digits))


def test_a_spring_that_is_none_leaves_a_mechanism():
    springs = np.ones(799)
    springs[400] = 0.0
    with pytest.raises(MatrixError, match="the body has a mechanism"):
        system_modes(chain(springs), 0.05)


def test_a_motion_without_mass_and_stiffness_is_refused_by_name():
    with pytest.raises(MatrixError, match="a motion, above all of body 'chains', has neither mass nor stiffness"):
        system_modes(two_chains(massless=True), 0.2)
