"""The subspace of a mode set is the body's own: no order of rows changes it, no cutoff splits what is repeated."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.model import DofTable, FEModel, InterfaceLoading, ModeSet
from cmsreduce.reduce import METHODS, CraigBampton, MacNealRubin, Reduction, reduction
from tests.frames import Section, frame, line

# The same in both planes, so that every bending mode is one of a pair.
SQUARE = Section(Iy=1e-8, Iz=1e-8)
LOADED = ("benfield-hruda", "augmented")


def star(arms: int, elements: int) -> FEModel:
    """A hub with equal arms around it, square in section: with the hub held, every mode is there twice per arm."""
    xyz, bars = [np.zeros(3)], []
    for angle in 2 * np.pi * np.arange(arms) / arms:
        for k in range(1, elements + 1):
            xyz.append(np.array([np.cos(angle), np.sin(angle), 0]) * 0.5 * k / elements)
            bars.append((1 if k == 1 else len(xyz) - 1, len(xyz)))
    return frame("star", xyz, bars, {"hub": 1}, section=SQUARE)


def shuffled(body: FEModel, order: np.ndarray) -> FEModel:
    return replace(
        body,
        K=sp.csc_array(body.K[order][:, order]),
        M=sp.csc_array(body.M[order][:, order]),
        dofs=DofTable(body.dofs.node[order], body.dofs.component[order]),
    )


def i_set(body: FEModel) -> np.ndarray:
    return np.concatenate([body.interface_rows(name) for name in body.interfaces])


def sine(A: np.ndarray, B: np.ndarray, M: sp.csc_array) -> float:
    """Sine of the largest principal angle of two spans, in the norm of the mass."""
    P, Q = (orthonormal(X, M) for X in (A, B))
    rest = P - Q @ (Q.T @ (M @ P))
    return float(np.sqrt(max(la.eigvalsh(rest.T @ (M @ rest))[-1], 0.0)))


def orthonormal(X: np.ndarray, M: sp.csc_array) -> np.ndarray:
    X = X / np.sqrt(np.einsum("ij,ij->j", X, M @ X))
    for _ in range(2):
        w, V = la.eigh(X.T @ (M @ X))
        X = X @ (V / np.sqrt(w))
    return X


def of(method: str, cutoff: float, body: FEModel) -> Reduction:
    i = i_set(body).size
    rng = np.random.default_rng(8)
    B = rng.standard_normal((i, i))
    return reduction(method, cutoff, loading=InterfaceLoading(np.zeros((i, i)), B @ B.T) if method in LOADED else None)


def modes_of(method: str, cutoff: float, body: FEModel) -> ModeSet:
    return of(method, cutoff, body).reduce(body, i_set(body)).modes


@pytest.mark.parametrize("elements", [12, 110], ids=["dense", "sparse"])
# Scene shapes are refused for a body without a scene.
@pytest.mark.parametrize("method", [each for each in METHODS if each != "scene"])
def test_no_order_of_rows_changes_the_subspace(method, elements):
    body = line("bar", [0, 0, 0], [1.5, 0.2, 0.1], elements, section=SQUARE)
    plain = modes_of(method, 250.0, body)
    for seed in range(2):
        order = np.random.default_rng(seed).permutation(body.n)
        mixed = modes_of(method, 250.0, shuffled(body, order))
        assert mixed.m == plain.m
        back = np.empty_like(mixed.Phi)
        back[order] = mixed.Phi
        # A beam of a hundred elements has a condition of 1e10, which a solve feels in the shapes of its residuals.
        assert sine(plain.Phi, back, body.M) < (5e-8 if method == "macneal-rubin" and body.n > 600 else 1e-8)


@pytest.mark.parametrize("off", [-1e-7, -1e-9, 0.0, 1e-9, 1e-7])
@pytest.mark.parametrize("elements", [12, 110], ids=["dense", "sparse"])
@pytest.mark.parametrize("method", ["craig-bampton", "macneal-rubin", "augmented"])
def test_a_pair_at_the_cutoff_is_whole(method, elements, off):
    """Either both planes of a bending mode or neither, however near to it the cutoff is."""
    body = line("bar", [0, 0, 0], [1.5, 0, 0], elements, section=SQUARE)
    cutoff = 250.0
    load = InterfaceLoading(np.zeros((12, 12)), 0.3 * np.eye(12)) if method == "augmented" else None
    make = lambda hz: reduction(method, hz, loading=load).reduce(body, i_set(body)).modes  # noqa: E731
    every = make(cutoff)
    normal = np.array([kind in ("fixed", "free", "loaded") for kind in every.kind])
    hertz = every.source_hz[normal]
    at = 2 + int(np.flatnonzero(np.diff(hertz[2:]) < 1e-6 * hertz[2:-1])[0])
    pair = hertz[at]
    modes = make(pair * (1 + off))
    kept = [kind in ("fixed", "free", "loaded") for kind in modes.kind]
    found = modes.source_hz[kept]
    assert found.size in ((at, at + 2) if off < 0 else (at + 2,))
    shapes, all_shapes = modes.Phi[:, kept], every.Phi[:, normal]
    assert sine(shapes, all_shapes[:, : found.size], body.M) < 1e-7


@pytest.mark.parametrize("elements", [2, 10], ids=["dense", "sparse"])
@pytest.mark.parametrize("off", [-1e-8, 1e-8])
def test_a_cluster_at_the_cutoff_is_whole(elements, off):
    """Twelve arms clamped at the hub: 24 modes of one frequency, the cantilever's."""
    body = star(12, elements)
    assert (body.n > 600) == (elements == 10)
    first = CraigBampton(60.0).reduce(body, i_set(body)).modes
    hertz = first.source_hz[6:]
    exact = (1.875104068711961 / 0.5) ** 2 * np.sqrt(SQUARE.E * SQUARE.Iy / (SQUARE.rho * SQUARE.A)) / (2 * np.pi)
    assert hertz[0] == pytest.approx(exact, rel=1e-2)
    assert np.count_nonzero(abs(hertz / hertz[0] - 1) < 1e-6) == 24 == hertz.size
    order = np.random.default_rng(3).permutation(body.n)
    for shape, where in ((body, np.arange(body.n)), (shuffled(body, order), order)):
        modes = CraigBampton(hertz.mean() * (1 + off)).reduce(shape, i_set(shape)).modes
        assert modes.m in (6, 30) and (modes.m == 30 or off < 0)
        if modes.m == 30:
            back = np.empty_like(modes.Phi)
            back[where] = modes.Phi
            assert sine(first.Phi, back, body.M) < 1e-8


def test_free_modes_of_a_symmetric_body_come_in_whole_groups():
    body = star(6, 17)
    assert body.n > 600
    lam = la.eigh(body.K.toarray(), body.M.toarray(), eigvals_only=True, subset_by_index=[6, 80])
    exact = np.sqrt(lam) / (2 * np.pi)
    for cutoff in (90.0, 400.0):
        modes = MacNealRubin(cutoff).reduce(body, i_set(body)).modes
        hertz = modes.source_hz[[kind == "free" for kind in modes.kind]]
        np.testing.assert_allclose(hertz, exact[exact <= cutoff], rtol=1e-6)
