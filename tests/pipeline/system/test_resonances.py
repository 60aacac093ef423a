"""Peaks of complex modes: closed forms, also where a mode has no damping."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from cmsreduce.linalg.eigen import ComplexModes
from cmsreduce.pipeline.system.resonances import damped_modes_of


@pytest.mark.filterwarnings("error")
def test_a_mode_without_damping_has_no_bound_where_it_is_seen_and_none_of_it_elsewhere() -> None:
    """Three masses of one: on a spring alone, on a spring with a damper, and on one that no channel sees."""
    omega, zeta = np.array([2.0, 5.0, 7.0]), np.array([0.0, 0.01, 0.0])
    system = SimpleNamespace(
        M=np.eye(3),
        D=np.diag(2 * zeta * omega),
        B=np.array([[1.0], [1.0], [0.0]]),
        C1=np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 1.0]]),
        C2=np.zeros((2, 3)),
        T=np.eye(3),
        sizes={"body": 3},
    )
    s = -zeta * omega + 1j * omega * np.sqrt(1 - zeta**2)
    shapes = np.eye(3, dtype=complex)
    found = damped_modes_of(system, ComplexModes(s, shapes, shapes, np.empty(0)))  # type: ignore[arg-type]
    expected = np.array([[np.inf, 0.0], [0.0, 1 / (2 * 0.01 * 25.0)], [0.0, 0.0]])
    np.testing.assert_allclose(found.peaks[:, :, 0], expected, rtol=1e-12)
