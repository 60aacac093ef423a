"""What the interface holds: just enough, too much, too little, nothing, everything."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import FEModel, InterfaceLoading
from tests.frames import Section
from tests.hard.case import NOT_HELD, Case
from tests.hard.structures import bars, lump, rigid_motions, rows, strut, twin

__all__ = ["determinate", "everything", "indeterminate", "nothing", "one_pin", "redundant"]

XYZ = [[0, 0, 0], [1, 0, 0], [1, 1, 0.2], [0, 1, 0], [0.4, 0.5, 0.8], [0.5, 0.5, 1.6], [1.4, 0.6, 1.9], [0.5, 1.5, 1.2]]
PAIRS = [(1, 2), (2, 3), (3, 4), (4, 1), (1, 5), (2, 5), (3, 5), (5, 6), (6, 7), (4, 8), (6, 8)]
BAND = (1.0, 60.0)


def _tower() -> tuple[FEModel, NDArray[np.float64]]:
    body = bars("tower", XYZ, PAIRS)
    return body, rigid_motions(body)


def determinate() -> Case:
    """Six dofs over three nodes, none of which could do alone."""
    body, rigid = _tower()
    face = np.concatenate([rows(body, 1, (1, 2, 3)), rows(body, 2, (2, 3)), rows(body, 4, (3,))])
    return Case(
        "determinate interface",
        "Six dofs on three nodes (3-2-1) hold the body without strain: the interface stiffness is zero, and a "
        "neighbour loads it with mass alone.",
        "Rigid motion is removed from the reduced stiffness by name, so its rounding acts as no spring.",
        body,
        face,
        BAND,
        rigid,
        sensors=rows(body, 7, (1, 2, 3)),
        neighbour=twin(body, face, rigid),
    )


def indeterminate() -> Case:
    """Two nodes with six dofs each."""
    body, rigid = _tower()
    face = rows(body, (1, 3))
    return Case(
        "indeterminate interface",
        "Twelve dofs on two nodes: the neighbour adds stiffness, and loaded modes must have it.",
        "Constraint modes and residuals hold it exactly; Benfield-Hruda loads K and M.",
        body,
        face,
        BAND,
        rigid,
        sensors=rows(body, 7, (1, 2, 3)),
        neighbour=twin(body, face, rigid),
    )


def redundant() -> Case:
    """A flange of six nodes on a ring a thousand times as stiff as what it carries."""
    a = np.pi / 3 * np.arange(6)
    ring = 0.3 * np.column_stack([np.cos(a), np.sin(a), 0 * a])
    xyz = np.vstack([ring, [0, 0, 0.2], [0, 0, 0.9], [0.4, 0, 1.5]])
    around, up = [(k + 1, (k + 1) % 6 + 1) for k in range(6)], [(k, 7) for k in range(1, 7)]
    sections = [Section(A=0.4, Iy=1e-4, Iz=1e-4, J=1e-4)] * 6 + [Section()] * 8
    body = bars("flanged", xyz, around + up + [(7, 8), (8, 9)], sections)
    face, rigid = rows(body, range(1, 7)), rigid_motions(body)
    return Case(
        "redundant interface",
        "Thirty-six dofs on a flange that is nearly rigid: its constraint modes and residuals are nearly dependent.",
        "Residuals are made orthonormal in K, largest contribution first. A residual without contribution is left out.",
        body,
        face,
        (1.0, 120.0),
        rigid,
        sensors=rows(body, 9, (1, 2, 3)),
        neighbour=twin(body, face, rigid),
    )


def one_pin() -> Case:
    """Three translations of one node."""
    body, rigid = _tower()
    face = rows(body, 6, (1, 2, 3))
    return Case(
        "translations of one node",
        "A ball joint: the body turns about it, so there are no constraint modes.",
        "Craig-Bampton and Guyan refuse it by name; free and loaded modes need nothing of the interface.",
        body,
        face,
        BAND,
        rigid,
        sensors=rows(body, 7, (1, 2, 3)),
        neighbour=lump(body, face, 3.0),
        refused=NOT_HELD,
    )


def nothing() -> Case:
    """No interface; a strut inside, sensors outside."""
    body, rigid = _tower()
    return Case(
        "no interface",
        "A free body with a strut inside: no interface holds it, and no neighbour loads it.",
        "Every set takes rigid and free modes, and the residual response to the strut.",
        body,
        np.empty(0, dtype=np.int64),
        BAND,
        rigid,
        loads=strut(body, 5, 8),
        sensors=rows(body, (7, 8), (1, 2, 3)),
    )


def everything() -> Case:
    """Every dof is an interface dof."""
    body, rigid = _tower()
    face = np.arange(body.n)
    return Case(
        "all dofs interface",
        "There is no interior: no fixed-interface modes, and a residual for every dof beside the free modes.",
        "Static condensation without interior is the body itself, exactly. Dependent residuals are left out.",
        body,
        face,
        BAND,
        rigid,
        neighbour=InterfaceLoading(body.K.toarray(), body.M.toarray(), ("twin",)),
        limits={"craig-bampton": 1e-8, "macneal-rubin": 1e-8, "guyan": 1e-8},
    )
