"""Motions without strain other than the usual six, and bodies with fewer dimensions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from cmsreduce.errors import MatrixError
from cmsreduce.model import DofTable, FEModel, Nodes
from tests.frames import Section
from tests.hard.case import METHODS, NOT_HELD, Case, Refusal
from tests.hard.structures import bars, chain, lump, restricted, rigid_motions, rows, tied, twin

__all__ = [
    "bar_along_x",
    "grounded",
    "held_by_mass_alone",
    "hinge_behind_the_interface",
    "hinge_between_interfaces",
    "lone_node",
    "massless_spin",
    "planar_frame",
    "scalar_chain",
]

SLIM = Section(A=2e-4, Iy=4e-9, Iz=6e-9, J=8e-9)


def _hinged() -> tuple[FEModel, np.ndarray]:
    """Two bent bars pinned together about y at node 4, whose second half has a rotation of its own (node 9)."""
    xyz = np.array([[0, 0, 0], [0.3, 0, 0.1], [0.6, 0.1, 0.1], [1, 0, 0], [1.3, 0.1, 0.1], [1.7, 0, 0], [2, 0, 0.2]])
    # Node 8 doubles node 4: same place, tied in all motions but the rotation about y.
    whole = bars("hinged", np.vstack([xyz, xyz[3]]), [(1, 2), (2, 3), (3, 4), (8, 5), (5, 6), (6, 7)], SLIM)
    gone = (whole.dofs.node == 8) & (whole.dofs.component != 5)
    T = np.eye(whole.n)
    T[gone] = T[(whole.dofs.node == 4) & (whole.dofs.component != 5)]
    dofs = DofTable(whole.dofs.node[~gone], whole.dofs.component[~gone])
    body = tied(whole, T[:, ~gone], dofs)
    fold = np.zeros((body.n, 1))
    beyond = np.isin(body.dofs.node, (5, 6, 7, 8))
    arm = body.nodes.xyz[body.nodes.index(body.dofs.node)] - xyz[3]
    fold[beyond & (body.dofs.component == 5)] = 1.0
    fold[beyond & (body.dofs.component == 1), 0] = arm[beyond & (body.dofs.component == 1), 2]
    fold[beyond & (body.dofs.component == 3), 0] = -arm[beyond & (body.dofs.component == 3), 0]
    return body, np.hstack([rigid_motions(body), fold])


def hinge_between_interfaces() -> Case:
    """A mechanism whose two halves are both held."""
    body, rigid = _hinged()
    face = rows(body, (1, 7))
    return Case(
        "hinge between interfaces",
        "Seven motions without strain: six of the body and one about the hinge inside it.",
        "The null space of K gives mechanisms beside the rigid motions of the geometry. All seven have frequency "
        "zero exactly.",
        body,
        face,
        (1.0, 80.0),
        rigid,
        sensors=rows(body, 4, (1, 2, 3)),
        neighbour=twin(body, face, rigid),
    )


def hinge_behind_the_interface() -> Case:
    """The same, with the far half held by nothing."""
    body, rigid = _hinged()
    face = rows(body, 1)
    return Case(
        "hinge behind the interface",
        "The interface holds six of the seven motions: behind it the body still folds.",
        "Sets with constraint modes refuse it; the other sets keep the seventh motion as a rigid mode.",
        body,
        face,
        (1.0, 80.0),
        rigid,
        sensors=rows(body, 7, (1, 2, 3)),
        neighbour=lump(body, face, 2.0),
        refused=NOT_HELD,
    )


def bar_along_x() -> Case:
    """Bars that know only x."""
    whole = bars("bar", np.linspace([0, 0, 0], [12.0, 0, 0], 31), [(k, k + 1) for k in range(1, 31)], SLIM)
    body = restricted(whole, whole.dofs.component == 1)
    face, rigid = rows(body, (1, 31), (1,)), rigid_motions(body)
    return Case(
        "one dimension",
        "Only x: one rigid motion; five columns of the rigid-body shapes are empty.",
        "Geometry proposes six motions. Singular values drop those that the dofs do not show.",
        body,
        face,
        (10.0, 900.0),
        rigid,
        sensors=rows(body, 17, (1,)),
        neighbour=twin(body, face, rigid),
    )


def planar_frame() -> Case:
    """x, z and the rotation about y."""
    xyz = [[0, 0, 0], [0, 0, 1], [0, 0, 2], [1, 0, 2], [2, 0, 2], [2, 0, 1], [2, 0, 0], [3, 0, 2]]
    whole = bars("portal", xyz, [(1, 2), (2, 3), (3, 4), (4, 5), (5, 6), (6, 7), (5, 8)], SLIM)
    body = restricted(whole, np.isin(whole.dofs.component, (1, 3, 5)))
    face, rigid = rows(body, (1, 7), (1, 3, 5)), rigid_motions(body)
    return Case(
        "planar frame",
        "Three dofs a node, three rigid motions.",
        "No code assumes six rigid motions.",
        body,
        face,
        (1.0, 40.0),
        rigid,
        sensors=rows(body, 8, (1, 3)),
        neighbour=twin(body, face, rigid),
    )


def scalar_chain() -> Case:
    """Scalar points without geometry."""
    body = chain("points", 40, k=4e4)
    face, rigid = np.array([0, 39]), np.ones((40, 1))
    return Case(
        "scalar points",
        "No geometry: forty scalar points in a row, free.",
        "The null space of K alone gives the rigid motion.",
        body,
        face,
        (0.5, 12.0),
        rigid,
        sensors=np.array([20]),
        neighbour=twin(body, face, rigid),
    )


def grounded() -> Case:
    """No rigid motion."""
    whole = bars("mast", np.linspace([0, 0, 0], [0, 0, 3], 13), [(k, k + 1) for k in range(1, 13)], SLIM)
    body = replace(restricted(whole, whole.dofs.node > 1), grounded=True)
    face = rows(body, 13)
    return Case(
        "grounded body",
        "No rigid motion to split off; static responses without inertia relief.",
        "r = 0 is a count like any other; residuals come from K^-1 itself.",
        body,
        face,
        (1.0, 60.0),
        np.empty((body.n, 0)),
        sensors=rows(body, 7, (1, 2, 3)),
        neighbour=twin(body, face, np.empty((body.n, 0))),
    )


def lone_node() -> Case:
    """A rigid lump given as matrices: K is zero."""
    M = np.diag([3.0, 3.0, 3.0, 0.2, 0.3, 0.4])
    nodes = Nodes.in_basic([7], [[0.0, 0.0, 0.0]])
    table = DofTable(np.full(6, 7), np.arange(1, 7))
    body = FEModel("lump", sp.csc_array((6, 6)), sp.csc_array(M), table, nodes)
    return Case(
        "stiffness of zero",
        "One node with mass and no stiffness: six rigid modes only.",
        "A body without elastic modes is no error.",
        body,
        np.arange(6),
        (1.0, 10.0),
        np.eye(6),
        neighbour=lump(body, np.arange(6), 1.0),
    )


def massless_spin() -> Case:
    """A straight bar of point masses: nothing resists the spin about its axis, and nothing weighs."""
    whole = bars("rod", np.linspace([0, 0, 0], [1.0, 0, 0], 6), [(k, k + 1) for k in range(1, 6)], SLIM)
    body = replace(whole, M=sp.diags_array(np.where(whole.dofs.component <= 3, 0.3, 0.0), format="csc"))
    says = Refusal(MatrixError, r"a motion that K does not resist carries no mass")
    return Case(
        "spin without inertia",
        "Point masses in a straight line: the spin about the line has neither stiffness nor mass.",
        "Every set refuses it: no equation determines the motion.",
        body,
        rows(body, 1),
        (1.0, 60.0),
        rigid_motions(body),
        refused=dict.fromkeys(METHODS, says),
    )


def held_by_mass_alone() -> Case:
    """Two halves that share mass and no stiffness."""
    one = chain("halves", 12, k=1e4)
    K = sp.block_diag([one.K, one.K], format="csc")
    M = sp.block_diag([one.M, one.M], format="lil")
    M[11, 12] = M[12, 11] = 0.4
    table = DofTable(np.arange(1, 25), np.zeros(24, dtype=int))
    body = FEModel("halves", K, sp.csc_array(M), table)
    face, rigid = np.array([0, 23]), np.kron(np.eye(2), np.ones((12, 1)))
    return Case(
        "coupled by mass alone",
        "Two halves share an entry of M and none of K: two null motions of one body.",
        "Both are rigid modes; M-orthonormality couples them.",
        body,
        face,
        (0.5, 8.0),
        rigid,
        sensors=np.array([11]),
        neighbour=twin(body, face, rigid),
    )
