"""Momentum of modes: a uniform cantilever by hand, all modes together, and free systems in any setting."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.assemble import assemble, place_bodies, system_modes
from cmsreduce.errors import ConstraintError, DofMapError
from cmsreduce.model import Configuration, Scene
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import CraigBampton
from cmsreduce.verify import (
    articulation_inertia,
    articulation_sensors,
    carried_momentum,
    coupled_momentum,
    held_modes,
    hinges_locked,
    momentum_residual,
    shape_momentum,
)
from tests.assemble.rigs import joint, rigid_body, substructures
from tests.frames import Section, line

# Roots of cos x cosh x = -1.
ROOTS = np.array([1.8751040687, 4.6940911330, 7.8547574382])
LENGTH = 2.0


def cantilever(elements=40):
    """Along x from the origin, bending in the y plane much softer than in the other."""
    body = line("beam", [0, 0, 0], [LENGTH, 0, 0], elements, section=Section(Iy=1e-6, Iz=1e-9))
    return body, body.interface_rows("a")


def clamped_modes(body, held):
    free = np.setdiff1d(np.arange(body.n), held)
    omega2, X = la.eigh(body.K.toarray()[np.ix_(free, free)], body.M.toarray()[np.ix_(free, free)])
    Phi = np.zeros((body.n, free.size))
    Phi[free] = X
    return np.sqrt(omega2), Phi


def test_a_uniform_cantilever_has_the_momentum_of_its_roots():
    """P^2 = 4 s^2 m / x^2 with s = (cosh x + cos x)^-1 (sinh x - sin x), H^2 = 4 m L^2 / x^4."""
    body, held = cantilever()
    mass = 2700 * 4e-4 * LENGTH
    _, Phi = clamped_modes(body, held)
    p = shape_momentum(body, Phi[:, :3])
    s = (np.sinh(ROOTS) - np.sin(ROOTS)) / (np.cosh(ROOTS) + np.cos(ROOTS))
    np.testing.assert_allclose(p[1] ** 2, 4 * s**2 * mass / ROOTS**2, rtol=1e-5)
    np.testing.assert_allclose(p[5] ** 2, 4 * mass * LENGTH**2 / ROOTS**4, rtol=1e-5)
    # The highest eigenvalue is 3e9 times the distance of these modes: rounding mixes the others in by as much.
    np.testing.assert_allclose(p[[0, 2, 3, 4]], 0, atol=1e-7)


def test_modes_of_a_reduced_body_held_at_its_interface_are_those_of_its_matrices():
    body, held = cantilever(20)
    omega, Phi = clamped_modes(body, held)
    component = orthogonalise(CraigBampton(cutoff_hz=omega[-1]).reduce(body))
    found = held_modes(component, held)
    assert found is not None
    # The rounding of the highest eigenvalue, 5e10 times the lowest.
    np.testing.assert_allclose(2 * np.pi * found[0][:10], omega[:10], rtol=5e-6)
    shapes = component.Phi @ found[1][:, :10]
    np.testing.assert_allclose(abs(Phi[:, :10].T @ body.M @ shapes), np.eye(10), atol=1e-5)
    assert held_modes(component, np.arange(body.n)) is None


def test_all_modes_together_have_the_mass_that_is_not_at_the_clamp():
    body, held = cantilever()
    _, Phi = clamped_modes(body, held)
    p = shape_momentum(body, Phi)
    limit = coupled_momentum(body, held)
    np.testing.assert_allclose(p @ p.T, limit, rtol=0, atol=1e-11 * abs(limit).max())
    mass, h = 2700 * 4e-4 * LENGTH, LENGTH / 40
    # At the clamp less than half an element is left, which the modes do not move.
    for motion in range(3):
        left = mass - limit[motion, motion]
        assert 0 < left < mass * h / LENGTH / 2
    assert limit[5, 5] == pytest.approx(mass * LENGTH**2 / 3, rel=1e-4)


ARM = line("arm", [0, 0, 0], [1, 0, 0], 4)
PANEL = line("panel", [1, 0, 0], [1.4, 0.5, 0.1], 3)
HUB = rigid_body("hub", 2.0, [-0.1, 0, 0.02], [0.02, 0.03, 0.025], {"face": [0, 0, 0]})
BODIES = {body.name: body for body in (HUB, ARM, PANEL)}
JOINTS = (joint("weld", "hub.face", "arm.a"), joint("hinge", "arm.b", "panel.a", "ry x"))
SCENE = Scene(tuple(BODIES), (0.0, 100.0), JOINTS)
TURNED = Configuration("turned", {("hinge", 4): 0.8, ("hinge", 0): 0.05})


@pytest.mark.parametrize("locked", [False, True], ids=["hinges free", "hinges locked"])
@pytest.mark.parametrize("ground", [False, True], ids=["afloat", "grounded"])
def test_bodies_have_no_momentum_together_unless_they_stand_on_the_ground(locked, ground):
    subs = substructures(BODIES.values())
    scene = replace(SCENE, ground=(JOINTS[0].second,) if ground else (), joints=JOINTS[1 if ground else 0 :])
    if ground:
        subs.pop("hub")
        scene = replace(scene, bodies=("arm", "panel"))
    angles = Configuration("turned", {("hinge", 4): 0.8}) if locked else TURNED
    system = assemble(subs, hinges_locked(scene) if locked else scene, angles)
    _, Phi = system_modes(system, np.inf)
    placed = place_bodies(subs, scene, angles)
    shapes = np.split(system.T @ Phi, np.cumsum(list(system.sizes.values()))[:-1])
    momentum = {
        name: carried_momentum(shape_momentum(BODIES[name], own), placed[name])
        for name, own in zip(subs, shapes, strict=True)
    }
    residual = momentum_residual(momentum)
    if ground:
        assert residual[:5].min() > 0.1
    else:
        assert residual.max() < 1e-7


def test_hinges_of_a_closed_loop_have_no_inertia_of_their_own():
    subs = substructures(BODIES.values())
    sensors = articulation_sensors(SCENE)
    assert [sensor.name for sensor in sensors] == ["hinge.x", "hinge.ry"]
    system = assemble(subs, replace(SCENE, sensors=sensors), Configuration("as built"))
    assert np.linalg.eigvalsh(articulation_inertia(system))[0] > 0
    twice = replace(system, C1=system.C1[[1, 1]], outputs=("one.ry", "other.ry"))
    with pytest.raises(ConstraintError, match=r"one\.ry, other\.ry are not independent"):
        articulation_inertia(twice)


def test_without_geometry_there_is_no_momentum():
    bare = replace(ARM, nodes=None)
    with pytest.raises(DofMapError, match="no geometry"):
        shape_momentum(bare, np.zeros((bare.n, 1)))
