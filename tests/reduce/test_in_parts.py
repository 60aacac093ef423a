"""A body reduced part by part against the same body reduced as a whole."""

import numpy as np
import pytest

from cmsreduce.linalg.eigenpairs import certified_modes
from cmsreduce.linalg.factorise import factorise
from cmsreduce.linalg.multilevel import multilevel_shapes
from cmsreduce.linalg.parted_factor import PartedFactor
from cmsreduce.linalg.solver_settings import SolverSettings, solver_settings
from cmsreduce.reduce import CraigBampton
from tests.frames import line
from tests.solids import block, face

CELLS = (30, 3, 3)
# A square section: bending modes come in pairs. One is held at an end, the others are free; the other end, or its
# node, is the interface.
HELD = block("held", (3.0, 0.2, 0.2), CELLS, held=face(CELLS, 0))
FREE = block("free", (3.0, 0.2, 0.2), CELLS)
BEAM = line("beam", [0, 0, 0], [10, 0, 0], 150)
# Body, cutoff, rows of the interface, digits that frequencies have: a slender beam, of condition 1e11, has two fewer.
BODIES = {"held": (HELD, 6000.0, 48, 1e-9), "free": (FREE, 6000.0, 48, 1e-9), "beam": (BEAM, 400.0, 6, 1e-8)}


def reduced(name, **settings):
    body, cutoff, end, _ = BODIES[name]
    with solver_settings(SolverSettings("superlu", **settings)) as used:
        return CraigBampton(cutoff).reduce(body, np.arange(body.n - end, body.n)), used.work


@pytest.mark.parametrize("parts", [4, 7])
@pytest.mark.parametrize("name", BODIES)
def test_parts_change_nothing(name, parts):
    whole, _ = reduced(name)
    cut, work = reduced(name, parts=parts)
    assert max(each.parts for each in work) == parts
    assert cut.modes.kind == whole.modes.kind
    fixed = np.array(whole.modes.kind) == "fixed"
    assert fixed.sum() >= 8
    hz, hz2 = whole.modes.source_hz[fixed], cut.modes.source_hz[fixed]
    np.testing.assert_allclose(hz2, hz, rtol=BODIES[name][3])
    bound = cut.modes.certificate.bound
    assert cut.modes.certificate.counted == whole.modes.certificate.counted
    assert bound.max() < 1e-7
    assert name == "beam" or np.any(np.diff(hz) < 1e-6 * hz[1:])
    # Constraint modes, and the stiffness and mass that they leave on the boundary, to the digits that K has.
    still = ~fixed
    Psi, Psi2 = whole.modes.Phi[:, still], cut.modes.Phi[:, still]
    np.testing.assert_allclose(Psi2, Psi, rtol=0, atol=1e-8 * abs(Psi).max())
    for A, B, full in ((whole.K, cut.K, whole.body.K), (whole.M, cut.M, whole.body.M)):
        own = A[np.ix_(still, still)]
        # A beam that is free at its only interface leaves no stiffness there, but for rounding.
        digits = max(1e-8 * abs(own).max(), np.finfo(float).eps * abs(full).max())
        np.testing.assert_allclose(B[np.ix_(still, still)], own, rtol=0, atol=digits)
    # Modes as subspaces: a pair turns within its plane.
    M = whole.body.M
    overlap = np.linalg.svd(whole.modes.Phi[:, fixed].T @ (M @ cut.modes.Phi[:, fixed]), compute_uv=False)
    np.testing.assert_allclose(overlap, 1.0, atol=1e-8)


def test_the_start_from_the_parts_is_near_and_from_above():
    body, top = HELD, 2 * np.pi * 6000.0
    exact = certified_modes(body.K, body.M, top).omega
    errors = []
    for parts in (2, 4):
        with solver_settings(SolverSettings("superlu", parts=parts)):
            factor = factorise(body.K)
            assert isinstance(factor, PartedFactor)
            X = multilevel_shapes(body.K, body.M, top, exact.size, factor)
        lam = np.linalg.eigvals(np.linalg.solve(X.T @ (body.M @ X), X.T @ (body.K @ X))).real
        error = np.sqrt(np.sort(lam)[: exact.size]) / exact - 1
        assert error.min() > -1e-9
        errors.append(error.max())
    assert max(errors) < 0.05
