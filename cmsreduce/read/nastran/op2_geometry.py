"""Geometry of NASTRAN OUTPUT2 files: nodes and dof sets of a model and its superelements, by pyYeti's readers."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import DofTable, Nodes
from cmsreduce.read.files import reading
from cmsreduce.read.formats import Geometry, GeometryFormat
from cmsreduce.read.labelled_matrix import DOUBLE, SINGLE
from cmsreduce.read.nastran.op2 import check_records
from cmsreduce.read.nastran.op4 import first_record
from cmsreduce.read.nastran.superelements import modal_points

if TYPE_CHECKING:
    import pandas as pd
    from pyyeti.nastran import op2

__all__ = ["OP2_GEOMETRY"]

# Names of 64-bit files are spread over words of eight bytes.
_TABLES = re.compile(r"BGPD( {4})?T")
# Words of pyYeti.
_OF_TWO = "incompatible with EQEXIN"
# Sets that the rows of a matrix may be, the likeliest first, and sets that interfaces may name.
_ROWS, _SETS = ("a", "f", "n", "g"), ("b", "c", "q", "o", "r", "s", "m")
# Relative: places of a node that superelements share are rounded alike, or differ by a conversion of coordinates.
_SAME_PLACE = 1e-5


def _op2_geometry(path: Path) -> Geometry:
    """Nodes and sets of the model, and of every superelement of a file that the DMAP NAS2CAM wrote.

    A set of superelement 101 has the name ``101.a``; the residual structure has plain names. A generalised coordinate
    on a component of a grid becomes a scalar point: 9990001.2 is point 99900012.

    Raises
    ------
    ReadError
        If the file is damaged, has no tables of grids, or has two nodes of one number at different places.
    """
    check_records(path)
    try:
        with reading(path, "the tables of grids of the OP2 file"):
            tables = _tables(path)
    except ReadError as error:
        if _OF_TWO not in str(error):
            raise ReadError(f"{error}; or give the deck as geometry") from error
        raise ReadError(
            f"{path}: its tables of grids (BGPDT) and of their numbers (EQEXIN) do not belong together, as if a run of "
            "the assembly had replaced one of them; give the deck as geometry"
        ) from error
    if not tables:
        raise ReadError(f"{path}: there are no tables BGPDT and EQEXIN in it; give the deck as `geometry:`")
    generalised = _generalised(tables.values())
    rows: dict[str, DofTable] = {}
    sets: dict[str, DofTable] = {}
    for number, table in tables.items():
        members = _members(table, generalised)
        stem = f"{number}." if number else ""
        rows |= {f"{stem}{name}": members[name] for name in _ROWS if name in members}
        sets |= {f"{stem}{name}": members[name] for name in _SETS if name in members}
    first = _members(next(iter(tables.values())), generalised)
    # The boundary of the first superelement is the likeliest interface.
    sets |= {name: first[name] for name in ("b", "q") if name in first and name not in sets}
    return Geometry(path, _nodes(path, tables.values(), generalised), rows, sets, files=(path,))


def _tables(path: Path) -> dict[int, pd.DataFrame]:
    """User set table with coordinates by superelement, upstream ones first."""
    from pyyeti.nastran import op2

    with op2.OP2(str(path)) as file, warnings.catch_warnings():
        # pyYeti warns of superelements without grids of their own.
        warnings.simplefilter("ignore")
        if {"SLIST", "SUPERID"} & {str(block.name) for block in file.dblist}:
            return dict(file.rdn2cop2()["uset"])
        # pyYeti takes every such table for one of the first versions.
        file._rdop2bgpdt68 = partial(_grids, file)
        found = file.rdparampost(get_mats=False, get_dr_tables=False)
    return {0: found["uset"]} if "uset" in found else {}


def _grids(file: op2.OP2) -> NDArray[np.void]:
    """Frame and place of every grid and scalar point of the table BGPDT.

    A line is a frame and a place; of later versions six integers, the second of which counts dofs, and a place of
    double precision.
    """
    record = file.rdop2record("bytes")
    file.goto_next()
    first = np.dtype([("ints", file._intstr), ("xyz", (file._rfrm, 3))])
    newer = np.dtype([("ints", (file._intstr, 6)), ("xyz", (f"{file._endian}f8", 3))])
    if len(record) % newer.itemsize == 0:
        lines = np.frombuffer(record, dtype=newer)
        dofs = lines["ints"][:, 1]
        if dofs.size and dofs[0] == 1 and (np.diff(dofs) > 0).all():
            found = np.empty(lines.size, dtype=[("ints", np.int64), ("xyz", (np.float64, 3))])
            found["ints"], found["xyz"] = lines["ints"][:, 0], lines["xyz"]
            return found
    if len(record) % first.itemsize:
        raise ValueError(f"the table BGPDT has {len(record)} bytes, which are no whole lines")
    return np.frombuffer(record, dtype=first)


def _members(table: pd.DataFrame, generalised: NDArray[np.int64]) -> dict[str, DofTable]:
    """Dofs of every set that is not empty, in the order of the matrices."""
    from pyyeti.nastran import n2p

    node = table.index.get_level_values("id").to_numpy(np.int64)
    every = modal_points(DofTable(node, table.index.get_level_values("dof").to_numpy(np.int8)), generalised)
    found = {"g": np.arange(node.size)}
    # Without the table USET, pyYeti puts every dof in the b-set.
    if table["nasset"].nunique() > 1:
        found |= {name: np.flatnonzero(n2p.mksetpv(table, "g", name)) for name in (*_ROWS, *_SETS)}
    return {name: every[at] for name, at in found.items() if at.size}


def _generalised(tables: Iterable[pd.DataFrame]) -> NDArray[np.int64]:
    """Grids and scalar points whose components are generalised coordinates (q-set) of a superelement.

    They are points of the residual structure as well, where no set tells them from grids that have a place.
    """
    from pyyeti.nastran import n2p

    found = [np.zeros(0, np.int64)]
    for table in tables:
        if table["nasset"].nunique() > 1:
            found.append(table.index.get_level_values("id").to_numpy(np.int64)[n2p.mksetpv(table, "g", "q")])
    return np.unique(np.concatenate(found))


def _nodes(path: Path, tables: Iterable[pd.DataFrame], generalised: NDArray[np.int64]) -> Nodes:
    """Nodes of all superelements, each once, without points of generalised coordinates."""
    from pyyeti.nastran import n2p

    ids, places, frames = [np.zeros(0, np.int64)], [np.zeros((0, 3))], [np.zeros((0, 3, 3))]
    for table in tables:
        node = table.index.get_level_values("id").to_numpy(np.int64)
        grids = np.flatnonzero((table.index.get_level_values("dof") == 1) & ~np.isin(node, generalised))
        ids.append(node[grids])
        places.append(table[["x", "y", "z"]].to_numpy(np.float64)[grids])
        # Translations of a grid along its displacement axes under unit translations of the body.
        moved = np.asarray(n2p.rbgeom_uset(table), dtype=np.float64)
        frames.append(np.stack([moved[grids + axis, :3] for axis in range(3)], axis=1))
    every, at, inverse = np.unique(np.concatenate(ids), return_index=True, return_inverse=True)
    xyz, frame = np.concatenate(places), np.concatenate(frames)
    size = float(abs(xyz).max(initial=0.0))
    apart = np.flatnonzero(abs(xyz - xyz[at][inverse]).max(axis=1, initial=0.0) > _SAME_PLACE * size)
    if apart.size:
        raise ReadError(
            f"{path}: node {np.concatenate(ids)[apart[0]]} has different places in its superelements; give the deck "
            "or the .asm file of the one that is meant as `geometry:`"
        )
    digits = _digits(xyz)
    return Nodes(every, xyz[at], frame[at], digits * size, _digits(frame))


def _digits(values: NDArray[np.float64]) -> float:
    """Rounding of numbers, which files of 32 bits hold in single precision."""
    with np.errstate(over="ignore"):
        single = values.astype(np.float32)
    return SINGLE if np.array_equal(values, single) else DOUBLE


OP2_GEOMETRY = GeometryFormat(
    "op2",
    "NASTRAN OUTPUT2 with the tables BGPDT and EQEXIN",
    lambda head: bool(first_record(head[:16].encode("latin-1", "replace")) & {4, 8}) and bool(_TABLES.search(head)),
    _op2_geometry,
    lambda path: {},
)
