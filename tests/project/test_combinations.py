"""Bodies cut down to combinations of their modes."""

from dataclasses import replace

import numpy as np
import pytest

from cmsreduce.errors import MatrixError
from cmsreduce.model import Damping, ModalComponent
from cmsreduce.orthogonalise import ORTHOGONAL, orthogonalise, orthogonality_errors
from cmsreduce.project import keep_combinations
from cmsreduce.reduce import CraigBampton
from tests.frames import line


def modal(damping: Damping) -> ModalComponent:
    """A bar held nowhere, fixed at one end for its normal modes."""
    body = line("bar", [0, 0, 0], [1.5, 0, 0], 6, damping=damping)
    found = orthogonalise(CraigBampton(800.0).reduce(body, body.interface_rows("a")))
    m = found.omega.size
    return replace(found, sigma=np.arange(m) + 0.5, rankings={"gregory": np.arange(m) + 0.5})


@pytest.mark.parametrize(
    "damping",
    [Damping(modal=0.01), Damping(structural=0.02), Damping(rayleigh=(1.0, 1e-5)), Damping()],
    ids=["modal", "structural", "rayleigh", "none"],
)
def test_all_combinations_are_the_body_itself(damping):
    component = modal(damping)
    e = component.elastic_count
    Q, _ = np.linalg.qr(np.random.default_rng(1).standard_normal((e, e)))
    found = keep_combinations(component, Q, "asked for")
    np.testing.assert_allclose(found.omega, component.omega, rtol=1e-9)
    np.testing.assert_allclose(found.zeta, component.zeta, rtol=1e-8)
    M = found.body.M.toarray()
    likeness = abs(found.Phi.T @ M @ component.Phi)
    np.testing.assert_allclose(likeness, np.eye(component.omega.size), atol=1e-8)


def test_some_combinations_are_orthonormal_modes_between_the_old_frequencies():
    component = modal(Damping(modal=0.01))
    w = component.omega[component.elastic]
    Q = np.zeros((w.size, 2))
    Q[[0, 2], 0], Q[1, 1] = [0.6, 0.8], 1.0
    found = keep_combinations(component, Q, "asked for")
    assert max(orthogonality_errors(found)) < ORTHOGONAL
    assert found.elastic_count == 2 and found.rigid_count == 6
    expected = np.sort([np.sqrt(0.36 * w[0] ** 2 + 0.64 * w[2] ** 2), w[1]])
    np.testing.assert_allclose(found.omega[6:], expected, rtol=1e-12)
    mean = (0.36 * w[0] + 0.64 * w[2]) * 0.01
    new = int(np.argmin(abs(found.omega[6:] - np.sqrt(0.36 * w[0] ** 2 + 0.64 * w[2] ** 2))))
    assert found.zeta[6 + new] == pytest.approx(mean / found.omega[6 + new], rel=1e-12)
    # Most alike modes 9 and 8.
    order = [8, 7] if new == 0 else [7, 8]
    np.testing.assert_array_equal(found.sigma[6:], component.sigma[order])
    np.testing.assert_array_equal(found.rankings["gregory"], found.sigma)
    assert found.why[6 + new] == "combination of modes, most alike mode 9; asked for"
    assert found.why[7 - new] == "asked for"
    assert found.kind[6:] == tuple(component.kind[k] for k in order)


def test_a_damping_matrix_is_projected_whole():
    component = modal(Damping(modal=0.01))
    m, e = component.omega.size, component.elastic_count
    S = np.random.default_rng(2).standard_normal((m, m))
    D = S @ S.T
    zeta = np.zeros(m)
    zeta[6:] = D.diagonal()[6:] / (2 * component.omega[6:])
    component = replace(component, D=D, zeta=zeta)
    Q = np.eye(e)[:, [0, 3]]
    np.testing.assert_allclose(
        keep_combinations(component, Q, "asked for").D, D[np.ix_([*range(6), 6, 9], [*range(6), 6, 9])]
    )


def test_nothing_kept_is_the_rigid_body():
    component = modal(Damping(modal=0.01))
    assert keep_combinations(component, np.zeros((component.elastic_count, 0)), "asked for").omega.tolist() == [0.0] * 6


@pytest.mark.parametrize("Q", [np.eye(3)[:, :1], np.ones((100, 1))], ids=["too short", "not unit"])
def test_combinations_that_are_none(Q):
    component = modal(Damping(modal=0.01))
    if Q.shape[0] == 100:
        Q = np.ones((component.elastic_count, 1))
    with pytest.raises(MatrixError, match=r"'bar': combinations .* must be orthonormal"):
        keep_combinations(component, Q, "asked for")
