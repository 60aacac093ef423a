"""Rigid motions of bodies whose stiffness, raised by a small mass, is not definite in the digits that it has."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from cmsreduce.model import DofTable, FEModel, Nodes, rigid_body_shapes
from cmsreduce.verify import rigid_motions

# A frame of springs between each node and the eleven before it, three translations each.
RNG = np.random.default_rng(7)


def frame(nodes: int, stiffness: float, *, slosh_hz: float | None = None, mass: float = 1.0) -> FEModel:
    """Free truss; ``slosh_hz`` adds a mass on a soft spring at its first node."""
    xyz = RNG.uniform(-1, 1, (nodes, 3)) + np.array([3.0, 0.0, 0.0])
    K = np.zeros((3 * nodes + 3, 3 * nodes + 3))
    M = np.full(3 * nodes + 3, mass)
    for i in range(nodes):
        for j in range(max(0, i - 11), i):
            along = xyz[i] - xyz[j]
            g = np.concatenate([along, -along]) / np.linalg.norm(along)
            ends = np.r_[3 * i : 3 * i + 3, 3 * j : 3 * j + 3]
            K[np.ix_(ends, ends)] += stiffness * np.outer(g, g)
    k = 0.0 if slosh_hz is None else 0.1 * mass * (2 * np.pi * slosh_hz) ** 2
    M[-3:] = 0.1 * mass
    spring = np.kron([[1, -1], [-1, 1]], k * np.eye(3))
    at = np.r_[0:3, 3 * nodes : 3 * nodes + 3]
    K[np.ix_(at, at)] += spring
    if slosh_hz is None:
        K, M = K[:-3, :-3], M[:-3]
    ids = np.arange(1, M.size // 3 + 1)
    table = DofTable(np.repeat(ids, 3), np.tile((1, 2, 3), ids.size))
    places = np.vstack([xyz, xyz[:1]])[: ids.size]
    return FEModel("frame", sp.csc_array(K), sp.diags_array(M, format="csc"), table, Nodes.in_basic(ids, places))


def motions(body: FEModel):
    return rigid_motions(body, rigid_body_shapes(body.dofs, body.nodes))


@pytest.mark.parametrize("nodes", [8, 220], ids=["dense", "sparse"])
@pytest.mark.parametrize("hz", [1e-2, 1e-4, 1e-5])
def test_a_sloshing_mass_far_below_the_first_mode(nodes: int, hz: float) -> None:
    """The soft spring's frequency is sqrt(k (1/m + 1/M)); three of them are the next modes above the rigid ones."""
    body = frame(nodes, 8e7, slosh_hz=hz)
    found = motions(body)
    whole = float(body.M.diagonal()[:-3].sum() / 3)
    assert found.apart(body.M)[0] < 1e-4
    if hz >= 1e-4:
        assert found.elastic_hz == pytest.approx(hz * np.sqrt(1 + 0.1 / whole), rel=0.2)


@pytest.mark.parametrize("nodes", [8, 220], ids=["dense", "sparse"])
def test_printed_digits_give_a_negative_eigenvalue(nodes: int) -> None:
    """K with twelve printed digits: a rigid motion has an eigenvalue below zero, 1e-12 of the highest."""
    body = frame(nodes, 1e10)
    noise = RNG.standard_normal(body.K.shape) * abs(body.K.toarray()) * 1e-12
    R = np.linalg.qr(rigid_body_shapes(body.dofs, body.nodes))[0]
    K = body.K.toarray() + (noise + noise.T) / 2
    low = np.linalg.eigvalsh(R.T @ K @ R)
    K -= (low.max() + 2e-2) * R @ R.T
    assert np.linalg.eigvalsh(K)[0] < -1e-2
    exact = np.sort(spla.eigsh(sp.csc_array(K), 1, which="LA", return_eigenvectors=False))[-1]
    assert exact > 1e9
    found = motions(replace(body, K=sp.csc_array(K), rounding=1e-12))
    assert found.elastic_hz > 100 * abs(found.rigid_hz).max()
    assert max(found.apart(body.M)) < 1e-6
