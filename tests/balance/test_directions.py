"""Rotated shapes of a cluster, and bodies cut down to some of them."""

from dataclasses import replace

import numpy as np
import pytest

from cmsreduce.balance import cluster_directions, cluster_groups, keep_directions
from cmsreduce.errors import MatrixError
from cmsreduce.model import Damping, ModalChannels, ModalComponent
from cmsreduce.orthogonalise import ORTHOGONAL, orthogonalise, orthogonality_errors
from cmsreduce.reduce import CraigBampton
from tests.frames import line
from tests.lyapunov import mixed, response, two_close_modes


def modal(damping: Damping) -> ModalComponent:
    """A bar held nowhere, fixed at one end for its normal modes."""
    body = line("bar", [0, 0, 0], [1.5, 0, 0], 6, damping=damping)
    found = orthogonalise(CraigBampton(800.0).reduce(body, body.interface_rows("a")))
    m = found.omega.size
    return replace(found, sigma=np.arange(m) + 0.5, rankings={"gregory": np.arange(m) + 0.5})


def rotated(ch: ModalChannels) -> ModalChannels:
    """A pair cut down to the first direction of its cluster, as a mode of its own."""
    q = cluster_directions(ch, np.zeros(ch.count, dtype=np.int64)).Q[:, :1]
    w = np.sqrt((q.T * ch.omega**2) @ q)[0]
    zeta = ((q.T * (2 * ch.zeta * ch.omega)) @ q)[0] / (2 * w)
    return ModalChannels("one", w, zeta, q.T @ ch.B, ch.C1 @ q, ch.C2 @ q)


def pair_error(ch: ModalChannels, w: np.ndarray, angle: float) -> float:
    """H-infinity error of a pair with one real shape kept, its response written out."""
    q = np.array([np.cos(angle), np.sin(angle)])
    stiffness, damping = q @ (ch.omega**2 * q), q @ (2 * ch.zeta * ch.omega * q)
    gain = (q @ ch.B[:, 0]) * (ch.C2[0] @ q)
    H = response(ch, w)[:, 0, 0]
    return float(abs(H - 1j * w * gain / (stiffness - w**2 + 1j * w * damping)).max())


@pytest.mark.parametrize(
    ("apart", "c", "none", "first", "best", "degrees", "within"),
    [
        # Balancing gets 0.472, 3.574, 34.17: it has a frequency, damping and shape of its own for either state.
        (0.001, (1, 0.9), 188.04, 89.91, 2.0045, 43.4, 1.001),
        (0.001, (1, -0.9), 22.21, 89.91, 18.69, 138.1, 1.001),
        (0.01, (1, 0.9), 123.91, 89.11, 78.76, 22.6, 1.01),
        (0.5, (1, 0.9), 100.01, 60.00, 60.00, 4.0, 1.001),
    ],
)
def test_the_first_direction_of_the_golden_pairs_is_near_the_best_of_all(apart, c, none, first, best, degrees, within):
    """H-infinity errors with one shape kept, by trying all angles; theory section 4 has the models."""
    ch = two_close_modes(apart, c)
    w = np.unique(np.concatenate([np.linspace(0.9, 1.1, 2001), ch.omega[1] + np.linspace(-0.02, 0.02, 2001)]))
    angles = np.radians(np.arange(0.0, 180.0, 0.1))
    errors = np.array([pair_error(ch, w, angle) for angle in angles])
    nothing = abs(response(ch, w)).max()
    assert (nothing, errors[0]) == (pytest.approx(none, abs=0.01), pytest.approx(first, abs=0.01))
    assert errors.min() == pytest.approx(best, rel=3e-3)
    assert np.degrees(angles[errors.argmin()]) == pytest.approx(degrees, abs=0.11 if best != 60.0 else 5.0)
    found = cluster_directions(ch, np.zeros(2, dtype=np.int64))
    q = found.Q[:, 0]
    error = pair_error(ch, w, np.arctan2(q[1], q[0]))
    assert error <= within * errors.min() and error < min(nothing, errors[0] * 1.0001)
    # What it is chosen by, the mean square, from the responses.
    v = np.linspace(0, 40, 800_001)
    H, kept = response(ch, v)[:, 0, 0], response(rotated(ch), v)[:, 0, 0]
    assert found.error[0] == pytest.approx(np.linalg.norm(H - kept) / np.linalg.norm(H), rel=2e-3)


def test_one_direction_of_one_frequency_lies_among_the_singular_vectors_of_its_rows():
    rng = np.random.default_rng(0)
    B, C = rng.standard_normal((4, 1)), rng.standard_normal((1, 4))
    ch = ModalChannels("four", np.full(4, 3.0), np.full(4, 1e-5), B, C, np.zeros((0, 4)))
    found = cluster_directions(ch, np.zeros(4, dtype=np.int64))
    U, _, _ = np.linalg.svd(np.hstack([B / np.linalg.norm(B), C.T / np.linalg.norm(C)]))
    # One direction does what four modes do: that in which they are seen, or that in which they are driven.
    kept = found.Q[:, :1]
    np.testing.assert_allclose(C @ kept @ kept.T @ B, C @ B, rtol=1e-4)
    np.testing.assert_allclose(np.linalg.norm(U[:, :2].T @ kept), 1.0, rtol=1e-4)
    assert found.error.max() < 1e-5


def test_the_rotation_is_orthogonal_and_stays_within_clusters():
    ch = mixed(5, modes=8)
    cluster = cluster_groups(ch)
    found = cluster_directions(ch, cluster)
    np.testing.assert_allclose(found.Q.T @ found.Q, np.eye(8), atol=1e-14)
    assert not found.Q[cluster[:, None] != cluster[None, :]].any()
    last = np.array([np.flatnonzero(cluster == each)[-1] for each in cluster])
    assert not found.error[last].any() and (found.error <= 1 + 1e-9).all()


def test_modes_far_apart_are_not_mixed_even_in_one_cluster():
    ch = two_close_modes(0.5, (1, 0.9))
    found = cluster_directions(ch, np.zeros(2, dtype=np.int64))
    assert abs(np.abs(found.Q) - np.eye(2)).max() < 0.1


@pytest.mark.parametrize(
    "damping",
    [Damping(modal=0.01), Damping(structural=0.02), Damping(rayleigh=(1.0, 1e-5)), Damping()],
    ids=["modal", "structural", "rayleigh", "none"],
)
def test_all_directions_are_the_body_itself(damping):
    component = modal(damping)
    e = component.elastic_count
    Q, _ = np.linalg.qr(np.random.default_rng(1).standard_normal((e, e)))
    found = keep_directions(component, Q)
    np.testing.assert_allclose(found.omega, component.omega, rtol=1e-9)
    np.testing.assert_allclose(found.zeta, component.zeta, rtol=1e-8)
    M = found.body.M.toarray()
    likeness = abs(found.Phi.T @ M @ component.Phi)
    np.testing.assert_allclose(likeness, np.eye(component.omega.size), atol=1e-8)


def test_some_directions_are_orthonormal_modes_between_the_old_frequencies():
    component = modal(Damping(modal=0.01))
    w = component.omega[component.elastic]
    Q = np.zeros((w.size, 2))
    Q[[0, 2], 0], Q[1, 1] = [0.6, 0.8], 1.0
    found = keep_directions(component, Q)
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
    assert found.why[6 + new].startswith("combination of close modes, most alike mode 9; ")
    assert found.why[7 - new] == component.why[7]
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
    np.testing.assert_allclose(keep_directions(component, Q).D, D[np.ix_([*range(6), 6, 9], [*range(6), 6, 9])])


def test_nothing_kept_is_the_rigid_body():
    component = modal(Damping(modal=0.01))
    assert keep_directions(component, np.zeros((component.elastic_count, 0))).omega.tolist() == [0.0] * 6


@pytest.mark.parametrize("Q", [np.eye(3)[:, :1], np.ones((100, 1))], ids=["too short", "not unit"])
def test_directions_that_are_none(Q):
    component = modal(Damping(modal=0.01))
    if Q.shape[0] == 100:
        Q = np.ones((component.elastic_count, 1))
    with pytest.raises(MatrixError, match=r"'bar': directions .* must be orthonormal"):
        keep_directions(component, Q)
