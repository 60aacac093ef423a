"""SID: standard input data of flexible bodies (Wallrapp 1994), as FEMBS and its successors write them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.mechanics import CROSS
from cmsreduce.model import SecondOrder, Units
from cmsreduce.read.files import reading
from cmsreduce.read.printed_numbers import number_of
from cmsreduce.read.reduced.floating_body import FloatingBody
from cmsreduce.read.reduced.modal_body import ModalBody

__all__ = ["read_sid"]

_ENTRY = re.compile(r"(m[01])\(([\d\s,]+)\)")
_SYMMETRIC = 2
# Numbers are printed with twelve digits; those of other writers with fewer lose them in the proof of the row order.
_ROUNDING = 5e-12
# Numbers that must be equal in a file differ by its digits; an order of columns that is not its own, by their size.
_EQUAL = 1e-5
_SECOND_MOMENTS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
_SQUARES = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))
"""Columns of Oe, in another order than the rows of J."""

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
                return number_of(value)
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
        Coordinates: translation and rotation of the frame of reference, then the deforming modes. It has integrals of
        second order if Gr, Ge and Oe determine them, in whatever order their columns are.

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
        ids, xyz, translation, rotation = [], [], [], []
        for node in frame.blocks:
            place, phi, psi = (_term(node.inner(part)) for part in ("origin", "phi", "psi"))
            ids.append(int(node.number("node")))
            xyz.append(place[:, 0])
            translation.append(phi)
            rotation.append(psi)
        if not ids:
            raise ValueError("it has no nodes")
        second_order = _second_order(modal, terms, k)
    inertia = np.zeros((3, 3))
    for value, (a, b) in zip(terms["J"][:, 0], _SECOND_MOMENTS, strict=True):
        inertia[a, b] = inertia[b, a] = value
    body = FloatingBody(
        mass=mass,
        first_moment=terms["mdCM"][:, 0],
        inertia=inertia,
        phi=terms["Ct"].T,
        r_cross_phi=terms["Cr"].T,
        M=terms["Me"],
        K=terms["Ke"],
        D=terms["De"],
        node=np.array(ids),
        xyz=np.array(xyz),
        translation=np.array(translation),
        rotation=np.array(rotation),
        second_order=None if isinstance(second_order, str) else second_order,
        undetermined=second_order if isinstance(second_order, str) else "",
    )
    return body.modal(name, path, units, rounding=_ROUNDING, kind="SID")


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


def _term(block: _Block, of_modes: int | None = None) -> Array:
    """Constant part m0 of a Taylor term (rows, columns), or its derivatives m1 (rows, columns, modes)."""
    rows, columns = int(block.number("nrow")), int(block.number("ncol"))
    found = np.zeros((rows, columns) if of_modes is None else (rows, columns, of_modes))
    structure = int(block.number("structure"))
    for label, value in block.values:
        entry = _ENTRY.fullmatch(label)
        if entry is None or (entry[1] == "m0") != (of_modes is None):
            continue
        at = [int(part) - 1 for part in entry[2].split(",")]
        if of_modes is not None:
            # Row, mode, column.
            found[at[0], at[2], at[1]] = number_of(value)
            continue
        row, column = at
        found[row, column] = number_of(value)
        if structure == _SYMMETRIC:
            found[column, row] = found[row, column]
    return found


def _second_order(modal: _Block, terms: Mapping[str, Array], k: int) -> SecondOrder | str:
    """Integrals of second order; the reason where the file has none, or its terms contradict each other.

    Notes
    -----
    With r the trace of int r_i phi_j dm, column (a, l) of Gr holds 2 (r 1 - int phi r^T dm), whose skew part must be
    Cr. Column (a, l) of Ge is 2 int (phi_l x phi_k)_a dm, which changes its sign with k and l. Programs order these
    columns by axis or by mode, Gr and Ge each in its own way, and the identities say which. The derivatives of Oe with
    the modal coordinates hold the symmetric part of int phi_i phi_j dm, whose trace is the modal mass. Terms of
    geometric stiffness, which some programs add to them, break it.
    """
    named = {block.name: block for block in modal.blocks}
    if not {"Gr", "Ge", "Oe"} <= named.keys():
        return "it has no Gr, Ge and Oe"
    Gr, Ge, growth = _term(named["Gr"]), _term(named["Ge"]), _term(named["Oe"], of_modes=k)
    if Gr.shape != (3, 3 * k) or Ge.shape != (k, 3 * k) or growth.shape != (k, 6, k):
        return f"Gr, Ge and the derivatives of Oe are not 3 x {3 * k}, {k} x {3 * k} and {k} x 6"
    r_phi = [each for block in _blocks(Gr, k) if (each := _with_momentum(block, terms["Cr"].T)) is not None]
    turning = [block / 2 for block in _blocks(Ge, k) if _equal(block, -block.transpose(2, 1, 0))]
    for term, found in (("Gr", r_phi), ("Ge", turning)):
        if not _unique(found):
            return f"the order of the columns of {term}, by axis or by mode, cannot be told from Cr and from each other"
    symmetric = np.zeros((3, 3, k, k))
    for column, (a, b) in enumerate(_SQUARES):
        symmetric[a, b] = symmetric[b, a] = growth[:, column] * (1.0 if a == b else 0.5)
    trace = np.einsum("iiab->ab", symmetric) / -2
    symmetric += np.einsum("ab,ij->ijab", trace, np.eye(3))
    if not _equal(trace, terms["Me"]):
        return "the derivatives of Oe do not have the modal mass in them; they may hold geometric stiffness"
    # Entry (i, j) less entry (j, i) is component m of int phi_k x phi_l dm, and Ge has phi_l x phi_k.
    skew = -np.einsum("mij,amb->ijab", CROSS, turning[0]) / 2
    return SecondOrder(r_phi[0], symmetric + skew)


def _blocks(columns: Array, k: int) -> tuple[Array, Array]:
    """Columns as [row, axis, mode], in the order by axis and in the order by mode."""
    rows = columns.shape[0]
    return columns.reshape(rows, 3, k), np.swapaxes(columns.reshape(rows, k, 3), 1, 2)


def _with_momentum(block: Array, r_cross_phi: Array) -> Array | None:
    """Integrals r_i phi_j (3, 3, k) of a Gr [row, axis, mode], if their skew part is that of Cr."""
    trace = np.einsum("aal->l", block) / 4
    r_phi = np.einsum("l,ab->abl", trace, np.eye(3)) - np.swapaxes(block, 0, 1) / 2
    skew = np.einsum("mij,ijl->ml", CROSS, r_phi)
    scale = max(abs(r_phi).max(initial=0.0), abs(r_cross_phi).max(initial=0.0))
    return r_phi if abs(skew - r_cross_phi).max(initial=0.0) <= _EQUAL * scale else None


def _unique(found: Sequence[Array]) -> bool:
    """True if there is one, or all are the same."""
    return bool(found) and all(_equal(each, found[0]) for each in found)


def _equal(A: Array, B: Array) -> bool:
    return bool(abs(A - B).max(initial=0.0) <= _EQUAL * max(abs(A).max(initial=0.0), abs(B).max(initial=0.0)))


def _check_shapes(terms: Mapping[str, Array], k: int) -> None:
    wanted = {"mdCM": (3, 1), "J": (6, 1), "Ct": (k, 3), "Cr": (k, 3), "Me": (k, k), "Ke": (k, k), "De": (k, k)}
    for part, shape in wanted.items():
        if terms[part].shape != shape:
            raise ValueError(f"'{part}' is {terms[part].shape}, where {shape} fits its {k} modes")
