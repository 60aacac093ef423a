"""Mass that is missing, or next to nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from cmsreduce.model import FEModel
from tests.frames import Section
from tests.hard.case import Case
from tests.hard.structures import bars, rigid_motions, rows, twin

__all__ = ["heavy_end", "massless_interface", "massless_rotations", "massless_tip", "tiny_inertia"]

XYZ = [[0, 0, 0], [0.5, 0, 0], [1, 0, 0.1], [1.5, 0.2, 0], [2, 0, 0], [1, 0.6, 0], [1, 1.2, 0.1]]
PAIRS = [(1, 2), (2, 3), (3, 4), (4, 5), (3, 6), (6, 7), (4, 6)]
BAND = (1.0, 60.0)


def _lumped(body: FEModel, weightless: np.ndarray) -> FEModel:
    """The body with its mass in points at the nodes, a little inertia, and none where it is weightless."""
    moves = body.dofs.component <= 3
    mass = np.where(moves, 0.6, 2e-3)
    mass[weightless] = 0.0
    return replace(body, M=sp.diags_array(mass, format="csc"))


def massless_rotations() -> Case:
    """Point masses: no rotation has inertia, inside or on the interface."""
    whole = bars("lumped", XYZ, PAIRS)
    body = _lumped(whole, whole.dofs.component > 3)
    face, rigid = np.concatenate([rows(body, (1, 5, 7), (1, 2, 3))]), rigid_motions(body)
    return Case(
        "rotations without inertia",
        "Point masses: half of M's diagonal is zero.",
        "Massless shapes are condensed statically inside the eigenproblem and never become a large number.",
        body,
        face,
        BAND,
        rigid,
        sensors=rows(body, 6, (1, 2, 3)),
        neighbour=twin(body, face, rigid),
    )


def massless_interface() -> Case:
    """Rotations of the interface nodes without inertia."""
    whole = bars("lumped", XYZ, PAIRS)
    body = _lumped(whole, (whole.dofs.component > 3) & np.isin(whole.dofs.node, (1, 5)))
    face, rigid = rows(body, (1, 5)), rigid_motions(body)
    return Case(
        "interface without inertia",
        "Six interface rotations carry no mass: a hinge there feels flexibility that no mode has.",
        "Static modes keep their flexibility; they follow their load at once.",
        body,
        face,
        BAND,
        rigid,
        sensors=rows(body, 7, (1, 2, 3)),
        neighbour=twin(body, face, rigid),
    )


def massless_tip() -> Case:
    """An interface node that carries no mass at all."""
    whole = bars("lumped", XYZ, PAIRS)
    body = _lumped(whole, whole.dofs.node == 7)
    face, rigid = rows(body, (1, 7)), rigid_motions(body)
    return Case(
        "interface node without mass",
        "All six dofs of an interface node are massless: a spring joins it to the body.",
        "Static modes keep the flexibility of translations and rotations.",
        body,
        face,
        BAND,
        rigid,
        sensors=rows(body, 6, (1, 2, 3)),
        neighbour=twin(body, face, rigid),
    )


def tiny_inertia() -> Case:
    """A gimbal: an inertia of 1e-9 on a soft spring at the interface."""
    whole = bars("gimbal", np.vstack([XYZ, XYZ[4]]), PAIRS)
    a, b = rows(whole, 5), rows(whole, 8)
    E = np.zeros((whole.n, 6))
    E[a, np.arange(6)], E[b, np.arange(6)] = 1.0, -1.0
    hinge = sp.csc_array((E * [1e6, 1e6, 1e6, 40.0, 40.0, 40.0]) @ E.T)
    inertia = np.zeros(whole.n)
    inertia[b] = [1e-6, 1e-6, 1e-6, 1e-9, 1e-9, 1e-9]
    body = replace(whole, K=sp.csc_array(whole.K + hinge), M=sp.csc_array(whole.M + sp.diags_array(inertia)))
    face, rigid = rows(body, (1, 8)), rigid_motions(body)
    return Case(
        "tiny inertia at a gimbal",
        "1e-9 kg m2 on a spring at the interface: a mode far above every cutoff carries most of the flexibility "
        "there and moves every zero below.",
        "Static shapes of the interface hold it: constraint modes and residuals have no cutoff.",
        body,
        face,
        BAND,
        rigid,
        sensors=rows(body, 7, (1, 2, 3)),
        neighbour=twin(body, face, rigid),
    )


def heavy_end() -> Case:
    """A mass of 1e6 kg on bars of ten grams."""
    body = bars("probe", XYZ, PAIRS, Section(A=1e-6, Iy=1e-11, Iz=2e-11, J=3e-11))
    heavy = np.zeros(body.n)
    heavy[rows(body, 1)] = [1e6, 1e6, 1e6, 1e5, 1e5, 1e5]
    body = replace(body, M=sp.csc_array(body.M + sp.diags_array(heavy)))
    face, rigid = rows(body, 1), rigid_motions(body)
    return Case(
        "mass contrast 1e9",
        "A thousand tonnes at the interface, bars of ten grams behind it: elastic modes hardly move the interface.",
        "Modes are made orthonormal twice to rigid modes that weigh 1e9 times as much.",
        body,
        face,
        (0.2, 6.0),
        rigid,
        sensors=rows(body, (5, 7), (1, 2, 3)),
        neighbour=twin(body, face, rigid),
    )
