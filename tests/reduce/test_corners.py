"""The united basis of mode sets at several parameters: the span of all of them, nothing twice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.model import ModeSet
from cmsreduce.reduce import CraigBampton
from cmsreduce.reduce.corners import with_corners
from tests.frames import line

CUTOFF = 200.0


@pytest.mark.parametrize("spread", [0.0, 4.0, 8.0])
def test_shapes_of_any_size_are_not_added_again(spread: float) -> None:
    """Energies apart by a factor of 1 to 1e32, as those of unit rotations and of modes of unit mass are."""
    body = line("bar", [0, 0, 0], [1, 0, 0], 10)
    modes = CraigBampton(CUTOFF).reduce(body, body.interface_rows("a")).modes
    Phi, own = np.asarray(modes.Phi), modes.Phi.shape[1] - 2
    scale = 10.0 ** np.linspace(-spread, spread, own)
    base = ModeSet(modes.method, Phi[:, :own] * scale, modes.kind[:own], modes.source_hz[:own], modes.label[:own])
    corner = replace(modes, Phi=Phi @ np.random.default_rng(3).standard_normal((own + 2, own + 2)))
    found = with_corners(body, base, [("low", modes), ("high", corner)], CUTOFF)
    assert found.Phi.shape[1] == own + 2
    np.testing.assert_array_equal(found.Phi[:, :own], base.Phi)
    added = np.asarray(found.Phi)[:, own:]
    W = (body.K + (2 * np.pi * CUTOFF) ** 2 * body.M).toarray()
    L = la.cholesky(W)
    assert la.subspace_angles(L @ np.hstack([Phi[:, :own], added]), L @ Phi).max() < 1e-7
    np.testing.assert_allclose(added.T @ W @ added, np.eye(2), atol=1e-9)
