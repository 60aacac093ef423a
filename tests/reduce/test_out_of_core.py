"""Bodies whose basis does not fit in the memory it is given, against the same bodies in memory."""

import numpy as np
import pytest

from cmsreduce.linalg.machine import SolverSettings, solver_settings
from cmsreduce.model import mapped_in
from cmsreduce.orthogonalise import ORTHOGONAL, orthogonalise, orthogonality_errors
from cmsreduce.reduce import AugmentedBody, BenfieldHruda, CraigBampton, Guyan, InterfaceReduction, MacNealRubin
from tests.solids import block, face

CELLS = (12, 5, 5)
# 1404 dofs; a face is the interface, so that the basis has more columns than a block.
SOLID = block("solid", (5.0, 1.0, 1.0), CELLS)
WIDE = np.arange(SOLID.n - 3 * len(face(CELLS, 0)), SOLID.n)
FEW = WIDE[:12]
TWIST = np.zeros((SOLID.n, 1))
TWIST[[300, 900], 0] = 1.0, -1.0
METHODS = {
    "craig-bampton": (CraigBampton(900.0), WIDE),
    "characteristic": (CraigBampton(900.0, interface_reduction=InterfaceReduction(4000.0)), WIDE),
    "guyan": (Guyan(0.0), WIDE),
    "macneal-rubin": (MacNealRubin(900.0), WIDE[:70]),
    "benfield-hruda": (BenfieldHruda(900.0), FEW),
    "augmented": (AugmentedBody(900.0), FEW),
}
# The arithmetic is the same; sums over values that lie otherwise in memory are taken in another order.
SAME = 1e-10


def distance(Phi, other):
    """Largest difference of a column, relative to its largest entry."""
    return (abs(Phi - other).max(axis=0) / abs(other).max(axis=0)).max()


@pytest.mark.parametrize("name", METHODS)
def test_a_basis_on_disk_changes_nothing(name, tmp_path, monkeypatch):
    method, interface = METHODS[name]

    def done(limit):
        monkeypatch.setattr(SolverSettings, "basis_limit", limit)
        with solver_settings(SolverSettings(scratch=tmp_path)):
            examined = method.examine(SOLID, interface, TWIST, tested=TWIST, enrich=True)
            modal = orthogonalise(examined.component)
            return examined, modal, orthogonality_errors(modal)

    (one, modal, errors), (other, modal2, errors2) = done(np.inf), done(0.0)
    here, there = one.component, other.component
    assert mapped_in(here.modes.Phi) is None and mapped_in(there.modes.Phi) == tmp_path
    assert there.modes.label == here.modes.label
    assert distance(there.modes.Phi, here.modes.Phi) < SAME
    np.testing.assert_allclose(there.K, here.K, rtol=0, atol=1e-14 * abs(here.K).max())
    # What is added to a basis may turn within its span.
    assert mapped_in(one.enriched.modes.Phi) is None and mapped_in(other.enriched.modes.Phi) == tmp_path
    np.testing.assert_allclose(*(orthogonalise(each.enriched).omega for each in (other, one)), rtol=1e-8)
    np.testing.assert_allclose(other.missed, one.missed, rtol=0, atol=1e-12)
    np.testing.assert_allclose(modal2.omega, modal.omega, rtol=1e-11)
    # So may the bending modes of a square section, which come in pairs.
    # Few columns, no more than a block of right-hand sides, come back into memory.
    assert (mapped_in(modal2.Phi) == tmp_path) is (modal2.Phi.shape[1] > 64)
    both = (each.Phi[:, : each.elastic.stop] for each in (modal, modal2))
    overlap = np.linalg.svd(next(both).T @ (SOLID.M @ next(both)), compute_uv=False)
    np.testing.assert_allclose(overlap, 1.0, atol=1e-9)
    assert max(errors) < ORTHOGONAL and max(errors2) < ORTHOGONAL
    assert not list(tmp_path.iterdir())
