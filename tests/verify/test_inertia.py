"""Principal inertia of solids with closed forms, and inertias that no body has."""

import numpy as np
import pytest

from cmsreduce.model import cross_matrix
from cmsreduce.verify import inertia_excess, principal_inertia, rigid_mass_properties
from tests.frames import rotation


def rigid_mass(mass, cg, inertia):
    """R^T M R about the origin."""
    skew = cross_matrix(cg)
    coupling = mass * skew
    return np.block([[mass * np.eye(3), coupling.T], [coupling, inertia + mass * skew.T @ skew]])


def brick(mass, a, b, c):
    return mass / 12 * np.diag([b**2 + c**2, a**2 + c**2, a**2 + b**2])


TURN = rotation([1, -2, 0.5], 0.8)


def test_a_turned_brick_shows_its_edges():
    """Moments m/12 (b2 + c2), radii their roots, axes along the edges."""
    J = TURN @ brick(3.0, 1, 2, 4) @ TURN.T
    found = principal_inertia(rigid_mass_properties(rigid_mass(3.0, np.array([4.0, -1, 2]), J)))
    np.testing.assert_allclose(found.moments, 3.0 / 12 * np.array([5, 17, 20]), rtol=1e-12)
    np.testing.assert_allclose(found.radii, np.sqrt(np.array([5, 17, 20]) / 12), rtol=1e-12)
    np.testing.assert_allclose(found.gyration, np.sqrt(J.diagonal() / 3.0), rtol=1e-12)
    # Ascending moments: about z (1 x 2), y, x.
    np.testing.assert_allclose(abs(found.axes @ TURN[:, [2, 1, 0]]), np.eye(3), atol=1e-12)
    assert np.linalg.det(found.axes) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("moments", "excess"),
    [
        ((1, 1, 1), 0.0),
        # A plate and a rod are at the edge of what is possible.
        ((1, 1, 2), 0.0),
        ((0, 1, 1), 0.0),
        ((1, 1, 2.5), 0.2),
        ((-0.5, 2, 2), 0.25),
    ],
)
def test_the_triangle_inequality_of_moments(moments, excess):
    J = TURN @ np.diag(np.array(moments, dtype=float)) @ TURN.T
    assert inertia_excess(rigid_mass(2.0, np.array([1.0, 2, 3]), J)) == pytest.approx(excess, abs=1e-12)


def test_a_body_held_in_its_plane_has_no_inertia_to_judge():
    rigid = rigid_mass(2.0, np.zeros(3), np.eye(3))
    rigid[2, 2] = 0.0
    assert inertia_excess(rigid) is None
