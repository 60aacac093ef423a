"""Radioss: stiffness and mass of a flexible body's interface nodes, as its option /FXBODY reads them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from cmsreduce.errors import WriteError
from cmsreduce.write.component import ComponentFile
from cmsreduce.write.files import put_lines
from cmsreduce.write.targets.nastran import entries
from cmsreduce.write.targets.superelement import Superelement, framed_superelement

__all__ = ["left_out", "write_radioss"]

_SIX = 6


def write_radioss(path: Path, component: ComponentFile) -> None:
    """Write the matrices KAAX and MAAX of the interface nodes, condensed statically, as DMIG cards in SI.

    Rows are along the basic axes. Radioss makes one static mode for each of these dofs and knows no others.

    Parameters
    ----------
    path : Path
        Name of the file, which is complete or absent; ``Filename`` of /FXBODY, which must end in ``pch``.
    component : ComponentFile
        The body.

    Raises
    ------
    WriteError
        If an interface node has fewer than six dofs, the interface cannot strain the body, damping is a complex
        stiffness, or the file cannot be written.
    """
    body = framed_superelement(component)
    i = len(body.interface)
    if i <= component.rigid_count:
        raise WriteError(
            f"component '{component.name}': its {i // _SIX} interface node moves it rigidly, and Radioss makes modes "
            "of interface nodes alone; give the body a second interface, at a node that shows how it bends"
        )
    put_lines(path, _lines(component, body))


def left_out(component: ComponentFile) -> str:
    """Modes that the file has no place for, in words."""
    omega = framed_superelement(component).omega
    modes = ""
    if omega.size:
        lowest = f"the lowest at {omega.min() / (2 * np.pi):.6g} Hz"
        modes = f"inertia of {omega.size} modes with the interfaces held, {lowest}, and the "
    return f"{component.name}: the file has the mass of the interface's static shapes; it leaves out the {modes}damping"


def _lines(component: ComponentFile, body: Superelement) -> Iterator[str]:
    i = len(body.interface)
    labels = [*zip(body.interface.node.tolist(), body.interface.component.tolist(), strict=True)]
    yield f"$ Flexible body {component.name} for /FXBODY of Radioss: kg, m, s, along the basic axes"
    yield "$ node_IDm of the card is a node of its own, without elements; these nodes are in the model at:"
    length = float(component.attributes["units"]["length_in_si"])
    for node in body.interface.node[::_SIX]:
        place = component.arrays["nodes/xyz"][component.arrays["nodes/id"] == node][0] * length
        yield f"$ {node:10d}" + "".join(f"{x:20.13g}" for x in place)
    yield f"$ {left_out(component)}"
    yield from entries({"KAAX": body.K[:i, :i], "MAAX": body.M[:i, :i]}, labels)
