"""A stiffness held at few dofs, with its interface eliminated last: one factor for the proof and for the reductions."""

from contextlib import suppress

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.linalg.eigen import only_motions, rigid_body_modes
from cmsreduce.linalg.machine import SolverSettings, solver_settings
from cmsreduce.linalg.machine.settings import KnownFactors
from cmsreduce.linalg.sparse import (
    SOUND_PIVOT,
    ElasticFlexibility,
    InterfaceLast,
    NotPositiveDefiniteError,
    held_factor,
    motions_held,
)
from cmsreduce.model import rigid_body_shapes
from cmsreduce.reduce import CraigBampton, MacNealRubin
from tests.frames import line
from tests.solids import block

ENDS = [1, 2, 3, 4, 5, 6]


def mast(nodes: int = 120):
    body = line("mast", [0, 0, 0], [3, 1, 0.5], nodes)
    rows = np.concatenate([body.dofs.rows_of(body.dofs.node[at], ENDS) for at in (0, body.n // 2)])
    return body, rows, rigid_body_shapes(body.dofs, body.nodes)


def test_a_solve_is_that_of_the_dense_matrix():
    body, rows, R = mast()
    given, free, factor = held_factor(body.K, R, "the mast", rows)
    assert np.isin(given, rows).all()
    assert np.array_equal(np.sort(np.concatenate([given, free])), np.arange(body.n))
    K = body.K.toarray()[np.ix_(free, free)]
    b = np.random.default_rng(2).normal(size=(free.size, 3)) * np.sqrt(body.K.diagonal()[free])[:, None]
    exact = la.solve(K, b, assume_a="pos")
    np.testing.assert_allclose(factor(b), exact, atol=1e-7 * abs(exact).max())
    np.testing.assert_allclose(factor(b[:, 0]), factor(b)[:, 0], rtol=0, atol=1e-12 * abs(exact[:, 0]).max())
    # Pivots of the interface, eliminated after all others, do not depend on the order of those.
    last = np.isin(free, rows)
    order = np.concatenate([np.flatnonzero(~last), np.flatnonzero(last)])
    pivots = la.cholesky(K[np.ix_(order, order)], lower=True).diagonal() ** 2 / K.diagonal()[order]
    row, ratio = factor.weakest
    assert 0 < ratio <= pivots[-last.sum() :].min() * (1 + 1e-6)
    assert 0 <= row < free.size


def test_elastic_flexibility_does_not_depend_on_the_dofs_that_are_held():
    body, rows, R = mast()
    rigid = rigid_body_modes(body.K, body.M, R, body.rounding, "mast")
    loads = np.eye(body.n)[:, [3, 300, body.n - 2]]
    own, with_interface = (ElasticFlexibility(body.K, body.M, rigid, at)(loads) for at in (None, rows))
    np.testing.assert_allclose(with_interface, own, atol=1e-9 * abs(own).max())


def test_a_free_motion_beyond_those_known_is_found():
    """The factorisation fails, or leaves a pivot that is only rounding: no proof either way."""
    body, rows, R = mast()
    with suppress(NotPositiveDefiniteError):
        assert held_factor(body.K, R[:, :5], "the mast", rows)[2].weakest[1] <= SOUND_PIVOT
    with pytest.raises(NotPositiveDefiniteError):
        InterfaceLast(body.K, rows, rows[:5], "the mast")


def test_the_proof_and_two_reductions_take_one_definite_factor():
    body, rows, R = mast()
    with solver_settings(SolverSettings()) as settings:
        proven = only_motions(body.K, R, body.rounding, rows)
        rigid = rigid_body_modes(body.K, body.M, R, body.rounding, "mast", proven)
        for method in (CraigBampton(20.0), MacNealRubin(40.0)):
            method.reduce(body, rows, rigid=rigid)
        sizes = [each.rows for each in settings.work]
    # Each reduction counts its modes by a factor of its own; the other one serves all.
    assert sorted(sizes) == sorted([body.n - rows.size, body.n - rows.size, body.n])


def test_the_factor_with_its_interface_is_kept_as_long_as_that_of_the_interior():
    body, rows, R = mast()
    with solver_settings(SolverSettings()):
        first = held_factor(body.K, R, "the mast", rows)[2]
        assert held_factor(body.K.copy(), R @ np.triu(np.ones((6, 6))), "the mast", rows)[2] is first
        assert held_factor(body.K * 2, R, "the mast", rows)[2] is not first
        assert held_factor(body.K, R, "the mast", rows[:6])[2] is not first
    known, (a, b, c) = KnownFactors(), ([np.array([number])] for number in range(3))
    known.store(a, "interior", 60, 400)
    known.store(b, "whole", 10, 400, "interior")
    assert known.find(b) == "whole" and "interior" in known
    # Without its interior it would still hold the memory of it.
    known.store(c, "another", 50, 400)
    assert (known.find(a), known.find(b), known.find(c)) == (None, None, "another")
    known.store(b, "whole", 60, 400, "another")
    assert known.find(b) is None and known.find(c) is None


def test_an_interface_of_six_dofs_holds_the_body_alone():
    """As a tied face does: no dof of it is left to be eliminated last."""
    body, rows, R = mast()
    given, free, factor = held_factor(body.K, R, "the mast", rows[:6])
    assert np.array_equal(given, np.sort(rows[:6])) and isinstance(factor, InterfaceLast)
    b = np.cos(np.arange(free.size)) * np.sqrt(body.K.diagonal()[free])
    exact = la.solve(body.K.toarray()[np.ix_(free, free)], b, assume_a="pos")
    np.testing.assert_allclose(factor(b), exact, atol=1e-7 * abs(exact).max())
    assert 0 < factor.weakest[1] <= 1


def test_an_interface_too_small_to_hold_the_body_is_not_taken():
    """Nine translations at three corners of one element hold a bar in principle, by a lever of a thousandth."""
    body = block("bar", [30.0, 0.03, 0.03], [60, 1, 1])
    near = np.flatnonzero(np.isin(body.dofs.node, body.nodes.id[np.argsort(body.nodes.xyz[:, 0])[:3]]))
    R = rigid_body_shapes(body.dofs, body.nodes)
    assert motions_held(R, near) == 6
    given, _, factor = held_factor(body.K, R, "the bar", near, sound=1e-5)
    assert not isinstance(factor, InterfaceLast) and not np.isin(given, near).all()
    proven, alone = (only_motions(body.K, R, body.rounding, rows) for rows in (near, None))
    assert (proven is None) == (alone is None)
