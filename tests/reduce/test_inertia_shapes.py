"""Static response to the inertia of static shapes, against dense algebra of the unreduced body."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.config import ReduceKeys
from cmsreduce.errors import ConfigError
from cmsreduce.model import FEModel, ParameterTerm, ReducedComponent
from cmsreduce.reduce import CraigBampton, Guyan, MacNealRubin, Reduction, reduction
from tests.frames import line

CUTOFF = 250.0


def arm() -> FEModel:
    return line("arm", [0, 0, 0], [1.2, 0, 0], 12)


def at_interface(M: np.ndarray, K: np.ndarray, rows: np.ndarray, hz: float) -> np.ndarray:
    """Receptance (r, r) at the rows of some coordinates, without damping."""
    return rows @ la.solve(K - (2 * np.pi * hz) ** 2 * M, rows.T, assume_a="sym")


def errors(reduced: ReducedComponent, hz: tuple[float, ...]) -> list[float]:
    """Largest relative error of the dynamic stiffness at the interface at some frequencies."""
    body = reduced.body
    rows = np.eye(body.n)[np.concatenate([body.interface_rows(name) for name in body.interfaces])]
    found = []
    for each in hz:
        exact = la.inv(at_interface(body.M.toarray(), body.K.toarray(), rows, each))
        ours = la.inv(at_interface(reduced.M, reduced.K, rows @ reduced.modes.Phi, each))
        found.append(float(la.norm(ours - exact) / la.norm(exact)))
    return found


def test_the_basis_spans_the_response_to_the_inertia_of_the_moving_interface() -> None:
    body = arm()
    usual, ours = (CraigBampton(CUTOFF, inertia=on).reduce(body) for on in (False, True))
    held = np.concatenate([body.interface_rows(name) for name in body.interfaces])
    j = np.setdiff1d(np.arange(body.n), held)
    K, M = body.K.toarray(), body.M.toarray()
    Psi = np.zeros((body.n, held.size))
    Psi[held], Psi[j] = np.eye(held.size), -la.solve(K[np.ix_(j, j)], K[np.ix_(j, held)])
    exact = np.zeros_like(Psi)
    exact[j] = la.solve(K[np.ix_(j, j)], (M @ Psi)[j])
    for modes, least, most in ((usual.modes, 1e-3, np.inf), (ours.modes, 0.0, 1e-8)):
        beyond = exact - modes.Phi @ la.lstsq(modes.Phi, exact)[0]
        missed = np.einsum("ij,ij->j", beyond, K @ beyond) / np.einsum("ij,ij->j", exact, K @ exact)
        assert least <= np.sqrt(missed.max()) < most
    assert ours.modes.kind[: usual.modes.m] == usual.modes.kind
    assert 0 < ours.modes.m - usual.modes.m <= held.size
    assert ours.modes.label[-1] == f"inertia {ours.modes.m - usual.modes.m}"


def test_the_dynamic_stiffness_gains_four_orders_of_the_frequency() -> None:
    """Static shapes alone match it to w^2, with the response to their inertia to w^6; the first mode is at 63 Hz."""
    usual, ours = (errors(Guyan(0.0, inertia=on).reduce(arm()), (24.0, 48.0)) for on in (False, True))
    assert usual[0] > 1e-5 and usual[1] / usual[0] < 2**6
    assert ours[0] < 1e-10 and ours[1] / ours[0] > 2**8


@pytest.mark.parametrize("kind", [CraigBampton, MacNealRubin])
def test_errors_far_below_those_of_as_many_normal_modes(kind: type[Reduction]) -> None:
    ours = kind(CUTOFF, inertia=True).reduce(arm())
    usual = next(found for hz in range(250, 9000, 250) if (found := kind(hz).reduce(arm())).modes.m >= ours.modes.m)
    assert max(errors(ours, (60.0, 200.0))) < 0.05 * max(errors(usual, (60.0, 200.0)))


def test_corners_of_parameters_have_them_too() -> None:
    body = arm()
    stiffer = FEModel(**{**vars(body), "terms": (ParameterTerm("p", "K", 2 * body.K, 1),), "corners": ({"p": 1.0},)})
    assert CraigBampton(CUTOFF, inertia=True).reduce(stiffer).modes.m > CraigBampton(CUTOFF).reduce(stiffer).modes.m


def test_sets_without_static_shapes_say_so() -> None:
    for method in ("benfield-hruda", "augmented", "scene"):
        with pytest.raises(ConfigError, match=f"{method} has no static shapes of its own"):
            reduction(method, CUTOFF, inertia=True)
        with pytest.raises(ValueError, match=f"{method} has no static shapes of its own: take `inertia` out"):
            ReduceKeys(method=method, inertia=True)
