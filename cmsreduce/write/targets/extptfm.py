"""OpenFAST: the superelement of its module ExtPtfm, as releases from 5.0 on read it, and those before (FlexASCII)."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.write.component import ComponentFile
from cmsreduce.write.files import number, put_lines
from cmsreduce.write.targets.joined_nodes import JoinedNodes, one_frame, refuse_joined
from cmsreduce.write.targets.superelement import Superelement, framed_superelement

__all__ = ["EXTPTFM_DIALECTS", "write_extptfm"]

EXTPTFM_DIALECTS = ("openfast-5", "openfast-4")
"""Releases of OpenFAST: 5.0 takes weights and no loads over time, and has no line of size before each matrix."""

Array = NDArray[np.float64]


def write_extptfm(path: Path, component: ComponentFile, dialect: str = EXTPTFM_DIALECTS[0]) -> None:
    """Write the superelement of a support structure: six dofs at the foot of the tower, then fixed-interface modes.

    In SI, along the basic axes, which must be those of OpenFAST: x downwind, z upwards. Loads and weights are zero.

    Parameters
    ----------
    path : Path
        Name of the file, which is complete or absent; ``Red_FileName`` of the module's input file.
    component : ComponentFile
        The body, on its supports.
    dialect : str
        One of ``EXTPTFM_DIALECTS``.

    Raises
    ------
    WriteError
        If the body has not one interface of one node with six dofs, damping is a complex stiffness, or the file cannot
        be written.
    """
    joined = JoinedNodes.of_file(component)
    refuse_joined(component, one_frame(joined))
    body = framed_superelement(component)
    at = int(np.flatnonzero(component.arrays["nodes/id"] == next(iter(joined.components)))[0])
    place = component.arrays["nodes/xyz"][at] * component.units.length
    put_lines(path, _lines(component.name, body, place, old=dialect == "openfast-4"))


def _lines(name: str, body: Superelement, place: Array, *, old: bool) -> Iterator[str]:
    n = body.K.shape[0]
    highest, xyz = body.omega.max(initial=0.0) / (2 * np.pi), " ".join(f"{x:.9g}" for x in place)
    yield f"!Superelement of {name}: interface at {xyz} m, highest frequency with it held {highest:.6g} Hz"
    if old:
        # The reader knows the format by these words.
        yield "!Flex 5 Format, written by cmsreduce"
    yield f"!Dimension: {n}"
    if old:
        # Two rows of loads; the reader holds the last one.
        yield "!Time increment in simulation: 1.0"
        yield "!Total simulation time in file: 1.0"
    damping = np.zeros_like(body.K) if body.D is None else body.D
    matrices = (("Mass", "kg, m", body.M), ("Stiffness", "N, m", body.K), ("Damping", "N, m, s", damping))
    for title, units, matrix in matrices:
        yield ""
        yield f"!{title} Matrix (Units {units})"
        if old:
            yield f"!Dimension: {n}"
        for row in matrix:
            yield " ".join(number(value) for value in row)
    yield ""
    nothing = " ".join(["0.0"] * n)
    if not old:
        yield "!Weight constant (Units N, m)"
        yield nothing
        yield ""
        yield "!Weight stiffness (Units N, m)"
        yield from [nothing] * n
        return
    # Without the column of wave elevations, which the module does not read and its Python readers refuse.
    yield "!Loading (Units N, m)"
    yield f"!Dimension: 1 time column - {n} force columns"
    for time in ("0.0", "1.0"):
        yield f"{time} {nothing}"
