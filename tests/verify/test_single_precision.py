"""Single precision: a bar whose matrices are rounded by hand, and bodies that are too stiff for seven digits."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.model import FEModel
from cmsreduce.verify import single_precision
from tests.frames import BAR, Section, line

# As wide as a plank and 0.01 mm thin: it stretches 4e5 times faster than it bends.
STRIP = Section(Iy=1e-13, Iz=1e-8)


def modal(body: FEModel) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """All modes by scipy: mass, stiffness, shapes at the interfaces, and omega."""
    squared, Phi = la.eigh(body.K.toarray(), body.M.toarray())
    squared[:6] = 0.0
    rows = np.concatenate([body.interface_rows(name) for name in body.interfaces])
    return np.eye(body.n), np.diag(squared), Phi[rows], np.sqrt(squared)


def single(A: np.ndarray) -> np.ndarray:
    return A.astype(np.float32).astype(float)


def test_all_dofs_at_the_interfaces_are_the_matrices_themselves() -> None:
    """One bar: in interface dofs it is its own stiffness and mass, which float32 rounds as it stands."""
    body = line("bar", [0.1, -0.3, 0.7], [0.9, 0.4, 1.1], 1)
    M, K, shapes, omega = modal(body)
    found = single_precision(M, K, shapes, 6, 0)
    rounded = np.sort(la.eigvals(single(body.K.toarray()), single(body.M.toarray())).real)
    false = np.sqrt(abs(rounded[:6]).max()) / (2 * np.pi)
    assert found.boundary_rigid_hz == pytest.approx(false, rel=1e-3)
    shift = abs(np.sqrt(rounded[6:]) / omega[6:] - 1).max()
    assert found.boundary_free == pytest.approx(shift, rel=1e-2)
    # A spring to ground of the rounding of the largest stiffness.
    assert 0.01 < 2 * np.pi * found.boundary_rigid_hz / np.sqrt(2**-24 * omega[-1] ** 2) < 1.0


@pytest.mark.parametrize("section", [BAR, STRIP], ids=["bar", "strip"])
def test_modes_lose_no_more_than_their_digits(section: Section) -> None:
    """Half an ulp of the square of each frequency, however stiff the body is."""
    M, K, shapes, omega = modal(line("bar", [0, 0, 0], [2, 0, 0], 8, section=section))
    found = single_precision(M, K, shapes, 6, 0)
    assert 0 < found.free <= 0.5 * 2**-24 * (1 + 1e-6)
    assert found.lowest_hz == pytest.approx(omega[6] / (2 * np.pi), rel=1e-12)
    assert not found.modal_matters


def test_a_stiff_body_is_lost_in_interface_dofs_alone() -> None:
    bar, strip = (
        single_precision(*modal(line("bar", [0, 0, 0], [1.6, 1.2, 0], 8, section=section))[:3], 6, 0)
        for section in (BAR, STRIP)
    )
    assert not bar.boundary_matters and strip.boundary_matters
    assert not bar.modal_matters and not strip.modal_matters
    # Stretched, both have one stiffness, and its rounding is one spring; only the strip bends more easily than that.
    assert bar.boundary_rigid_hz < 1e-2 * bar.lowest_hz
    assert strip.boundary_rigid_hz > 0.05 * strip.lowest_hz


def test_clamped_frequencies_by_hand() -> None:
    """Held at both ends: constraint rows eliminated by a QR factorisation, in double and rounded."""
    M, K, shapes, omega = modal(line("bar", [0.1, -0.3, 0.7], [0.9, 0.4, 1.1], 6))
    found = single_precision(M, K, shapes, 6, 0)

    def held(M: np.ndarray, K: np.ndarray, S: np.ndarray) -> np.ndarray:
        N = la.qr(S.T)[0][:, S.shape[0] :]
        return 1 / np.sqrt(la.eigvalsh(N.T @ M @ N, N.T @ K @ N)[::-1])

    before, after = held(M, K, shapes), held(single(M), single(K), single(shapes))
    inside = before <= omega[-1]
    assert found.held == pytest.approx(abs(after / before - 1)[inside].max(), rel=1e-3)


def test_one_free_joint_makes_no_false_spring() -> None:
    """A determinate interface: the rigid modes follow whatever the neighbour does."""
    M, K, shapes, _ = modal(line("bar", [0, 0, 0], [2, 0, 0], 8, section=STRIP, interfaces={"a": 1}))
    found = single_precision(M, K, shapes, 6, 0)
    assert found.rigid_hz == 0.0


def test_a_rigid_body_has_nothing_to_round() -> None:
    found = single_precision(np.eye(6), np.zeros((6, 6)), np.eye(6), 6, 0)
    assert not found.modal_matters and not found.boundary_matters
