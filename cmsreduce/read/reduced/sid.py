"""SID: standard input data of flexible bodies (Wallrapp 1994), as FEMBS and its successors write them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import DofTable, Nodes, Source, Units, cross_matrix
from cmsreduce.read.files import reading, sha256_of
from cmsreduce.read.reduced.modal_body import ModalBody

__all__ = ["read_sid"]

_ENTRY = re.compile(r"(m[01])\(([\d\s,]+)\)")
_SYMMETRIC, _DIAGONAL = 2, 1
# Numbers are printed with twelve digits; those of other writers with fewer lose them in the proof of the row order.
_ROUNDING = 5e-12
# A smallest eigenvalue of the scaled mass below this is none, but for the twelve digits.
_DEFINITE = 1e-10
_PLANES = ((0, 1, 5), (1, 2, 3), (0, 2, 4))
_SECOND_MOMENTS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))

Array = NDArray[np.float64]


@dataclass
class _Block:
    """A block of the file: its lines ``name = value`` and the blocks in it, in order."""

    name: str
    values: list[tuple[str, str]]
    blocks: list[_Block]

    def inner(self, name: str) -> _Block:
        """The one block of a name."""
        found = [block for block in self.blocks if block.name == name]
        if not found:
            raise ValueError(f"'{self.name}' has no '{name}'")
        return found[0]

    def number(self, name: str) -> float:
        """Value of a line."""
        for label, value in self.values:
            if label == name:
                return _number(value)
        raise ValueError(f"'{self.name}' has no '{name}'")


def read_sid(name: str, path: Path, units: Units) -> ModalBody:
    """Read the linear part of an SID file: masses, stiffness, damping, and shapes at the nodes.

    Parameters
    ----------
    name : str
        Name of the component.
    path : Path
        The file.
    units : Units
        Its unit system, which the file does not state.

    Returns
    -------
    ModalBody
        Coordinates: translation and rotation of the frame of reference, then the deforming modes. The order of the
        columns of Gr and Ge, which differs between programs, does not matter for them.

    Raises
    ------
    ReadError
        If the file is damaged or incomplete.
    """
    with reading(path, "the SID file"):
        # The file of FEMBS is in the letters of its machine; only its remarks need other ones.
        lines = path.read_text(encoding="latin-1").splitlines()
        modal = _parsed(iter(lines[1:])).inner("part").inner("modal")
        head, frame = modal.inner("refmod"), modal.inner("frame")
        mass, k = head.number("mass"), int(head.number("nelastq"))
        terms = {part: _term(modal.inner(part)) for part in ("mdCM", "J", "Ct", "Cr", "Me", "Ke", "De")}
        _check_shapes(terms, k)
        ids, xyz, shapes = [], [], []
        for node in frame.blocks:
            at = int(node.number("node"))
            place, phi, psi = (_term(node.inner(part)) for part in ("origin", "phi", "psi"))
            ids.append(at)
            xyz.append(place[:, 0])
            turn = -cross_matrix(place[:, 0])
            shapes.append(np.block([[np.eye(3), turn, phi], [np.zeros((3, 3)), np.eye(3), psi]]))
        if not ids:
            raise ValueError("it has no nodes")
    dofs = DofTable(np.repeat(np.array(ids), 6), np.tile(np.arange(1, 7, dtype=np.int8), len(ids)))
    every = np.vstack(shapes)
    M = np.zeros((6 + k, 6 + k))
    first = cross_matrix(terms["mdCM"][:, 0])
    M[:3, :3], M[:3, 3:6], M[3:6, :3] = mass * np.eye(3), -first, first
    for value, (a, b) in zip(terms["J"][:, 0], _SECOND_MOMENTS, strict=True):
        M[3 + a, 3 + b] = M[3 + b, 3 + a] = value
    M[6:, :3], M[6:, 3:6], M[6:, 6:] = terms["Ct"], terms["Cr"], terms["Me"]
    M[:6, 6:] = M[6:, :6].T
    K, D = np.zeros_like(M), np.zeros_like(M)
    K[6:, 6:], D[6:, 6:] = terms["Ke"], terms["De"]
    motions = _motions(path, M, every)
    own = np.concatenate([motions, np.arange(6, 6 + k)])
    rows = np.flatnonzero(np.isin(dofs.component - 1, motions))
    square = np.ix_(own, own)
    return ModalBody(
        name=name,
        K=K[square],
        M=M[square],
        D=D[square],
        dofs=dofs[rows],
        shapes=every[np.ix_(rows, own)],
        nodes=Nodes.in_basic(np.array(ids), np.array(xyz)),
        units=units,
        rounding=_ROUNDING,
        sources=(Source(str(path), sha256_of(path), "SID"),),
        unproven="its file names the node of each shape, and nothing in it proves that the shape belongs there",
    )


def _motions(path: Path, M: Array, shapes: Array) -> NDArray[np.int64]:
    """Rigid motions that the mass allows: all six, or the three of a plane body, which has no inertia beside them.

    Raises
    ------
    ReadError
        If no mass has such a first moment and inertia.
    """

    def allows(kept: NDArray[np.int64]) -> bool:
        scale = np.sqrt(np.maximum(M.diagonal()[kept], np.finfo(float).tiny))
        part = M[np.ix_(kept, kept)] / np.outer(scale, scale)
        return bool(np.linalg.eigvalsh(part)[0] > _DEFINITE)

    every = np.arange(6)
    if allows(every):
        return every
    modes = shapes.reshape(-1, 6, shapes.shape[1])[:, :, 6:]
    for kept in (np.array(plane) for plane in _PLANES):
        if allows(kept) and not modes[:, np.setdiff1d(every, kept)].any():
            return kept
    mass, centre = M[0, 0], np.array([M[2, 4], M[0, 5], M[1, 3]]) * -1 / M[0, 0]
    raise ReadError(
        f"{path}: no body has its mass {mass:g}, centre of mass ({centre[0]:g}, {centre[1]:g}, {centre[2]:g}) and "
        f"inertia J at once: the inertia about the centre of mass is not positive. Compare `mdCM` and `J` with the "
        "finite-element program; the order of J is xx yy zz xy xz yz, as entries of the tensor"
    )


def _parsed(lines: Iterator[str], name: str = "file") -> _Block:
    """Blocks of the lines up to ``end NAME``."""
    block = _Block(name, [], [])
    for line in lines:
        label, sign, value = line.partition("=")
        words = label.split()
        if not words:
            continue
        if words[0] == "end":
            if len(words) > 1 and words[1] != name:
                raise ValueError(f"'end {words[1]}' stands where '{name}' ends")
            return block
        if sign and words[0] != "new":
            block.values.append((label.strip(), value.strip()))
            continue
        inner = words[1] if words[0] == "new" and len(words) > 1 else words[0]
        block.blocks.append(_parsed(lines, inner))
        if sign:
            block.blocks[-1].values.append((inner, value.strip()))
    if name != "file":
        raise ValueError(f"the file ends inside '{name}'")
    return block


def _term(block: _Block) -> Array:
    """Constant part m0 of a Taylor term (rows, columns)."""
    found = np.zeros((int(block.number("nrow")), int(block.number("ncol"))))
    structure = int(block.number("structure"))
    for label, value in block.values:
        entry = _ENTRY.fullmatch(label)
        if entry is None or entry[1] != "m0":
            continue
        row, column = (int(part) - 1 for part in entry[2].split(","))
        found[row, column] = _number(value)
        if structure == _SYMMETRIC:
            found[column, row] = found[row, column]
    return found


def _check_shapes(terms: Mapping[str, Array], k: int) -> None:
    wanted = {"mdCM": (3, 1), "J": (6, 1), "Ct": (k, 3), "Cr": (k, 3), "Me": (k, k), "Ke": (k, k), "De": (k, k)}
    for part, shape in wanted.items():
        if terms[part].shape != shape:
            raise ValueError(f"'{part}' is {terms[part].shape}, where {shape} fits its {k} modes")


def _number(text: str) -> float:
    return float(text.split()[0].replace("D", "E").replace("d", "e"))
