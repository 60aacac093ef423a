"""Forces by which the hourglass stiffness of CalculiX's C3D8R resists rigid rotation.

One point in an element leaves twelve motions without strain, hourglasses. CalculiX gives them a stiffness (Flanagan and
Belytschko, Int. J. Numer. Meth. Eng. 17 (1981) 679) along four vectors h_k, from which it takes the linear motion along
z alone: h_k - b_z (z^T h_k), with b the mean slopes of the shape functions. Where opposite faces of an element are not
parallel, these vectors see linear motion along x and y, and so rotation.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import DofTable, Nodes
from cmsreduce.read.calculix_abaqus.decks import blocks, deck_sets, element_nodes
from cmsreduce.read.calculix_abaqus.expansion import expansion_beside
from cmsreduce.read.stated import SOLIDS, integrals, slope_integrals

__all__ = ["hourglass_forces"]

Array = NDArray[np.float64]

_KIND, _CORNERS = "C3D8R", 8
# Start of the name and nodes of elements that may become such solids.
_EXPANDED = {"S4": 4, "B31": 2}
_SECTIONS = ("SOLID SECTION", "SHELL SECTION", "BEAM SECTION")
_CUBE = SOLIDS["C3D8"]
# Gauss points each way, as for the mean slopes of straight edges.
_POINTS = 2


def hourglass_forces(
    path: Path, dofs: DofTable, nodes: Nodes, shapes: Array
) -> tuple[list[Array], NDArray[np.bool_], Mapping[str, int]]:
    """Forces of the hourglass stiffness under some motions, up to the modulus of elasticity of each section.

    Parameters
    ----------
    path : Path
        Input file of CalculiX.
    dofs, nodes : DofTable, Nodes
        Rows of the matrices, and the geometry.
    shapes : (n, m) float64
        Motions of the rows.

    Returns
    -------
    forces : list of (n, m) float64
        One for each section with such elements.
    whole : (n,) bool
        True for rows that have all forces of their elements, and no others: rigid bodies, ties and masses on shells
        leave out rows, whose forces they bring to other nodes.
    count : mapping of str to int
        Number of these elements, by label: shells and beams of one point became C3D8R, too.
    """
    try:
        deck = list(blocks(path))
        sets = deck_sets(deck, {"C3D8": _CORNERS, **_EXPANDED})
        expansion = expansion_beside(path)
    except (ReadError, ValueError):
        return [], np.zeros(len(dofs), dtype=bool), {}
    reduced = {
        number: (_KIND, corners)
        for block in deck
        if block.keyword == "ELEMENT" and block.option("TYPE") == _KIND
        for number, corners in element_nodes(block, _CORNERS)
    }
    for element in expansion.elements if expansion is not None else ():
        if element.solid == _KIND and sets.topology.get(element.number) == element.nodes:
            reduced[element.number] = (element.label.split()[0], element.corners)
    sections = [block.option("ELSET") for block in deck if block.keyword in _SECTIONS]
    groups = [[reduced[one][1] for one in sets.elements.get(name, ()) if one in reduced] for name in sections]
    forces = [_of_section(np.array(group), dofs, nodes, shapes) for group in groups if group]
    beside = () if expansion is None else expansion.nodes.values()
    whole = np.isin(dofs.node, list(_whole([one for _, one in reduced.values()], beside, dofs)))
    return forces, whole, Counter(label for label, _ in reduced.values())


def _whole(elements: Sequence[tuple[int, ...]], beside: Iterable[tuple[int, ...]], dofs: DofTable) -> set[int]:
    """Corners of elements whose corners all have rows, and so have the nodes that stem from one node with them."""
    corners = sorted({node for element in elements for node in element})
    rows = dofs.rows(np.repeat(corners, 3), np.tile([1, 2, 3], len(corners))).reshape(-1, 3)
    free = {node for node, own in zip(corners, rows, strict=True) if (own >= 0).all()}
    bound = {node for group in (*elements, *beside) if not free.issuperset(group) for node in group}
    return free - bound


def _of_section(corners: NDArray[np.int64], dofs: DofTable, nodes: Nodes, shapes: Array) -> Array:
    """Forces of elements (e, 8) of one material (n, m)."""
    x = nodes.xyz[nodes.index(corners.ravel())].reshape(len(corners), _CORNERS, 3)
    volume = integrals(_CUBE, x, _POINTS).volume
    slopes = slope_integrals(_CUBE, x, _POINTS) / volume[:, None, None]
    xi, eta, zeta = _CUBE.places.T
    h = np.stack([eta * zeta, xi * zeta, xi * eta, xi * eta * zeta], axis=1)
    vectors = h - slopes[:, :, 2:] * (x[:, :, 2] @ h)[:, None]
    size = np.square(slopes).sum(axis=(1, 2)) * volume
    rows = np.stack([dofs.rows(node, np.arange(1, 4)) for node in corners.ravel()]).reshape(*corners.shape, 3)
    # Supports have no rows, and no motion.
    motion = np.where((rows >= 0)[..., None], shapes[rows], 0.0)
    force = size[:, None, None, None] * np.einsum("eik,ejk,ejcm->eicm", vectors, vectors, motion)
    found = np.zeros_like(shapes)
    np.add.at(found, rows[rows >= 0], force[rows >= 0])
    return found
