"""A basis that spans the damped modes of a body, against all roots of the unreduced body by dense algebra."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.errors import ConfigError
from cmsreduce.model import Damping, FEModel, ParameterTerm, ReducedComponent
from cmsreduce.reduce import CraigBampton, MacNealRubin, reduction
from tests.frames import Section, line

CUTOFF = 400.0


def damped(elements: int = 12, c: float = 3.0) -> FEModel:
    """A bar with a rotary damper across its middle third, heavy enough to nearly lock it."""
    body = line("arm", [0, 0, 0], [1.2, 0, 0], elements)
    across = np.zeros(body.n)
    for node, sign in ((elements // 3 + 1, -1.0), (2 * elements // 3 + 1, 1.0)):
        across[np.flatnonzero((body.dofs.node == node) & (body.dofs.component == 5))] = sign
    return replace(body, D=sp.csc_array(c * np.outer(across, across)), damping=Damping())


def roots(M: np.ndarray, D: np.ndarray, K: np.ndarray, hz: float) -> np.ndarray:
    """Oscillating roots up to a frequency by a companion matrix in mass-normalised coordinates."""
    w2, X = la.eigh(K, M)
    d, n = X.T @ D @ X, w2.size
    s = la.eigvals(np.block([[np.zeros((n, n)), np.eye(n)], [-np.diag(w2), -d]]))
    s = s[(s.imag > 1.0) & (abs(s) < 2 * np.pi * hz)]
    return s[np.argsort(s.imag)]


def found(reduced: ReducedComponent, columns: np.ndarray) -> np.ndarray:
    assert reduced.D is not None
    return roots(*(A[np.ix_(columns, columns)] for A in (reduced.M, reduced.D, reduced.K)), CUTOFF / 1.25)


def worst(some: np.ndarray, exact: np.ndarray) -> float:
    """Largest distance of an exact root from the nearest one, as a share of its frequency."""
    return max(abs(some - s).min() / abs(s) for s in exact)


@pytest.mark.parametrize("elements", [12, 40])
def test_modes_at_a_held_interface_are_those_of_the_body(elements: int) -> None:
    """40 elements are more than dense algebra takes at once: the search for damped modes starts from normal modes."""
    body = damped(elements)
    held = body.interface_rows("a")
    j = np.setdiff1d(np.arange(body.n), held)
    exact = roots(*(A[j][:, j].toarray() for A in (body.M, body.D, body.K)), CUTOFF / 1.25)
    assert (-exact.real / abs(exact)).max() > 0.05
    usual, ours = (CraigBampton(CUTOFF, damped=on).reduce(body, held) for on in (False, True))
    assert worst(found(usual, np.arange(6, usual.modes.m)), exact) > 1e-3
    assert worst(found(ours, np.arange(6, ours.modes.m)), exact) < 1e-8
    kinds = ours.modes.kind
    assert 0 < kinds.count("damped") <= kinds.count("fixed") and kinds[: usual.modes.m] == usual.modes.kind
    np.testing.assert_array_equal(ours.modes.Phi[:, : usual.modes.m], usual.modes.Phi)


def test_free_modes_are_those_of_the_body() -> None:
    body = damped()
    exact = roots(body.M.toarray(), body.D.toarray(), body.K.toarray(), CUTOFF / 1.25)
    usual, ours = (MacNealRubin(CUTOFF, damped=on).reduce(body) for on in (False, True))
    every = [np.arange(each.modes.m) for each in (usual, ours)]
    assert worst(found(usual, every[0]), exact) > 1e-4
    assert worst(found(ours, every[1]), exact) < 1e-8
    assert ours.rigid.shape[1] == 6


@pytest.mark.parametrize("c", [0.03, 0.3])
def test_a_body_that_is_alike_across_its_axis_stays_so(c: float) -> None:
    """Two equal dampers across a square section: a quarter turn takes the shapes to shapes of the basis."""
    body = line("arm", [0, 0, 0], [1.2, 0, 0], 6, section=Section(Iy=2e-8, Iz=2e-8))
    turn = np.kron(np.eye(14), [[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    D, K = damped(6, c).D.toarray(), body.K.toarray()
    both = replace(body, D=sp.csc_array(D + turn @ D @ turn.T), damping=Damping())
    modes = MacNealRubin(CUTOFF, damped=True).reduce(both).modes
    new = turn @ modes.Phi[:, np.array(modes.kind) == "damped"]
    beyond = new - modes.Phi @ la.lstsq(modes.Phi, new)[0]
    assert new.shape[1] > 0
    assert max(np.einsum("ij,ij->j", beyond, K @ beyond)) < 1e-20


@pytest.mark.parametrize("stiffer", [False, True])
def test_dampers_of_a_parameter_are_those_of_the_body(stiffer: bool) -> None:
    """The damper is there only with its parameter, which may change the stiffness, too."""
    body = damped()
    assert body.D is not None
    terms = [ParameterTerm("c", "D", sp.csc_array(body.D / 4), 2)]
    if stiffer:
        terms.append(ParameterTerm("c", "K", sp.csc_array(0.3 * body.K)))
    varies = replace(body, D=None, terms=tuple(terms), corners=({"c": 2.0},))
    K = (1.6 if stiffer else 1.0) * body.K
    exact = roots(body.M.toarray(), body.D.toarray(), K.toarray(), CUTOFF / 1.25)
    for on, less, most in ((False, 1e-4, 1.0), (True, 0.0, 1e-8)):
        Phi = np.asarray(MacNealRubin(CUTOFF, damped=on).reduce(varies).modes.Phi)
        found = roots(*(Phi.T @ (A @ Phi) for A in (body.M, body.D, K)), CUTOFF / 1.25)
        assert less <= worst(found, exact) < most


def test_proportional_damping_needs_no_more_shapes() -> None:
    body = line("arm", [0, 0, 0], [1.2, 0, 0], 8)
    for same in (body, replace(body, D=sp.csc_array(1e-4 * body.K), damping=Damping())):
        assert "damped" not in MacNealRubin(CUTOFF, damped=True).reduce(same).modes.kind


def test_sets_without_damped_modes_say_so() -> None:
    for method in ("guyan", "benfield-hruda", "scene"):
        with pytest.raises(ConfigError, match=f"{method} has no damped modes"):
            reduction(method, CUTOFF, damped=True)
