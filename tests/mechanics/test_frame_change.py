"""Integrals in another frame, against sums over particles and against the finite-element body itself."""

from __future__ import annotations

import numpy as np
import pytest

from cmsreduce.mechanics import (
    integrals_about,
    mean_axis_motion,
    modal_integrals,
    of_combined_modes,
    rigid_mass_matrix,
    without_rigid_motion,
)
from cmsreduce.model import ModalIntegrals, rigid_body_shapes
from tests.frames import rotation
from tests.solids import block
from tests.write.particles import particles

NAMES = ("first_moment", "inertia", "phi", "r_cross_phi", "r_phi", "phi_phi")


def summed(m: np.ndarray, x: np.ndarray, u: np.ndarray) -> dict[str, np.ndarray]:
    """Integrals of particles of mass m (n,) at x (n, 3) with modes u (n, 3, k)."""
    squares = np.einsum("n,ni,nj->ij", m, x, x)
    return {
        "first_moment": m @ x,
        "inertia": np.trace(squares) * np.eye(3) - squares,
        "phi": np.einsum("n,nia->ia", m, u),
        "r_cross_phi": np.einsum("n,nia->ia", m, np.cross(x[:, :, None], u, axis=1)),
        "r_phi": np.einsum("n,ni,nja->ija", m, x, u),
        "phi_phi": np.einsum("n,nia,njb->ijab", m, u, u),
    }


def assert_same(found: ModalIntegrals, expected: dict[str, np.ndarray]) -> None:
    for name in NAMES:
        np.testing.assert_allclose(
            getattr(found, name), expected[name], atol=1e-12 * abs(expected[name]).max(initial=1)
        )


def test_another_point_and_other_axes() -> None:
    body = particles()
    to, turn = np.array([0.7, -1.1, 0.4]), rotation([2, -1, 3], 1.1)
    axes = turn @ body.integrals.axes
    x = (body.x - body.integrals.axes @ (to - body.integrals.origin)) @ turn.T
    assert_same(integrals_about(body.integrals, to, axes), summed(body.m, x, turn @ body.u))


def test_a_rigid_motion_taken_off_and_modes_combined() -> None:
    body, rng = particles(), np.random.default_rng(3)
    motion, X = rng.normal(size=(6, 4)), rng.normal(size=(4, 4))
    u = body.u - motion[:3] - np.cross(motion[None, 3:], body.x[:, :, None], axis=1)
    left = without_rigid_motion(body.integrals, motion)
    assert_same(left, summed(body.m, body.x, u))
    assert_same(of_combined_modes(left, X), summed(body.m, body.x, u @ X))


def test_mean_axes_leave_no_momentum() -> None:
    body = particles()
    motion = mean_axis_motion(body.integrals)
    left = without_rigid_motion(body.integrals, motion)
    assert abs(left.phi).max() < 1e-14 and abs(left.r_cross_phi).max() < 1e-13
    # The kinetic energy of the rigid motion about the origin, of which nothing is left.
    energy = np.einsum("iiaa->a", body.integrals.phi_phi) - np.einsum("iiaa->a", left.phi_phi)
    np.testing.assert_allclose(energy, np.diagonal(motion.T @ rigid_mass_matrix(body.integrals) @ motion), rtol=1e-12)


@pytest.mark.parametrize("lumping", ["consistent", "row-sum"])
def test_integrals_of_a_solid_computed_afresh(lumping: str) -> None:
    body, rng = block("solid", (1.0, 0.2, 0.3), (3, 2, 2), origin=(1.0, 2.0, 3.0)), np.random.default_rng(5)
    shapes, motion = rng.normal(size=(body.n, 5)), rng.normal(size=(6, 5))
    to, axes = np.array([0.4, 0.1, -0.6]), rotation([1, 2, -1], 0.8)
    before = modal_integrals(body, shapes, origin=(0.2, -0.3, 0.5), lumping=lumping)
    found = without_rigid_motion(integrals_about(before, to, axes), motion)
    rigid = rigid_body_shapes(body.dofs, body.nodes, to) @ np.kron(np.eye(2), axes.T)
    afresh = modal_integrals(body, shapes - rigid @ motion, origin=to, axes=axes, lumping=lumping)
    assert_same(found, {name: getattr(afresh, name) for name in NAMES})
    np.testing.assert_allclose(rigid_mass_matrix(found), rigid_mass_matrix(afresh), atol=1e-11 * before.mass)
