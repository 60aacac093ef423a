"""Matrices of a NASTRAN external superelement: found among all that its file holds by the family of their names."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.sparse.linalg as spla

from cmsreduce.errors import DampingError, ReadError
from cmsreduce.model import Damping
from cmsreduce.read.interfaces import MatrixSource
from cmsreduce.read.matrix import matrix_names, read_matrix

__all__ = ["SuperelementMatrices", "superelement_damping", "superelement_matrices"]

# Names by medium and program, with the letter of the matrix: KXX and KAA in OP4 and OP2 files, KAAX in punch files,
# MATK in OP2 files of NX.
_FAMILIES = ("{}XX", "{}AA", "{}AAX", "MAT{}")
# A multiple of the stiffness differs from it by the digits of the file.
_MULTIPLE = 1e-6


@dataclass(frozen=True)
class SuperelementMatrices:
    """Matrices of a superelement.

    Parameters
    ----------
    stiffness, mass : MatrixSource
        File and name.
    damping, structural : MatrixSource, optional
        Viscous damping (BXX), and the imaginary part of the stiffness by the loss factors of materials and elements
        (K4XX); None where the program wrote a place holder.
    """

    stiffness: MatrixSource
    mass: MatrixSource
    damping: MatrixSource | None = None
    structural: MatrixSource | None = None


def superelement_matrices(path: Path) -> SuperelementMatrices:
    """Find the matrices of a superelement in the file that EXTSEOUT wrote them to.

    Parameters
    ----------
    path : Path
        OUTPUT4, OUTPUT2 or punch file.

    Raises
    ------
    ReadError
        If the file cannot be read, or no stiffness and mass are named alike in it.
    """
    # A matrix that a superelement does not have is a place holder of one row.
    found = {info.name.upper(): info for info in matrix_names(path) if info.rows == info.cols > 1}
    ends = [f"{{}}{name[1:]}" for name in found if name.startswith("K") and f"M{name[1:]}" in found]
    known = [each for each in _FAMILIES if {each.format("K"), each.format("M")} <= found.keys()]
    family = known[0] if known else ends[0] if len(ends) == 1 else None
    if family is None:
        held = ", ".join(found) or "none"
        raise ReadError(
            f"{path}: holds no stiffness and mass of a superelement, such as KXX and MXX or KAA and MAA; its square "
            f"matrices: {held}. Name both by `stiffness:` and `mass:`, beside `extseout:`"
        )

    def source(letter: str) -> MatrixSource | None:
        # Programs add the number of the load case to the names of damping matrices.
        names = (family.format(letter), f"{family.format(letter)}1")
        return next((MatrixSource(path, found[name].name) for name in names if name in found), None)

    stiffness, mass = source("K"), source("M")
    assert stiffness is not None and mass is not None
    return SuperelementMatrices(stiffness, mass, source("B"), source("K4"))


def superelement_damping(body: str, found: SuperelementMatrices) -> tuple[Damping | None, MatrixSource | None]:
    """Damping that a superelement comes with.

    Parameters
    ----------
    body : str
        Name of the body, for messages.
    found : SuperelementMatrices
        Its matrices.

    Returns
    -------
    law : Damping, optional
        Loss factor, if the imaginary stiffness is a multiple of the stiffness.
    matrix : MatrixSource, optional
        Viscous damping matrix.

    Raises
    ------
    DampingError
        If the imaginary stiffness is no multiple of the stiffness, or there is viscous damping beside it.
    """
    viscous, imaginary = (
        source if source is not None and read_matrix(source.path, source.matrix).A.nnz else None
        for source in (found.damping, found.structural)
    )
    if imaginary is None:
        return None, viscous
    choice = "Choose the damping of the body by `damping:`, such as `damping: {modal: 0.01}`"
    if viscous is not None:
        raise DampingError(
            f"body '{body}': {imaginary.path} holds viscous damping {viscous.matrix} and structural damping "
            f"{imaginary.matrix}, and a body has one of them. {choice}"
        )
    K, K4 = (read_matrix(each.path, each.matrix) for each in (found.stiffness, imaginary))
    A = K4.A if K.dofs is None or K4.dofs is None else K4.on(K.dofs).A
    factor = float((A * K.A).sum() / (K.A * K.A).sum())
    if factor <= 0 or spla.norm(A - factor * K.A) > _MULTIPLE * spla.norm(A):
        raise DampingError(
            f"body '{body}': its structural damping {imaginary.matrix} of {imaginary.path} is no multiple of its "
            f"stiffness (nearest: {factor:.3g} times), as one loss factor would make it. {choice}"
        )
    # One loss factor was printed with a few digits; the least squares have round-off.
    return Damping(structural=float(np.round(factor, 12))), None
