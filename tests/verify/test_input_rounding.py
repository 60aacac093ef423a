"""Error bars of frequencies, and the count of rigid motions, for bodies whose stiffness is what cancellation left."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.linalg.eigen import rigid_body_modes
from cmsreduce.model import DofTable, FEModel, ModalComponent, rigid_body_shapes
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.read import prove_row_order
from cmsreduce.reduce import CraigBampton, MacNealRubin
from cmsreduce.verify import MOMENTUM, elastic_momentum, frequency_error_bars, negative_directions, rigid_motions_proof
from tests.frames import BAR
from tests.hard.structures import bars

# Modes compared.
FIRST = 6


@lru_cache
def wing(elements: int, kept: int, seed: int | None = None) -> FEModel:
    """A slender bar of many elements, condensed to a few nodes; its nodes are spaced evenly or at random."""
    share = np.linspace(0, 1, elements + 1)
    if seed is not None:
        share[1:-1] += np.random.default_rng(seed).uniform(-0.3, 0.3, elements - 1) / elements
    xyz = share[:, None] * np.array([31.0, 1.3, 0.7])
    whole = bars("wing", xyz, [(k, k + 1) for k in range(1, elements + 1)])
    K, M = whole.K.toarray(), whole.M.toarray()
    a = np.isin(whole.dofs.node, 1 + np.arange(0, elements + 1, elements // kept))
    T = np.zeros((whole.n, a.sum()))
    T[a] = np.eye(a.sum())
    T[~a] = -la.solve(K[np.ix_(~a, ~a)], K[np.ix_(~a, a)], assume_a="sym")
    condensed = K[np.ix_(a, a)] + K[np.ix_(a, ~a)] @ T[~a], T.T @ M @ T
    table = DofTable(whole.dofs.node[a], whole.dofs.component[a])
    return FEModel("wing", *(sp.csc_array((A + A.T) / 2) for A in condensed), table, nodes=whole.nodes)


def printed(A: sp.csc_array, digits: int) -> sp.csc_array:
    values = np.array([float(f"{x:.{digits - 1}e}") for x in A.data])
    return sp.csc_array((values, A.indices, A.indptr), shape=A.shape)


def elastic(body: FEModel, first: int = FIRST, cutoff_hz: float = 50.0) -> tuple[ModalComponent, np.ndarray]:
    modes = orthogonalise(MacNealRubin(cutoff_hz).reduce(body, np.arange(6)))
    return modes, np.arange(modes.omega.size)[modes.elastic][:first]


@pytest.mark.parametrize("seed", [None, 1, 2])
@pytest.mark.parametrize(("elements", "kept"), [(40, 10), (200, 40)])
@pytest.mark.parametrize("digits", [10, 8])
def test_the_bars_cover_the_last_digit_and_are_not_absurdly_wide(elements, kept, digits, seed):
    exact = wing(elements, kept, seed)
    coarse = replace(exact, K=printed(exact.K, digits), M=printed(exact.M, digits), rounding=0.5 * 10.0**-digits)
    (true, first), (found, same) = elastic(exact), elastic(prove_row_order(coarse).estimated(coarse))
    assert found.rigid_count == true.rigid_count == 6
    moved = abs(found.frequencies_hz[same] - true.frequencies_hz[first])
    wide = frequency_error_bars(found, same)
    assert (moved <= wide).all()
    assert np.median(wide / moved) < 100
    # The digits of the file would move a frequency without cancellation by this share.
    assert wide[0] > 100 * 10.0**-digits * found.frequencies_hz[same[0]]
    assert frequency_error_bars(true, first).max() < 1e-3 * wide.max()


@pytest.mark.parametrize("seed", [None, 1, 2, 3])
@pytest.mark.parametrize("digits", [10, 8, 6])
def test_the_bars_hold_the_digits_of_a_condensed_mass(digits, seed):
    """Couplings of either sign cancel in the kinetic energy of high modes, up to 50 bars of K alone."""
    exact = wing(40, 4, seed)
    coarse = replace(exact, M=printed(exact.M, digits))
    for body in (coarse, replace(coarse, K=printed(exact.K, digits), rounding=0.5 * 10.0**-digits)):
        (true, first), (found, same) = (
            elastic(each, 24, 2000.0) for each in (exact, prove_row_order(body).estimated(body))
        )
        moved = abs(found.frequencies_hz[same] - true.frequencies_hz[first])
        wide = frequency_error_bars(found, same)
        assert (moved <= wide).all()
        assert np.median(wide / moved) < 100


def test_a_body_without_cancellation_keeps_the_digits_of_its_file():
    n = 12
    K = np.diag(np.linspace(1.1, 3.3, n) ** 2)
    table = DofTable(np.arange(1, n + 1), np.zeros(n, dtype=int))
    body = FEModel("springs", printed(sp.csc_array(K), 8), sp.eye_array(n, format="csc"), table, rounding=5e-9)
    modes, columns = elastic(replace(body, grounded=True))
    bars_hz = frequency_error_bars(modes, columns) / modes.frequencies_hz[columns]
    assert (bars_hz > 1e-9).all() and (bars_hz < 1e-7).all()


@pytest.mark.parametrize("level", [1e-11, 1e-10, 4e-10])
@pytest.mark.parametrize("seed", range(3))
def test_condensation_leaves_six_rigid_motions(level, seed):
    body = wing(200, 4)
    own = np.sqrt(body.K.diagonal())
    X = np.random.default_rng(seed).standard_normal(body.K.shape)
    noisy = replace(body, K=sp.csc_array(body.K.toarray() + level * (X + X.T) / 6 * np.outer(own, own)))
    proof = prove_row_order(noisy)
    found = proof.estimated(noisy)
    assert (proof.status, proof.motions) == ("proven", 6)
    assert level / 3 < found.noise < 30 * level
    R = rigid_body_shapes(body.dofs, body.nodes, body.nodes.xyz.mean(axis=0))
    assert rigid_body_modes(found.K, found.M, R, found.stiffness_rounding, "wing").shape[1] == 6
    assert negative_directions(found.K, found.stiffness_rounding) == 0
    modes, columns = elastic(found)
    true, first = elastic(body)
    moved = abs(modes.frequencies_hz[columns] - true.frequencies_hz[first])
    assert (moved <= frequency_error_bars(modes, columns)).all()


def test_the_proof_of_rigid_motions():
    body = wing(40, 10)
    good = rigid_motions_proof(body, 6, 6)
    assert good.state == "proven" and good.digits > 14
    assert rigid_motions_proof(replace(body, noise=1e-9), 6, 6).digits == pytest.approx(8)
    assert rigid_motions_proof(body, 5, 6).state == "refuted"
    assert rigid_motions_proof(body, 7, 6).state == "proven"
    assert rigid_motions_proof(replace(body, rounding=5e-7), 7, 6).state == "unproven"
    assert "K resists every motion" in rigid_motions_proof(body, 0, None).remark
    # Without geometry nothing tells a soft motion from a free one but the digits of K.
    assert rigid_motions_proof(body, 6, None).state == "proven"
    assert rigid_motions_proof(replace(body, rounding=5e-7), 1, None).state == "unproven"
    assert rigid_motions_proof(replace(body, rounding=5e-7), 0, None).state == "proven"


def crooked(nodes: int, end: list[float], Iy: float, digits: int | None, places: int, seed: int) -> FEModel:
    """A slender rod with its stiffness in some digits, and its places in some decimals."""
    bends = 0.02 * np.linalg.norm(end) / 2.6 * np.random.default_rng(seed).normal(size=(nodes, 3))
    xyz = np.linspace([0, 0, 0], end, nodes) + bends
    section = replace(BAR, Iy=Iy, Iz=1.7 * Iy, J=2 * Iy)
    body = bars("rod", xyz, [(k, k + 1) for k in range(1, nodes)], section)
    assert body.nodes is not None
    at = replace(body.nodes, xyz=xyz.round(places), xyz_rounding=0.5 * 10.0**-places)
    K = printed(body.K, digits) if digits else body.K
    rounding = 0.5 * 10.0**-digits if digits else 2**-53
    body = replace(body, nodes=at, K=sp.csc_array((K + K.T) / 2), rounding=rounding)
    return prove_row_order(body).estimated(body)


@lru_cache
def rod(digits: int, seed: int) -> ModalComponent:
    """Modes of a rod with places to a hundredth of a millimetre."""
    return orthogonalise(CraigBampton(20.0).reduce(crooked(12, [2.1, 1.5, 0.7], 1e-10, digits, 5, seed), np.arange(6)))


@pytest.mark.parametrize(("nodes", "Iy", "digits", "count"), [(15, 2e-9, 12, 12), (13, 1e-10, 7, 2), (13, 1e-10, 8, 5)])
def test_a_free_body_has_six_rigid_motions(nodes, Iy, digits, count):
    """Rotations miss K by the digits of the deck, and translations show less rounding than K has: five were counted.

    In seven digits the first bending mode has not much more energy than that rounding.
    """
    for seed in range(count):
        body = crooked(nodes, [1.09, 0.78, 0.39], Iy, digits, 6, seed)
        R = rigid_body_shapes(body.dofs, body.nodes, body.nodes.xyz.mean(axis=0))
        assert rigid_body_modes(body.K, body.M, R, body.stiffness_rounding, "rod").shape[1] == 6


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("digits", [9, 10, None])
def test_momentum_of_elastic_modes_is_within_what_the_digits_allow(digits, seed):
    """About the centre of mass a free body's elastic modes have none, but for the digits of K and of the places."""
    modes = rod(digits, seed)
    found, allowed = elastic_momentum(modes)
    M, at = modes.body.M.toarray(), modes.body.nodes
    R = rigid_body_shapes(modes.body.dofs, at)
    centre = (R[:, :3].T @ M @ R[:, 3:])[[1, 2, 0], [2, 0, 1]] / (R[:, 0] @ M @ R[:, 0])
    R = rigid_body_shapes(modes.body.dofs, at, centre)
    each = abs(R.T @ M @ modes.Phi[:, 6:]).max(axis=1) / np.sqrt(np.einsum("ij,ij->j", R, M @ R))
    assert abs(each / found - 1).min() < 1e-6
    assert MOMENTUM < found < allowed < 100 * found


def straight(radius: float, digits: int, places: int, seed: int | None = None) -> ModalComponent:
    """Modes of a straight round rod with so many digits in K and decimals in the deck, along x or any direction."""
    end = [2.6, 0, 0] if seed is None else 2 * np.random.default_rng(seed).normal(size=3)
    A, bending = np.pi * radius**2, np.pi * radius**4 / 4
    xyz = np.linspace([0, 0, 0], end, 12)
    body = bars(
        "rod", xyz, [(k, k + 1) for k in range(1, 12)], replace(BAR, A=A, Iy=bending, Iz=bending, J=2 * bending)
    )
    at = replace(body.nodes, xyz=xyz.round(places), xyz_rounding=0.5 * 10.0**-places)
    K = printed(body.K, digits)
    body = replace(body, nodes=at, K=sp.csc_array((K + K.T) / 2), rounding=0.5 * 10.0**-digits)
    return orthogonalise(CraigBampton(3e3).reduce(prove_row_order(body).estimated(body), np.arange(6)))


@pytest.mark.parametrize("seed", range(12))
def test_momentum_of_straight_rods(seed):
    """The modes' own rigid motions, which are given at a few dofs, are rougher than those of the geometry."""
    found, allowed = elastic_momentum(straight(0.02, 8 + seed % 3, 6, seed))
    assert found < allowed


@pytest.mark.parametrize("wrong", ["places of two nodes", "mass of a node"])
@pytest.mark.parametrize("modes", [rod(10, 0), straight(0.001, 12, 3)], ids=["crooked", "thin, in millimetres"])
def test_momentum_of_a_wrong_body_is_beyond_what_the_digits_allow(modes, wrong):
    body = modes.body
    if wrong == "mass of a node":
        scale = sp.diags_array(np.where(body.dofs.node == 4, np.sqrt(1.5), 1.0))
        other = replace(body, M=sp.csc_array(scale @ body.M @ scale))
    else:
        xyz = body.nodes.xyz.copy()
        xyz[[3, 6]] = xyz[[6, 3]]
        other = replace(body, nodes=replace(body.nodes, xyz=xyz))
    found, allowed = elastic_momentum(replace(modes, body=other))
    assert found > 5 * allowed
