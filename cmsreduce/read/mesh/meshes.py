"""Nodes and elements of a mesh that meshio reads, numbered from 1 in order of the file."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import Nodes
from cmsreduce.read.files import reading
from cmsreduce.read.formats import CELL_CORNERS, Cells, Geometry, GeometryFormat
from cmsreduce.read.labelled_matrix import SINGLE
from cmsreduce.read.printed_numbers import coordinate_rounding

__all__ = ["MESH"]

# meshio's NASTRAN reader drops GRID coordinate systems and wide cards without a message.
_NASTRAN_SUFFIXES = {".bdf", ".nas", ".fem", ".dat", ".blk", ".pch", ".asm"}
_PROGRAM = Path(__file__).with_name("mesh_process.py")
# Of the process: the start, and for each byte of the file. Slow formats are read at a million bytes a second, and a
# number of two printed characters becomes a Python object of 32 bytes in a list. Seconds are those of a processor:
# other work on the machine does not count.
_SECONDS, _SECONDS_A_BYTE = 5.0, 1e-6
_WAITING = 6.0  # on the clock, times those of a processor
_BYTES, _BYTES_A_BYTE = 3 << 29, 60
# Characters of meshio's complaint that are shown.
_LONGEST_REASON = 300

Arrays = dict[str, NDArray[np.generic]]


def _mesh_geometry(path: Path) -> Geometry:
    """Nodes of a mesh, and its sets of nodes."""
    arrays = _arrays(path)
    points = arrays["points"]
    if points.ndim != 2 or not 1 <= points.shape[1] <= 3 or points.dtype.kind not in "fiu":
        raise ReadError(f"{path}: its points have no coordinates x, y, z; write the mesh again")
    xyz = np.zeros((len(points), 3))
    xyz[:, : points.shape[1]] = points
    rounding = coordinate_rounding(xyz)
    if points.dtype == np.float32:
        rounding = max(rounding, float(np.abs(xyz).max(initial=0.0)) * SINGLE)
    named = {str(name): np.asarray(arrays[f"set {k}"], np.int64) + 1 for k, name in enumerate(arrays["names"])}
    if any(ids.min() < 1 or ids.max() > len(xyz) for ids in named.values()):
        raise ReadError(f"{path}: a set names a point that is not there; write the mesh again")
    mesh = Geometry.of_mesh(path, Nodes.in_basic(np.arange(1, len(xyz) + 1), xyz, rounding))
    return replace(mesh, node_sets=named)


def _mesh_cells(path: Path) -> Cells:
    """Elements of a mesh; none if the file is no mesh."""
    try:
        arrays = _arrays(path)
    except ReadError:
        return {}
    nodes = len(arrays["points"])
    found: dict[str, list[NDArray[np.int64]]] = {}
    for name, data in arrays.items():
        kind = next((kind for kind in CELL_CORNERS if name.partition(" ")[2].startswith(kind)), None)
        if kind is None or kind == "vertex" or data.ndim != 2 or data.shape[1] < CELL_CORNERS[kind]:
            continue
        corners = np.asarray(data[:, : CELL_CORNERS[kind]], dtype=np.int64)
        if corners.size and (corners.min() < 0 or corners.max() >= nodes):
            raise ReadError(f"{path}: an element names point {corners.max() + 1} of {nodes}; write the mesh again")
        found.setdefault(kind, []).append(corners + 1)
    return {kind: np.vstack(parts) for kind, parts in found.items()}


def _arrays(path: Path) -> Arrays:
    """Points, cells by number and kind, and named sets, as meshio reads them in a process of its own."""
    if path.suffix.lower() in _NASTRAN_SUFFIXES:
        raise ReadError(f"{path}: neither a NASTRAN deck (no GRID card) nor a mesh")
    size = path.stat().st_size
    seconds = _SECONDS + _SECONDS_A_BYTE * size
    with tempfile.TemporaryDirectory(prefix="cmsreduce-mesh-") as folder:
        arrays = Path(folder) / "arrays.npz"
        # -P keeps the program's own folder out of the import path: its files have names of libraries.
        command = [sys.executable, "-P", str(_PROGRAM), str(path), str(arrays)]
        command += [str(int(_BYTES + _BYTES_A_BYTE * size)), str(int(seconds))]
        try:
            done = subprocess.run(command, capture_output=True, timeout=_WAITING * seconds, check=False)
        except subprocess.TimeoutExpired:
            done = None
        if done is None or done.returncode < 0:
            # A signal ends the process at the limit of its time.
            raise _no_mesh(path, f"Reading it was stopped after {seconds:.0f} s: it is damaged")
        if done.returncode or not arrays.is_file():
            said = " ".join((done.stdout + b" " + done.stderr).decode(errors="replace").split())
            raise _no_mesh(path, said[:_LONGEST_REASON])
        with reading(path, "the mesh"), np.load(arrays, allow_pickle=False) as loaded:
            return {name: loaded[name] for name in loaded.files}


def _no_mesh(path: Path, reason: str) -> ReadError:
    return ReadError(
        f"{path}: no geometry in a format that is known: CalculiX .frd, Abaqus or CalculiX .inp, NASTRAN bulk data or "
        f"external superelement, {MESH.words}. {reason}".rstrip()
    )


MESH = GeometryFormat(
    "mesh", "meshes of meshio (.msh, .vtu, .vtk, .xdmf, .med)", lambda head: True, _mesh_geometry, _mesh_cells
)
"""The format of last resort: every file that no other format takes."""
