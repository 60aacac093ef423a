"""42 (NASA): the text file of a flexible body, Flex_*.txt."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import WriteError
from cmsreduce.model import ModalIntegrals
from cmsreduce.write.component import ComponentFile, FlexibleBody, flexible_body, require_mass
from cmsreduce.write.files import number, put_lines

__all__ = ["write_42"]

_MODE_NODE_AXIS = "[Mode] [Node] [Axis] Value"
_NAME = 40  # characters: 42 reads a comment into a fixed buffer of 80


def write_42(path: Path, component: ComponentFile, integrals: ModalIntegrals) -> None:
    """Write the body for 42.

    42 numbers joints over the whole spacecraft. The file numbers the body's interfaces from 0 in alphabetical order,
    one node each, and names them. Analysis nodes are the nodes of the file, numbered from 0 in the order of their ids.

    Parameters
    ----------
    path : Path
        Name of the file, which is complete or absent.
    component : ComponentFile
        The body.
    integrals : ModalIntegrals
        Integrals over its modes, about the body's reference point in 42.

    Raises
    ------
    WriteError
        If the component file lacks data, a mode has no mass, an interface has several nodes, or the file cannot be
        written.
    """
    body = flexible_body(component, integrals)
    require_mass(body, "42 divides by the modal mass")
    put_lines(path, _lines(body))


def _lines(body: FlexibleBody) -> Iterator[str]:
    integrals, k = body.integrals, body.k
    joints = _joints(body)
    yield _heading("  Flexible Body Inputs for 42  ")
    yield f"{_word(body.name)} ! Description"
    yield f"{k} ! Number of Flex Modes"
    yield _heading(" Initial Modal States x, u ")
    for mode in range(k):
        yield f"0.0 0.0 ! Mode {mode}, {body.omega[mode] / (2 * np.pi):.6g} Hz"
    for title, rows, names in (
        (" Joint Node Mode Shapes ", [at for _, at in joints], [name for name, _ in joints]),
        (" Analysis Node Mode Shapes ", list(range(body.node.size)), [f"node {node}" for node in body.node]),
    ):
        yield _heading(title)
        for kind, shapes in (
            ("Translation Mode Shape (PSI)", body.translation),
            ("Rotation Mode Shape (THETA)", body.rotation),
        ):
            yield _heading(f"  Non-zero {kind} Elements ")
            # [mode, node, axis], modes first as in the sample files of 42.
            yield from _entries(np.transpose(shapes[rows], (2, 0, 1)), _MODE_NODE_AXIS, names)
    for name, matrix in (("Mass", body.mass), ("Stiffness", body.stiffness), ("Damping", body.damping)):
        yield _heading(f"  Non-zero {name} Matrix Elements ")
        yield from _entries(matrix, "[Row] [Col] Value")
    for name, integral in (
        ("  Linear Momentum Modal Integral, Pf, 3 x Nf  ", integrals.phi),
        ("  Angular Momentum Modal Integral, Hf, 3 x Nf  ", integrals.r_cross_phi),
    ):
        yield _heading(name)
        for mode in range(k):
            yield " ".join(number(value) for value in integral[:, mode]) + f" ! Mode {mode}, [x y z]"
    yield _heading("  Linear Modal Integral, L, 3 x 3 x Nf  ")
    yield from _entries(integrals.r_phi, "[i] [j] [Mode] Value")
    yield _heading("  Angular Modal Integral, N, 3 x 3 x Nf x Nf  ")
    yield from _entries(integrals.phi_phi, "[i] [j] [Mode] [Mode] Value")
    yield "[EOF]"


def _joints(body: FlexibleBody) -> list[tuple[str, int]]:
    """Name of each interface, and position of its node among the nodes."""
    found = []
    for name, nodes in body.interfaces.items():
        if len(nodes) != 1:
            raise WriteError(
                f"component '{body.name}': interface '{name}' has {len(nodes)} nodes, and a joint of 42 has one; tie "
                "them to one node"
            )
        found.append((name, int(np.flatnonzero(body.node == nodes[0])[0])))
    return found


def _entries(values: NDArray[np.float64], comment: str, names: list[str] | None = None) -> Iterator[str]:
    """Number of nonzero entries, then their indices and values."""
    places = np.argwhere(values)
    yield f"{len(places)} ! Number of non-zero elements"
    for place in places:
        of = f" {_word(names[place[1]])}" if names is not None else ""
        yield f"{' '.join(str(index) for index in place)}  {number(values[tuple(place)])} ! {comment}{of}"


def _heading(text: str) -> str:
    return text.center(64, "*")


def _word(text: str) -> str:
    return text[:_NAME] or "-"
