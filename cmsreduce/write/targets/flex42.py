"""42 (NASA): the text files of a flexible body, Flex_*.txt and Nodes_*.txt."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import WriteError
from cmsreduce.model import ModalIntegrals
from cmsreduce.write.component import ComponentFile, FlexibleBody, flexible_body, require_mass
from cmsreduce.write.files import number, put_lines
from cmsreduce.write.targets.joined_nodes import JoinedNodes, single_nodes

__all__ = ["MARK_42", "files_42", "write_42"]

MARK_42 = "  Flexible Body Inputs for 42  ".center(64, "*")
"""First line of the file of the modes."""

_MODE_NODE_AXIS = "[Mode] [Node] [Axis] Value"
_FLEX = "Flex_"
_NAME = 40  # characters: 42 reads a comment into a fixed buffer of 80


def files_42(path: Path) -> tuple[Path, Path]:
    """Files of the modes and of the nodes: ``Nodes_NAME.txt`` beside ``Flex_NAME.txt``, else ``NAME.nodes.txt``."""
    named = path.name.startswith(_FLEX)
    return path, path.with_name(f"Nodes_{path.name.removeprefix(_FLEX)}" if named else f"{path.stem}.nodes.txt")


def write_42(
    path: Path, component: ComponentFile, integrals: ModalIntegrals, joints: Mapping[str, int] | None = None
) -> tuple[Path, Path]:
    """Write the body for 42, and its nodes, without which 42 does not load it.

    42 numbers joints over the whole spacecraft. Without ``joints``, the file numbers the body's interfaces from 0 in
    alphabetical order, one node each, and names them. Analysis nodes are the nodes of the file, numbered from 0 in the
    order of their ids, at their positions from the origin of the integrals. Numbers are in metres, kilograms and
    seconds, as 42 needs them, whatever the units of the component file.

    Parameters
    ----------
    path : Path
        Name of the file, which is complete or absent.
    component : ComponentFile
        The body.
    integrals : ModalIntegrals
        Integrals over its modes, about the body's reference point in 42.
    joints : mapping of interface or node to int, optional
        Number of the spacecraft's joint at each interface, or at each node in digits; others have no joint.

    Returns
    -------
    tuple of Path
        The file of the modes and that of the nodes: ``Nodes_NAME.txt`` beside ``Flex_NAME.txt``, or
        ``NAME.nodes.txt`` beside ``NAME.txt``.

    Raises
    ------
    WriteError
        If the component file lacks data, a mode has no mass or has momentum, an interface has several nodes or is not
        one of the body, or a file cannot be written.
    """
    body = flexible_body(component, integrals).in_si()
    require_mass(body, "42 divides by the modal mass")
    if body.has_momentum:
        raise WriteError(
            f"component '{body.name}': its modes have momentum, which 42 leaves out with REFPT_CM, so that no motion "
            "of the frame excites them, and counts twice with REFPT_JOINT. Write a free body about mean axes: "
            "`cmsreduce convert --for 42`, or `write: {frame: {kind: mean-axis}}`"
        )
    _, nodes = files_42(path)
    put_lines(path, _lines(body, _joints(body, joints)))
    put_lines(nodes, _node_lines(body))
    return path, nodes


def _node_lines(body: FlexibleBody) -> Iterator[str]:
    at = {node: name for name, ids in body.interfaces.items() for node in ids}
    yield "<<<<<<<<<<<<<<<<  Body Node Inputs for 42  >>>>>>>>>>>>>>>>>>>>>"
    yield f"{_word(body.name)} ! Description, units {body.units.name}"
    yield f"{body.node.size} ! Number of Nodes"
    yield "******************* Node Location, Comment *********************"
    for node, place in zip(body.node.tolist(), body.position, strict=True):
        # 42 reads a comment up to the next quotation mark.
        name = f"node {node}" + (f" {at[node]}" if node in at else "")
        yield " ".join(number(value) for value in place) + f' "{_word(name.replace(chr(34), " "))}"'


def _lines(body: FlexibleBody, joints: list[tuple[str, int, int]]) -> Iterator[str]:
    integrals, k = body.integrals, body.k
    yield MARK_42
    yield f"{_word(body.name)} ! Description, units {body.units.name}"
    yield f"{k} ! Number of Flex Modes"
    yield _heading(" Initial Modal States x, u ")
    for mode in range(k):
        yield f"0.0 0.0 ! Mode {mode}, {body.omega[mode] / (2 * np.pi):.6g} Hz"
    every = [(f"node {node}", at, at) for at, node in enumerate(body.node)]
    for title, points in ((" Joint Node Mode Shapes ", joints), (" Analysis Node Mode Shapes ", every)):
        yield _heading(title)
        for kind, shapes in (
            ("Translation Mode Shape (PSI)", body.translation),
            ("Rotation Mode Shape (THETA)", body.rotation),
        ):
            yield _heading(f"  Non-zero {kind} Elements ")
            # [mode, node, axis], modes first as in the sample files of 42.
            yield from _entries(np.transpose(shapes[[at for _, at, _ in points]], (2, 0, 1)), _MODE_NODE_AXIS, points)
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


def _joints(body: FlexibleBody, numbers: Mapping[str, int] | None) -> list[tuple[str, int, int]]:
    """Name of each interface, position of its node among the nodes, and number of its joint."""
    if numbers is None:
        numbers = {name: joint for joint, name in enumerate(body.interfaces)}
    found = []
    for name, joint in numbers.items():
        if name not in body.interfaces and name.isdigit() and int(name) in body.node:
            found.append((f"node {name}", int(np.flatnonzero(body.node == int(name))[0]), joint))
            continue
        if name not in body.interfaces:
            known = ", ".join(body.interfaces) or "none"
            raise WriteError(f"component '{body.name}' has no interface '{name}' for joint {joint} (it has: {known})")
        nodes = body.interfaces[name]
        if reason := single_nodes(JoinedNodes({name: nodes}, {}, {})):
            raise WriteError(f"component '{body.name}': {reason}")
        found.append((name, int(np.flatnonzero(body.node == nodes[0])[0]), joint))
    return found


def _entries(
    values: NDArray[np.float64], comment: str, points: list[tuple[str, int, int]] | None = None
) -> Iterator[str]:
    """Number of nonzero entries, then their indices and values; the second index is the number of a point, if given."""
    places = np.argwhere(values)
    yield f"{len(places)} ! Number of non-zero elements"
    for place in places:
        at, of = list(place), ""
        if points is not None:
            name, _, at[1] = points[place[1]]
            of = f" {_word(name)}"
        yield f"{' '.join(str(index) for index in at)}  {number(values[tuple(place)])} ! {comment}{of}"


def _heading(text: str) -> str:
    return text.center(64, "*")


def _word(text: str) -> str:
    return text[:_NAME] or "-"
