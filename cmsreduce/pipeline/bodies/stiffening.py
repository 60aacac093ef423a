"""Geometric stiffness of a body: read or computed as its keys say, in the rows of the body."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.config import GeometricStiffnessKeys, Pipeline, place_in
from cmsreduce.errors import SceneError
from cmsreduce.mechanics import bars_stiffness, condensed_dofs, end_dofs, hidden_motion
from cmsreduce.model import (
    Bars,
    FEModel,
    GeometricStiffness,
    Recovery,
    UnitLoad,
    load_stiffness_in_units,
    recovery_in_units,
)
from cmsreduce.read import (
    MatrixSource,
    bars_in_units,
    deck_statement,
    read_bars,
    read_differential_stiffness,
    read_followers,
    read_members,
    sha256_of,
)

__all__ = ["body_stiffening", "row_motions"]


def body_stiffening(
    pipeline: Pipeline, body: FEModel, as_read: FEModel, rigid: NDArray[np.float64]
) -> tuple[GeometricStiffness | None, tuple[str, ...]]:
    """Geometric stiffness of a body, and remarks on facts that could not be proven.

    Parameters
    ----------
    pipeline : Pipeline
        The pipeline.
    body : FEModel
        n dofs, in the scene's units, with its ties, and with undetermined motions held.
    as_read : FEModel
        The body as its files have it.
    rigid : (n, r) float64
        Its rigid-body modes.

    Raises
    ------
    CmsReduceError
        If a matrix is not in its file, or does not fit the body.
    """
    keys = pipeline.components[body.name].geometric_stiffness
    if keys is None:
        return None, ()
    given, remarks = _given(keys, body, as_read)
    computed = _computed(pipeline, keys, body, as_read, rigid)
    if computed is not None:
        given = replace(
            given,
            loads=given.loads + computed.loads,
            matrices=given.matrices + computed.matrices,
            sources=given.sources + computed.sources,
            held=computed.held,
        )
    return given, tuple(remark for remark in remarks if remark)


def _given(keys: GeometricStiffnessKeys, body: FEModel, as_read: FEModel) -> tuple[GeometricStiffness, list[str]]:
    """The user's matrices in the units and rows of the body."""
    T = row_motions(body, as_read)
    loads, matrices, sources, remarks = [], [], [], []
    for item in keys.matrices.values():
        load = UnitLoad.parse(item.load)
        A, remark = read_differential_stiffness(MatrixSource(item.file, item.matrix, item.format), as_read, load.label)
        restated = load_stiffness_in_units(A, as_read.dofs, load, as_read.units, body.units)
        loads.append(_at_node(body, load))
        matrices.append(sp.csc_array(T.T @ restated @ T))
        words = [item.file.name, *([item.matrix] if item.matrix else []), "sha256", sha256_of(item.file)]
        sources.append(" ".join(words))
        remarks.append(remark)
    origin = place_in(keys.origin, as_read.units) * (as_read.units.length / body.units.length)
    return GeometricStiffness(tuple(loads), tuple(matrices), tuple(sources), origin, "as in the user's files"), remarks


def row_motions(body: FEModel, as_read: FEModel) -> sp.csr_array:
    """Motion of the rows of the files (rows read, n) per motion of the body's rows; held dofs stand still."""
    rows = body.recovery.dofs.rows(as_read.dofs.node, as_read.dofs.component)
    kept = np.flatnonzero(rows >= 0)
    pick = sp.csr_array((np.ones(kept.size), (kept, rows[kept])), shape=(as_read.n, len(body.recovery.dofs)))
    return sp.csr_array(pick @ body.recovery.T)


def _hidden(path: Path, body: FEModel, as_read: FEModel, bars: Bars) -> Recovery | None:
    """Motion of dofs of the bars that rigid elements of the deck move, and of condensed dofs."""
    if as_read.nodes is None:
        return None
    followers = read_followers(path, as_read.nodes)
    condensed = len(condensed_dofs(as_read, followers, end_dofs(bars)))
    found = hidden_motion(as_read, followers, read_members(path, as_read.nodes) if condensed else None)
    restated = recovery_in_units(found, as_read.units, body.units)
    return Recovery(restated.dofs, body.dofs, restated.T @ row_motions(body, as_read))


def _computed(
    pipeline: Pipeline, keys: GeometricStiffnessKeys, body: FEModel, as_read: FEModel, rigid: NDArray[np.float64]
) -> GeometricStiffness | None:
    loads = [_at_node(body, load) for load in keys.computed()]
    geometry = pipeline.components[body.name].geometry
    if not loads or geometry is None:
        return None
    faces = _held(pipeline, keys, body, rigid)
    held = [body.interface_rows(face) for face in faces]
    rows = np.unique(np.concatenate(held)) if held else np.zeros(0, dtype=np.int64)
    bars = bars_in_units(read_bars(geometry.file), as_read.units, body.units)
    hidden = _hidden(geometry.file, body, as_read, bars)
    origin = place_in(keys.origin, as_read.units) * (as_read.units.length / body.units.length)
    words = f"at interface {', '.join(faces)}" if faces else "by its own supports"
    points = _points(geometry.file, body, as_read)
    return bars_stiffness(body, bars, loads, held=rows, origin=origin, holding=words, hidden=hidden, points=points)


def _points(path: Path, body: FEModel, as_read: FEModel) -> NDArray[np.float64] | None:
    """Mass matrices of the point masses at each node (N, 6, 6) in the units of the body; None if they are not known."""
    if as_read.nodes is None or body.nodes is None:
        return None
    stated, _ = deck_statement(path, as_read.nodes, np.ones(len(as_read.nodes), dtype=bool))
    if stated is None or stated.points is None:
        return None
    length = as_read.units.length / body.units.length
    sizes = np.repeat([1.0, length], 3)
    points = stated.points * np.outer(sizes, sizes) * (as_read.units.mass / body.units.mass)
    # A tie adds its point to the nodes.
    found = np.zeros((len(body.nodes), 6, 6))
    at = body.nodes.index(as_read.nodes.id)
    found[at[at >= 0]] = points[at >= 0]
    return found


def _held(
    pipeline: Pipeline, keys: GeometricStiffnessKeys, body: FEModel, rigid: NDArray[np.float64]
) -> tuple[str, ...]:
    """Interfaces at rest while the loads act."""
    if keys.held or not rigid.shape[1]:
        return keys.held
    frame = pipeline.write_of(body.name).frame
    if frame is not None and frame.at is not None:
        return (frame.at,)
    if len(body.interfaces) == 1:
        return tuple(body.interfaces)
    among = f"; it has {', '.join(body.interfaces)}" if body.interfaces else ", but it has none"
    raise SceneError(
        f"components.{body.name}.geometric_stiffness: an interface must hold the body while its unit loads act; name "
        f"it with `held:`{among}"
    )


def _at_node(body: FEModel, load: UnitLoad) -> UnitLoad:
    """A force or moment at an interface of one node, at that node."""
    if load.at not in body.interfaces:
        return load
    nodes = body.interfaces[load.at].node
    if nodes.size != 1:
        raise SceneError(
            f"components.{body.name}.geometric_stiffness: '{load.label}' acts on an interface of {nodes.size} nodes; "
            "name one of them, or tie them (`tie: rigid`)"
        )
    return replace(load, at=str(nodes[0]))
