"""TREETOPS: the data that TREEFLX documents, as text and as HDF5; TREETOPS's own file layout is not public."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import WriteError
from cmsreduce.model import SQUARES, ModalIntegrals
from cmsreduce.write.component import ComponentFile, FlexibleBody, FrameStiffening, flexible_body, frame_stiffening
from cmsreduce.write.files import hdf5_file, put, put_lines, put_texts, put_units, table

__all__ = ["write_treetops", "write_treetops_h5"]

FORMAT = "cmsreduce-treetops"
"""Attribute ``format`` of the HDF5 file."""


def write_treetops(path: Path, component: ComponentFile, integrals: ModalIntegrals) -> None:
    """Write mass properties, modal data, modal integrals and nodal shapes of a body (docs/treetops.md).

    Parameters
    ----------
    path : Path
        Name of the file, which is complete or absent. ``.FLX`` is reserved for the files of TREETOPS itself.
    component : ComponentFile
        The body.
    integrals : ModalIntegrals
        Integrals over its modes, about the body frame.

    Raises
    ------
    WriteError
        If the component file lacks data, the name ends in ``.flx``, or the file cannot be written.
    """
    _refuse_name(path)
    put_lines(path, _lines(flexible_body(component, integrals), frame_stiffening(component, integrals)))


def write_treetops_h5(path: Path, component: ComponentFile, integrals: ModalIntegrals) -> None:
    """Write the same quantities as arrays of an HDF5 file; arguments and errors as `write_treetops`."""
    _refuse_name(path)
    body, stiffening = flexible_body(component, integrals), frame_stiffening(component, integrals)
    titled = [] if stiffening is None else list(_stiffness(stiffening))
    with hdf5_file(path) as file:
        put_units(file.create_group("units"), body.units)
        file.attrs["format"], file.attrs["format_version"] = FORMAT, 1
        file.attrs["name"], file.attrs["lumping"] = body.name, integrals.lumping
        frame, modal, nodes = (file.create_group(name) for name in ("frame", "modal", "nodes"))
        put(frame, "origin", integrals.origin, about="in the basic frame")
        put(frame, "axes", integrals.axes, about="rows, in the basic frame")
        put(file, "mass", integrals.mass, about="int dm")
        put(file, "first_moment", integrals.first_moment, about="int r dm")
        put(file, "inertia", integrals.inertia, about="int (r.r 1 - r r^T) dm about the origin")
        put(modal, "mass", body.mass)
        put(modal, "stiffness", body.stiffness)
        put(modal, "damping", body.damping, about="viscous")
        put(file, "linear_momentum", integrals.phi.T, about="int phi dm, [mode, axis]")
        put(file, "angular_momentum", integrals.r_cross_phi.T, about="int r x phi dm, [mode, axis]")
        derivative = np.moveaxis(integrals.r_phi, 2, 0)
        put(file, "inertia_derivative", derivative, about="int r_i phi_j dm, [mode, i, j]")
        put(file, "second_order", integrals.phi_phi, about="int phi_i phi_j dm, [i, j, mode of i, mode of j]")
        if titled:
            group = file.create_group("geometric_stiffness")
            put_texts(group, "load", [title for title, _ in titled])
            put(group, "K", np.array([K for _, K in titled]), about="[load, mode, mode], per unit of the load")
        put(nodes, "id", body.node)
        put(nodes, "coordinates", body.position, about="from the origin, along the axes of the frame")
        put(nodes, "translation", np.swapaxes(body.translation, 1, 2), about="[node, mode, axis]")
        put(nodes, "slope", np.swapaxes(body.rotation, 1, 2), about="[node, mode, axis]; 0 where it is not known")
        put(nodes, "slope_known", (~np.isin(body.node, body.blind)).astype(np.int8), about="1 where it is known")
        faces = file.create_group("interfaces")
        for name, ids in body.interfaces.items():
            put(faces, name, np.array(ids, dtype=np.int64), about="the nodes a joint attaches to")


def _refuse_name(path: Path) -> None:
    if path.suffix.lower() == ".flx":
        raise WriteError(
            f"{path}: .FLX names TREETOPS's own file, whose layout is not public; this one holds the same quantities "
            "and needs another name, such as .txt or .h5"
        )


def _lines(body: FlexibleBody, stiffening: FrameStiffening | None) -> Iterator[str]:
    integrals, k = body.integrals, body.k
    about = f"mass integrated {integrals.lumping}, units {body.units.name}"
    yield f"$ FLEXIBLE BODY {body.name}: {k} modes, {body.node.size} nodes, {about}"
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
    for title, K in () if stiffening is None else _stiffness(stiffening):
        yield from table(f"GEOMETRIC STIFFNESS {title}", K, "per unit of the load, first mode the row")
    yield from table("NODES", body.node[:, None], "node ids")
    yield from table("COORDINATES", body.position, "from the origin, along the axes of the frame")
    for index, node in enumerate(body.node):
        rows = np.vstack([body.translation[index], body.rotation[index]]).T
        about = "translation x y z and slope x y z, a mode a row"
        yield from table(f"SHAPES {node}", rows, f"{about}{'; slope not known' if node in body.blind else ''}")
    for name, nodes in body.interfaces.items():
        yield f"$ INTERFACE {name}: nodes {' '.join(str(node) for node in nodes)}"
    yield "$ END"


def _stiffness(stiffening: FrameStiffening) -> Iterator[tuple[str, NDArray[np.float64]]]:
    for kind, parts in (("ACCELERATION", stiffening.acceleration), ("ANGULAR ACCELERATION", stiffening.turning)):
        yield from ((f"{kind} {axis}", K) for axis, K in zip("xyz", parts, strict=True))
    yield from ((f"CENTRIFUGAL {axes}", K) for axes, K in zip(SQUARES, stiffening.spinning, strict=True))
    for kind, nodes in (("FORCE", stiffening.force), ("MOMENT", stiffening.moment)):
        for node, parts in nodes.items():
            yield from ((f"{kind} {node} {axis}", K) for axis, K in zip("xyz", parts, strict=True))
