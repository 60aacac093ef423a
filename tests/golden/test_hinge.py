"""An appendage hinged to a cantilever over a spring and a small inertia, down to none at all (theory section 7)."""

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.assemble import (
    assemble,
    frequency_response,
    modal_substructure,
    physical_substructure,
    rigid_response,
    state_space,
    system_modes,
)
from cmsreduce.linalg.eigen import rigid_body_modes
from cmsreduce.model import (
    Channel,
    Configuration,
    DofTable,
    FEModel,
    Interface,
    Joint,
    JointTerm,
    Nodes,
    Point,
    Scene,
    rigid_body_shapes,
)
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import CraigBampton

EI = {"arm": 79.8359027, "appendage": 3.1934361}
ELEMENTS = {"arm": 10, "appendage": 25}
SPRING = 1.64716497
GAIN = 0.72162435


def beam(name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Bernoulli beam of unit length and mass along x: stiffness, consistent mass, node and component of each row."""
    n = ELEMENTS[name]
    h = 1 / n
    k = np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2]])
    k = EI[name] / h**3 * np.vstack([k, -k[0], [6 * h, 2 * h**2, -6 * h, 4 * h**2]])
    m = np.array([[156, 22 * h, 54, -13 * h], [22 * h, 4 * h**2, 13 * h, -3 * h**2]])
    m = h / 420 * np.vstack([m, [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h**2, -22 * h, 4 * h**2]])
    K, M = np.zeros((2, 2 * n + 2, 2 * n + 2))
    for e in range(n):
        at = slice(2 * e, 2 * e + 4)
        K[at, at] += k
        M[at, at] += m
    return K, M, np.repeat(np.arange(1, n + 2), 2), np.tile([2, 6], n + 1)


def hinge_point(node: int, x: float) -> dict[str, Interface]:
    return {"hinge": Interface("hinge", np.array([node]), ((2, 6),), np.array([[x, 0, 0]]), np.eye(3))}


def arm(J: float) -> FEModel:
    """Clamped; its tip, node 11, turns with the inertia, and node 12 is the end of the beam behind the spring."""
    K, M, node, component = beam("arm")
    n = node.size
    K, M = np.pad(K, (0, 1)), np.pad(M, (0, 1))
    K[np.ix_([n - 1, n], [n - 1, n])] += SPRING * np.array([[1, -1], [-1, 1]])
    M[n, n] = J
    node, component = np.r_[node, 11], np.r_[component, 6]
    node[n - 1] = 12
    free = slice(2, None)
    xyz = np.column_stack([np.r_[np.linspace(0, 1, 11), 1], np.zeros((12, 2))])
    nodes = Nodes.in_basic(np.arange(1, 13), xyz)
    dofs = DofTable(node[free], component[free])
    K, M = sp.csc_array(K[free, free]), sp.csc_array(M[free, free])
    return FEModel("arm", K, M, dofs, nodes, hinge_point(11, 1.0), grounded=True)


def appendage() -> FEModel:
    K, M, node, component = beam("appendage")
    xyz = np.column_stack([1 + np.linspace(0, 1, ELEMENTS["appendage"] + 1), np.zeros((ELEMENTS["appendage"] + 1, 2))])
    nodes = Nodes.in_basic(np.unique(node), xyz)
    dofs = DofTable(node, component)
    return FEModel("appendage", sp.csc_array(K), sp.csc_array(M), dofs, nodes, hinge_point(1, 1.0))


def joined(J: float, form: str):
    """Both bodies, unreduced or in all their modes, and the scene: torque and rotation across the hinge."""
    subs = {}
    for body in (arm(J), appendage()):
        if form == "dofs":
            R = rigid_body_shapes(body.dofs, body.nodes)
            rigid = rigid_body_modes(body.K, body.M, R, body.rounding, body.name)
            subs[body.name] = physical_substructure(body, ["hinge"], rigid)
        else:
            modes = orthogonalise(CraigBampton(1e6).reduce(body, body.interface_rows("hinge")))
            assert modes.static_count == (1 if body.name == "arm" and J == 0 else 0)
            subs[body.name] = modal_substructure(modes, ["hinge"])
    across = (Channel("hinge", (JointTerm("hinge", 5),), "rotation"),)
    joint = Joint("hinge", Point("arm", "hinge"), Point("appendage", "hinge"), frozenset({0, 5}))
    return subs, Scene(tuple(subs), (0.0, 100.0), (joint,), actuators=across, sensors=across)


@pytest.mark.parametrize("form", ["dofs", "modes"])
@pytest.mark.parametrize("J", [0.0, 1e-9, 1e-7, 1e-5])
def test_the_gain_does_not_depend_on_the_inertia(J, form):
    subs, scene = joined(J, form)
    configuration = Configuration("as built")
    w = np.array([1e-2])
    system = assemble(subs, scene, configuration)
    H = frequency_response(subs, scene, configuration, w) - rigid_response(system, w)
    # At 1e-2 rad/s, against a first mode of 19.5 rad/s, dynamics add 3e-8.
    assert H[0, 0, 0].real == pytest.approx(GAIN, abs=5e-8)
    omega, Phi = system_modes(system, 1e9)
    gains = (system.C1 @ Phi).ravel() * (Phi.T @ system.B).ravel() / omega**2
    light = gains[omega > 2 * np.pi * 600]
    if J == 1e-7:
        hertz = omega / (2 * np.pi)
        np.testing.assert_allclose(hertz[:5], [3.1063156, 5.7831223, 14.930097, 26.706590, 33.121161], rtol=1e-7)
        stiff = int(np.argmax(gains))
        assert (hertz[stiff], gains[stiff]) == (pytest.approx(645.85, abs=5e-3), pytest.approx(0.603266, abs=5e-7))
    if J == 0.0:
        # The spring alone is left of the stiff mode; what remains is in modes that move mass.
        assert gains.sum() == pytest.approx(GAIN - 1 / SPRING, abs=1e-7) and light.max() < 0.01
        plant = state_space(system)
        assert plant.D[0, 0] == pytest.approx(1 / SPRING, rel=1e-9)
        np.testing.assert_allclose(plant(1j * 40.0), frequency_response(subs, scene, configuration, np.array([40.0])))
    else:
        assert gains.sum() == pytest.approx(GAIN, abs=1e-8)
