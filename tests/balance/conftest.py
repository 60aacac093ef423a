"""The space station of the SLICOT collection, in modal form."""

from pathlib import Path

import numpy as np
import pytest

from cmsreduce.model import ModalChannels


@pytest.fixture(scope="session")
def space_station(shared_data: Path) -> ModalChannels:
    """ISS-1R: q' = v, v' = -w^2 q - 2 zeta w v + b u, y = c v."""
    from scipy.io import loadmat

    file = loadmat(shared_data / "slicot" / "iss.mat")
    A, B, C = (np.asarray(file[k].todense() if hasattr(file[k], "todense") else file[k], dtype=float) for k in "ABC")
    n = A.shape[0] // 2
    omega = np.sqrt(-np.diag(A[n:, :n]))
    zeta = -np.diag(A[n:, n:]) / (2 * omega)
    assert np.count_nonzero(A[n:, :n]) == n and abs(zeta - 0.005).max() < 1e-6
    assert not C[:, :n].any()
    return ModalChannels("iss", omega, zeta, B[n:], C[:, :n], C[:, n:])
