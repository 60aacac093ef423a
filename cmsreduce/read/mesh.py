"""Nodes of meshes of other programs."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path

import numpy as np

from cmsreduce.errors import ReadError
from cmsreduce.model import Nodes
from cmsreduce.read.calculix_abaqus import is_abaqus_input, is_frd, read_abaqus_input, read_frd
from cmsreduce.read.library_errors import LIBRARY_ERRORS
from cmsreduce.read.printed_numbers import printed_rounding

__all__ = ["read_mesh"]

_HEAD = 1 << 16
_SAMPLE = 2000
# Its reader drops GRID coordinate systems and wide cards without a word.
_NASTRAN_SUFFIXES = {".bdf", ".nas", ".fem", ".dat", ".blk", ".pch", ".asm"}


def read_mesh(path: Path) -> Nodes:
    """Read the nodes of a mesh: CalculiX .frd, Abaqus and CalculiX .inp, or any format that meshio knows.

    Parameters
    ----------
    path : Path
        Mesh file. NASTRAN decks are not meshes: they have coordinate systems, see ``read_bulk``.

    Returns
    -------
    Nodes
        Moving along the basic axes. Ids are those of .frd and .inp; meshio keeps none, so there they count from 1 in
        order of the file.

    Raises
    ------
    ReadError
        If the file is missing, damaged or of an unknown format.
    """
    try:
        with path.open("rb") as stream:
            head = stream.read(_HEAD).decode("latin-1")
    except OSError as error:
        raise ReadError(f"{path}: cannot be read: {error.strerror or error}") from error
    if is_frd(head):
        return read_frd(path)
    if is_abaqus_input(head):
        return read_abaqus_input(path)
    if path.suffix.lower() in _NASTRAN_SUFFIXES:
        raise ReadError(f"{path}: neither a NASTRAN deck (no GRID card) nor a mesh")
    return _by_meshio(path)


def _by_meshio(path: Path) -> Nodes:
    """Nodes by meshio, numbered from 1."""
    import meshio

    complaint = io.StringIO()
    try:
        # meshio prints and leaves the program on a file it cannot read.
        with contextlib.redirect_stdout(complaint), contextlib.redirect_stderr(complaint):
            points = np.asarray(meshio.read(path).points)
    except (SystemExit, meshio.ReadError, *LIBRARY_ERRORS) as error:
        said = " ".join(complaint.getvalue().split()) or str(error)
        known = "NASTRAN bulk data, .frd, .inp and the formats of meshio (.msh, .vtu, .vtk, .xdmf, .med and others)"
        raise ReadError(f"{path}: no geometry in a format that is known: {known}. {said}") from error
    if points.ndim != 2 or points.shape[1] > 3:
        raise ReadError(f"{path}: its points have no coordinates x, y, z that could be read; write the mesh again")
    xyz = np.zeros((len(points), 3))
    xyz[:, : points.shape[1]] = points
    spread = xyz[:: max(1, len(xyz) // _SAMPLE)]
    worst = float(printed_rounding(spread).max(initial=0.0))
    if points.dtype == np.float32:
        worst = max(worst, float(np.abs(xyz).max(initial=0.0)) * 2.0**-24)
    return Nodes.in_basic(np.arange(1, len(xyz) + 1), xyz, worst)
