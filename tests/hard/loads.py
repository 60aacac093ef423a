"""Loads and sensors that leave little to go by, and no damping."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import FEModel
from tests.hard.case import Case
from tests.hard.structures import bars, rigid_motions, rows, strut, twin

__all__ = ["loads_1e9_apart", "loads_twice", "no_damping", "no_outputs"]

XYZ = [[0, 0, 0], [1, 0, 0], [2, 0, 0.2], [2.4, 0.8, 0], [1.2, 1, 0.3], [0, 1.2, 0], [0.6, 0.5, 0.9], [1.6, 0.5, 1.1]]
PAIRS = [(1, 2), (2, 3), (3, 4), (4, 5), (5, 6), (6, 1), (2, 7), (7, 8), (5, 7), (3, 8)]
BAND = (1.0, 60.0)


def _frame() -> tuple[FEModel, NDArray[np.int64], NDArray[np.float64]]:
    body = bars("frame", XYZ, PAIRS)
    return body, rows(body, (1, 6)), rigid_motions(body)


def loads_1e9_apart() -> Case:
    """Two struts whose forces differ in the ninth digit."""
    body, face, rigid = _frame()
    one, other = strut(body, 4, 7), strut(body, 3, 5)
    return Case(
        "nearly dependent loads",
        "Two loads that differ by 1e-9: their residual shapes differ as little, and their Gram matrix is singular.",
        "A residual is kept for the strain energy that it adds. 1e-18 of the other's is nothing, and is left out.",
        body,
        face,
        BAND,
        rigid,
        loads=np.hstack([one, one + 1e-9 * other]),
        sensors=rows(body, 8, (1, 2, 3)),
        neighbour=twin(body, face, rigid),
    )


def loads_twice() -> Case:
    """The same strut three times, and one between interface nodes."""
    body, face, rigid = _frame()
    return Case(
        "duplicated loads",
        "One strut given three times, once with its ends exchanged, and one whose ends are interface nodes, which "
        "constraint modes and residuals hold already.",
        "A load that adds no strain energy is left out.",
        body,
        face,
        BAND,
        rigid,
        loads=np.hstack([strut(body, 4, 7), strut(body, 7, 4), strut(body, 1, 6), 5 * strut(body, 4, 7)]),
        sensors=rows(body, 8, (1, 2, 3)),
        neighbour=twin(body, face, rigid),
    )


def no_outputs() -> Case:
    """Actuators and nothing measured."""
    body, face, rigid = _frame()
    return Case(
        "inputs and no outputs",
        "Forces act and nothing is measured: every response is empty and every coefficient zero.",
        "The basis needs no outputs; empty responses have no error.",
        body,
        face,
        BAND,
        rigid,
        loads=strut(body, 4, 7),
        measured=False,
        neighbour=twin(body, face, rigid),
    )


def no_damping() -> Case:
    """Undamped."""
    body, face, rigid = _frame()
    return Case(
        "no damping",
        "Peaks are infinite, so no error over the band exists.",
        "Compared midway between resonances, where an undamped response is finite.",
        body,
        face,
        BAND,
        rigid,
        sensors=rows(body, 8, (1, 2, 3)),
        neighbour=twin(body, face, rigid),
        loss=0.0,
        limits={"craig-bampton": 0.05},
    )
