"""The mean square error of a cluster, against two Lyapunov equations."""

import numpy as np
import pytest

from cmsreduce.balance import component_costs, direction_error
from cmsreduce.balance.cluster_error import ClusterError
from cmsreduce.errors import DampingError
from cmsreduce.model import ModalChannels
from tests.lyapunov import dense_states, gramians, mixed, two_close_modes


def mean_square(ch: ModalChannels) -> float:
    """tr(C W C^T) with W from scipy."""
    C = dense_states(ch)[2]
    return float(np.trace(C @ gramians(ch)[0] @ C.T))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kept", [0, 1, 3, 5])
def test_the_error_is_that_of_the_model_that_is_left(seed, kept):
    ch = mixed(seed)
    Q = np.linalg.qr(np.random.default_rng(seed).standard_normal((6, 6)))[0][:, :kept]
    expected = np.sqrt(mean_square(direction_error(ch, Q)) / mean_square(ch))
    both = ClusterError(ch).relative(np.stack([Q, np.eye(6)[:, :kept]]))
    alone = np.sqrt(mean_square(ch.only(np.arange(kept, 6))) / mean_square(ch))
    np.testing.assert_allclose(both, [expected, alone], rtol=1e-9)


@pytest.mark.parametrize("band", [(0.0, 4.0), (2.0, 7.0), (3.0, np.inf)])
def test_a_band_is_that_of_the_gramians(band):
    ch = mixed(4)
    Q = np.linalg.qr(np.random.default_rng(4).standard_normal((6, 2)))[0]
    lost, whole = component_costs(direction_error(ch, Q), band).sum(), component_costs(ch, band).sum()
    assert ClusterError(ch, band).relative(Q[None])[0] == pytest.approx(np.sqrt(lost / whole), rel=1e-9)


def test_a_cluster_that_nothing_drives_loses_nothing():
    ch = mixed(0)
    silent = ModalChannels("silent", ch.omega, ch.zeta, 0 * ch.B, ch.C1, ch.C2)
    assert ClusterError(silent).relative(np.eye(6)[None, :, :2]).tolist() == [0.0]


def test_an_undamped_cluster_has_no_mean_square():
    ch = two_close_modes(0.001, (1, 0.9))
    with pytest.raises(DampingError, match="the error of a cluster needs positive damping"):
        ClusterError(ModalChannels("pair", ch.omega, 0 * ch.zeta, ch.B, ch.C1, ch.C2))
