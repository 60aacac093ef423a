"""Every hard case through every mode set."""

from functools import lru_cache

import numpy as np
import pytest

from cmsreduce.balance import Gregory
from cmsreduce.errors import CmsReduceError
from cmsreduce.linalg.machine import SolverSettings, solver_settings
from cmsreduce.model import ModalChannels, ModalComponent
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import CraigBampton, MacNealRubin
from tests.hard.case import COMPLETE, METHODS
from tests.hard.cases import BUILDERS, build
from tests.hard.measure import elastic_modes
from tests.hard.outcome import outcome, reduce, truth

# Error of orthonormality granted beside the noise of the body itself.
ORTHONORMAL = 1e-10
# Roundings of every term in a static answer out of the shapes: those of their own solve, of the answer's, of the sum.
STATIC = 3.0
# What is left of K on rigid modes, relative to |K| |phi_r|: round-off, or a few roundings of the file.
ROUND_OFF = 1e-12
ROUNDINGS = 10.0
# Beside K's own noise, the reference's eigenvalues lose this much.
BELOW = 1e-9


# The mast of 1e5 dofs takes a minute: benchmarks/hard_cases.py runs it. The slender mast loses as many digits.
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", [name for name in BUILDERS if name != "mast"])
def test_hard_case(name, method):
    assert_holds(build(name), method)


def test_fronts_hold_the_digits_of_a_slender_body():
    """The solver that is chosen by itself for bodies of more dofs."""
    with solver_settings(SolverSettings("multifrontal")) as settings:
        assert_holds(build("slender_mast"), "macneal-rubin")
    assert "multifrontal" in {work.backend for work in settings.work}


def assert_holds(case, method):
    if method in case.refused:
        refusal = case.refused[method]
        with pytest.raises(refusal.error, match=refusal.reason) as refused:
            reduce(case, method)
        assert f"body '{case.body.name}'" in str(refused.value)
        return
    found = outcome(case, method)
    rounding, double = case.body.rounding, 2.0**-53
    assert found.rigid == case.rigid.shape[1]
    if found.limit is not None:
        assert found.error <= found.limit
    if method in COMPLETE:
        assert found.completeness <= case.completeness + (STATIC * found.noise * rounding / double) ** 2
    # The noise is that of one rounding in every term; products of n terms and their solves leave a few.
    assert found.mass <= ORTHONORMAL + found.noise
    assert found.stiffness <= ORTHONORMAL + found.noise
    assert found.strain <= ROUND_OFF + ROUNDINGS * rounding * (rounding > double)
    assert found.below <= BELOW + ROUNDINGS * found.noise * rounding / double


@lru_cache
def modal(name: str, method: str) -> ModalComponent:
    return reduce(build(name), method)


@pytest.mark.parametrize("method", METHODS)
def test_units_give_one_answer(method):
    metres, millimetres, inches = (modal(name, method) for name in ("in_metres", "in_millimetres", "in_inches"))
    for other in (millimetres, inches):
        np.testing.assert_allclose(other.omega, metres.omega, rtol=1e-9)


@pytest.mark.parametrize("method", ["macneal-rubin", "benfield-hruda"])
def test_a_cutoff_does_not_split_a_pair(method):
    """Cut at the first bending pair itself, and a hair to either side."""
    case = BUILDERS["square_beam"]()
    first = truth(case).omega[0] / (2 * np.pi)
    assert truth(case).omega[1] == pytest.approx(truth(case).omega[0], rel=1e-10)
    sets = {"macneal-rubin": MacNealRubin, "benfield-hruda": CraigBampton}
    for share, free in ((1 - 1e-7, 0), (1.0, 2), (1 + 1e-12, 2), (1 + 1e-7, 2)):
        # Craig-Bampton without interface has free modes too.
        interface = case.interface if method == "macneal-rubin" else ()
        modes = sets[method](first * share).reduce(case.body, interface).modes
        assert modes.kind.count("free") == free


def test_the_cluster_is_complete():
    """Ten whips bending two ways each, all of them found and none twice."""
    case = BUILDERS["ten_appendages"]()
    omega = orthogonalise(MacNealRubin(20.0).reduce(case.body, case.interface)).omega[6:]
    exact, _ = elastic_modes(case.body.K, case.body.M, case.rigid, 20)
    assert exact[13] < exact[0] * (1 + 1e-4)
    np.testing.assert_allclose(omega[:20], exact, rtol=1e-9)


def test_the_soft_mode_is_elastic_and_the_rigid_one_is_not():
    """sqrt(2 k / m) of two masses m = 12 on a spring k = 2^-19."""
    found = modal("soft_beside_stiff", "craig-bampton")
    assert found.rigid_count == 1
    assert found.omega[1] == pytest.approx(np.sqrt(2 * 2.0**-19 / 12), rel=1e-2)
    # An eigenvector of K would hold a few per cent of the soft mode.
    assert np.ptp(found.Phi[:, 0]) < 1e-6 * abs(found.Phi[0, 0])


def test_nothing_measured_is_of_no_importance():
    case = BUILDERS["no_outputs"]()
    component = reduce(case, "craig-bampton")
    elastic = component.elastic
    e = component.elastic_count
    inputs, none = component.Phi[:, elastic].T @ case.inputs, np.empty((0, e))
    sigma = Gregory().coefficients(
        ModalChannels(case.body.name, component.omega[elastic], np.full(e, 0.01), inputs, none, none)
    )
    assert sigma.shape == (e,) and (sigma == 0).all()


def test_refusals_are_of_the_family():
    for name in ("one_pin", "hinge_behind_the_interface", "massless_spin"):
        for refusal in build(name).refused.values():
            assert issubclass(refusal.error, CmsReduceError)
