"""Bodies in one piece and in several."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.errors import MatrixError
from cmsreduce.mechanics import check_connected
from cmsreduce.mechanics.undetermined import parts
from tests.frames import frame

FIVE = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [5, 0, 0], [6, 0, 0]]


def test_one_piece():
    body = frame("bar", FIVE, [(1, 2), (2, 3), (3, 4), (4, 5)])
    assert set(parts(body)) == {0}
    check_connected(body)


def test_pieces_are_named():
    body = frame("bars", FIVE, [(1, 2), (2, 3), (4, 5)])
    assert np.unique(parts(body), return_counts=True)[1].tolist() == [18, 12]
    with pytest.raises(
        MatrixError, match=r"'bars' is not one piece: 2 parts .*3 nodes around node 1; 2 nodes around node 4"
    ):
        check_connected(body)


def test_mass_couples_too():
    body = frame("bars", FIVE, [(1, 2), (2, 3), (4, 5)])
    M = body.M.tolil()
    M[12, 18] = M[18, 12] = 1e-3
    check_connected(replace(body, M=sp.csc_array(M)))


def test_an_empty_dof_is_named():
    body = frame("bar", FIVE[:3], [(1, 2), (2, 3)])
    K, M = body.K.tolil(), body.M.tolil()
    for A in (K, M):
        A[9, :] = A[:, 9] = 0.0
    with pytest.raises(MatrixError, match=r"1 dofs have neither stiffness nor mass, the first is 2\.4"):
        check_connected(replace(body, K=sp.csc_array(K), M=sp.csc_array(M)))
