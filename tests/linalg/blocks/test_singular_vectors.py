"""Singular values where LAPACK's divide and conquer does not converge."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.linalg.blocks import svd
from cmsreduce.linalg.eigen import null_space


@pytest.fixture
def no_convergence(monkeypatch: pytest.MonkeyPatch) -> None:
    """Divide and conquer as it ends for joints of many equal bodies on one point, on some processors."""
    whole = la.svd

    def divide(A, *given, lapack_driver="gesdd", **named):
        if lapack_driver == "gesdd":
            raise np.linalg.LinAlgError("SVD did not converge")
        return whole(A, *given, lapack_driver=lapack_driver, **named)

    monkeypatch.setattr("scipy.linalg.svd", divide)


@pytest.mark.parametrize("shape", [(7, 4), (4, 7)])
@pytest.mark.parametrize("full", [True, False])
def test_it_converges(no_convergence: None, shape: tuple[int, int], full: bool) -> None:
    A = np.random.default_rng(0).standard_normal(shape)
    U, s, Vt = svd(A, full_matrices=full)
    assert U.shape == (shape[0], shape[0] if full else 4) and Vt.shape == (shape[1] if full else 4, shape[1])
    np.testing.assert_allclose((U[:, :4] * s) @ Vt[:4], A, atol=1e-14)
    np.testing.assert_allclose(s**2, np.linalg.eigvalsh(A @ A.T)[::-1][:4], rtol=1e-12)


def test_joints_of_equal_bodies_have_a_null_space(no_convergence: None) -> None:
    """Forty bodies on one point move with it: six motions."""
    A = np.hstack([np.tile(np.eye(6), (40, 1)), -np.eye(240)])
    T, rank = null_space(A)
    assert (rank, T.shape) == (240, (246, 6))
    assert abs(A @ T).max() < 1e-14
    np.testing.assert_allclose(T.T @ T, np.eye(6), atol=1e-14)
