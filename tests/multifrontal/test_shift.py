"""Difference of two sparse matrices, compared with dense arrays."""

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.multifrontal import shifted
from tests.multifrontal.matrices import lattice

K = lattice(3, 3, 2)
MASSES = {
    "of each row": sp.eye_array(K.shape[0], format="csc"),
    "as wide as the stiffness": sp.csc_array(K * 0.3),
    "with a pair that the stiffness lacks": sp.csc_array(([1.0, 1.0, 2.0], ([0, 53, 53], [53, 0, 53])), shape=K.shape),
    "single precision": sp.csc_array(K, dtype=np.float32),
}


@pytest.mark.parametrize("mass", MASSES)
def test_a_shift_is_that_of_dense_matrices(mass):
    M, before = MASSES[mass], K.copy()
    np.testing.assert_array_equal(shifted(K, M, 0.7).toarray(), K.toarray() - 0.7 * M.toarray())
    assert (K.data == before.data).all()


def test_rows_in_any_order_are_combined():
    M = K.copy()
    for j in range(M.shape[0]):
        column = slice(M.indptr[j], M.indptr[j + 1])
        M.indices[column], M.data[column] = M.indices[column][::-1].copy(), M.data[column][::-1].copy()
    M.has_sorted_indices = False
    np.testing.assert_allclose(shifted(K, M, 0.5).toarray(), K.toarray() / 2, atol=1e-15)
