"""Radioss: stiffness and mass of a flexible body's interface nodes, as its option /FXBODY reads them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from cmsreduce.errors import WriteError
from cmsreduce.write.component import ComponentFile, refuse_long_ids
from cmsreduce.write.files import put_lines
from cmsreduce.write.targets.joined_nodes import JoinedNodes, refuse_joined, three_frames
from cmsreduce.write.targets.nastran import entries
from cmsreduce.write.targets.superelement import Superelement, framed_superelement

__all__ = ["left_out", "write_radioss"]

_SIX = 6


def write_radioss(path: Path, component: ComponentFile) -> None:
    """Write the matrices KAAX and MAAX of the interface nodes, condensed statically, as DMIG cards in SI.

    Rows are along the basic axes. Radioss makes one static mode for each of these dofs and knows no others. It takes
    every such body for a free one, whose turns it finds from three nodes.

    Parameters
    ----------
    path : Path
        Name of the file, which is complete or absent; ``Filename`` of /FXBODY, which must end in ``pch``.
    component : ComponentFile
        The body.

    Raises
    ------
    WriteError
        If the body is not free in all six directions, an interface node has fewer than six dofs, the interface has not
        three nodes that are out of line, a node's number has more than 31 bits, damping is a complex stiffness, or the
        file cannot be written.
    """
    # Radioss projects what holds the body away, with the rigid motions (IBLO = 0 for any .pch file).
    if component.rigid_count != _SIX:
        raise WriteError(
            f"component '{component.name}': Radioss reads a .pch file as a free body, and this one has "
            f"{component.rigid_count} of the six motions without strain, so that its supports would be lost; reduce it "
            "without supports, and hold its interface nodes in the model (/BCS)"
        )
    refuse_joined(component, three_frames(JoinedNodes.of_file(component)))
    body = framed_superelement(component)
    refuse_long_ids(component, body.interface.node, "Radioss")
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
    length = component.units.length
    for node in body.interface.node[::_SIX]:
        place = component.arrays["nodes/xyz"][component.arrays["nodes/id"] == node][0] * length
        yield f"$ {node:10d}" + "".join(f"{x:20.13g}" for x in place)
    yield f"$ {left_out(component)}"
    yield from entries({"KAAX": body.K[:i, :i], "MAAX": body.M[:i, :i]}, labels)
