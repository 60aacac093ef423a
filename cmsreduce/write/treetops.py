"""What TREEFLX documents of a TREETOPS flexible body, as text: its own file layout is not public."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from cmsreduce.errors import WriteError
from cmsreduce.model import ModalIntegrals
from cmsreduce.write.component_file import ComponentFile
from cmsreduce.write.flexible_body import FlexibleBody, flexible_body
from cmsreduce.write.text import put_lines, table

__all__ = ["write_treetops"]


def write_treetops(path: Path, component: ComponentFile, integrals: ModalIntegrals) -> None:
    """Write mass properties, modal data, modal integrals and nodal shapes of a body (docs/treetops.md).

    Parameters
    ----------
    path : Path
        Where; the file is whole or not there. ``.FLX`` is the name of TREETOPS's own files, which this is not.
    component : ComponentFile
        The body.
    integrals : ModalIntegrals
        Over its modes, about the body frame.

    Raises
    ------
    WriteError
        If the component file lacks what is needed, the name ends in ``.flx``, or the file cannot be written.
    """
    if path.suffix.lower() == ".flx":
        raise WriteError(
            f"{path}: .FLX names TREETOPS's own file, whose layout is not public; this text holds the same quantities "
            "and needs another name, such as .txt"
        )
    put_lines(path, _lines(flexible_body(component, integrals)))


def _lines(body: FlexibleBody) -> Iterator[str]:
    integrals, k = body.integrals, body.k
    yield f"$ FLEXIBLE BODY {body.name}: {k} modes, {body.node.size} nodes, mass integrated {integrals.lumping}"
    yield from table("FRAME ORIGIN", integrals.origin[None], "in the basic frame")
    yield from table("FRAME AXES", integrals.axes, "rows, in the basic frame")
    yield from table("MASS", np.array([[integrals.mass]]), "int dm")
    yield from table("FIRST MOMENT", integrals.first_moment[None], "int r dm")
    yield from table("INERTIA", integrals.inertia, "int (r.r 1 - r r^T) dm about the origin")
    yield from table("MODAL MASS", body.mass)
    yield from table("MODAL STIFFNESS", body.stiffness)
    yield from table("MODAL DAMPING", body.damping, "viscous")
    yield from table("LINEAR MOMENTUM", integrals.phi.T, "int phi dm, a mode a row")
    yield from table("ANGULAR MOMENTUM", integrals.r_cross_phi.T, "int r x phi dm, a mode a row")
    for mode in range(k):
        yield from table(
            f"INERTIA DERIVATIVE {mode + 1}", integrals.r_phi[:, :, mode], "int r_i phi_j dm, row i, column j"
        )
    for i in range(3):
        for j in range(3):
            about = f"int phi_{'xyz'[i]} phi_{'xyz'[j]} dm, first mode the row, second the column"
            yield from table(f"SECOND ORDER {'xyz'[i]}{'xyz'[j]}", integrals.phi_phi[i, j], about)
    yield from table("NODES", body.node[:, None], "node ids")
    yield from table("COORDINATES", body.position, "from the origin, along the axes of the frame")
    for index, node in enumerate(body.node):
        rows = np.vstack([body.translation[index], body.rotation[index]]).T
        about = "translation x y z and slope x y z, a mode a row"
        yield from table(f"SHAPES {node}", rows, f"{about}{'; slope not known' if node in body.blind else ''}")
    for name, nodes in body.interfaces:
        yield f"$ INTERFACE {name}: nodes {' '.join(str(node) for node in nodes)}"
    yield "$ END"
