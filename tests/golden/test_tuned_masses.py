"""Clamped-free beam with two tuned masses: three components, a cluster of three modes (theory section 9)."""

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.assemble import assemble, modal_substructure, physical_substructure, system_modes
from cmsreduce.linalg.eigen import rigid_body_modes
from cmsreduce.model import Configuration, DofTable, FEModel, Interface, Joint, Nodes, Point, Scene
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import CraigBampton

HERTZ = [3.486, 17.675, 22.372, 29.338, 68.342, 133.02, 219.27, 327.45, 457.18]
LENGTH, EI, RHO_A = 1.0, 48.38, 1.02
MASS, SPRING = 0.0492, 858.0
ELEMENTS = 60


def face(name: str, node: int, x: float) -> Interface:
    return Interface(name, np.array([node]), ((2,),), np.array([[x, 0.0, 0.0]]), np.eye(3))


def beam() -> FEModel:
    h = LENGTH / ELEMENTS
    k = EI / h**3 * np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2]])
    k = np.vstack([k, [-12 * EI / h**3, -6 * EI / h**2, 12 * EI / h**3, -6 * EI / h**2]])
    k = np.vstack([k, EI / h**3 * np.array([6 * h, 2 * h**2, -6 * h, 4 * h**2])])
    m = (
        RHO_A
        * h
        / 420
        * np.array(
            [
                [156, 22 * h, 54, -13 * h],
                [22 * h, 4 * h**2, 13 * h, -3 * h**2],
                [54, 13 * h, 156, -22 * h],
                [-13 * h, -3 * h**2, -22 * h, 4 * h**2],
            ]
        )
    )
    n = 2 * (ELEMENTS + 1)
    K, M = np.zeros((n, n)), np.zeros((n, n))
    for e in range(ELEMENTS):
        at = slice(2 * e, 2 * e + 4)
        K[at, at] += k
        M[at, at] += m
    node = np.repeat(np.arange(1, ELEMENTS + 2), 2)
    component = np.tile([2, 6], ELEMENTS + 1)
    xyz = np.column_stack([np.linspace(0, LENGTH, ELEMENTS + 1), np.zeros((ELEMENTS + 1, 2))])
    clamped = slice(2, None)
    middle = ELEMENTS // 2 + 1
    return FEModel(
        "beam",
        sp.csc_array(K[clamped, clamped]),
        sp.csc_array(M[clamped, clamped]),
        DofTable(node[clamped], component[clamped]),
        Nodes.in_basic(np.arange(1, ELEMENTS + 2), xyz),
        {"middle": face("middle", middle, LENGTH / 2), "tip": face("tip", ELEMENTS + 1, LENGTH)},
        grounded=True,
    )


def absorber(name: str, x: float) -> FEModel:
    K = sp.csc_array(SPRING * np.array([[1.0, -1.0], [-1.0, 1.0]]))
    nodes = Nodes.in_basic([1, 2], [[x, 0, 0], [x, 0, 0]])
    return FEModel(
        name, K, sp.csc_array(np.diag([0.0, MASS])), DofTable(np.array([1, 2]), np.array([2, 2])), nodes,
        {"foot": face("foot", 1, x)},
    )  # fmt: skip


@pytest.mark.parametrize("reduced", [(), ("beam",), ("beam", "inner", "outer")], ids=["unreduced", "beam", "all"])
def test_the_cluster_of_three_comes_back(reduced):
    bodies = {body.name: body for body in (beam(), absorber("inner", LENGTH / 2), absorber("outer", LENGTH))}
    joints = tuple(
        Joint(f"to {at}", Point("beam", at), Point(name, "foot"))
        for at, name in (("middle", "inner"), ("tip", "outer"))
    )
    scene = Scene(tuple(bodies), (0.0, 500.0), joints)
    subs = {}
    for name, body in bodies.items():
        if name in reduced:
            rows = np.concatenate([body.interface_rows(f) for f in body.interfaces])
            subs[name] = modal_substructure(orthogonalise(CraigBampton(20000.0).reduce(body, rows)), body.interfaces)
        else:
            R = rigid_body_modes(body.K, body.M, None, body.rounding, name)
            assert R.shape[1] == (0 if name == "beam" else 1)
            subs[name] = physical_substructure(body, body.interfaces, R)
    w, _ = system_modes(assemble(subs, scene, Configuration("as built")), 2 * np.pi * 500)
    # Half of the last printed digit; the golden has the error of fewer elements in its upper modes.
    np.testing.assert_allclose(w / (2 * np.pi), HERTZ, atol=5e-4, rtol=5e-5)


def test_a_foot_without_mass_is_a_static_mode():
    body = absorber("inner", 0.5)
    modes = orthogonalise(CraigBampton(2000.0).reduce(body, body.interface_rows("foot")))
    assert (modes.rigid_count, modes.elastic_count, modes.static_count) == (1, 0, 1)
    # The spring shortens by f / k and the mass stays.
    np.testing.assert_allclose(modes.Phi[:, 1] * modes.Phi[0, 1], [1 / SPRING, 0], atol=1e-18)
