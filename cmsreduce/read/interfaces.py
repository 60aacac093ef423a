"""Matrices and interfaces as the user names them; interfaces resolved into nodes, components, positions and axes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError, SceneError
from cmsreduce.model import SCALAR, DofTable, Interface, Nodes, components_from_digits

__all__ = ["InterfaceSpec", "MatrixSource", "Nearby", "resolve_interface"]

Digits = str | tuple[int, ...] | None

_TRANSLATIONS = 3
_MOTIONS = np.arange(1, 7)
# Nodes that a message suggests in place of an unknown one.
_NEAREST = 3
# Positions that differ by less than this share of the body's size are the same coordinate, for the order of nodes.
_SAME_COORDINATE = 1e-5
# A nearest node that is farther away by this factor is in coordinates of other units, or of another frame.
_FAR = 100.0
# Axes typed with four digits are accepted as a rotation; they are made orthonormal.
_CROOKED = 1e-3


@dataclass(frozen=True)
class MatrixSource:
    """A matrix in a file.

    Parameters
    ----------
    path : Path
        The file.
    matrix : str, optional
        Name of the matrix in it; needed where the file holds several.
    format : str, optional
        Name of the format; by default the content decides.
    """

    path: Path
    matrix: str | None = None
    format: str | None = None


@dataclass(frozen=True)
class Nearby:
    """Nodes of an interface by their position.

    Parameters
    ----------
    position : tuple of three float
        Place in the body's basic frame and unit of length.
    within : float
        Largest distance of a node from it.
    nearest : bool
        True for the nearest node alone.
    """

    position: tuple[float, float, float]
    within: float
    nearest: bool = False


@dataclass(frozen=True, eq=False)
class InterfaceSpec:
    """An interface as the user names it: by nodes, by a set, or by position.

    Parameters
    ----------
    nodes : tuple of int, optional
        Node ids in order.
    dofs : str or tuple of int, optional
        Components 1..6 that every node must have; by default all of 123456 that a node has.
    set : str, optional
        Dof set of the geometry instead of nodes, such as ``b``, or a set of nodes.
    frame : (3, 3) float64, optional
        Axes as rows, in basic; by default the displacement frame of the first node.
    near : Nearby, optional
        Position instead of nodes; nodes with translations in the matrices count.
    """

    nodes: tuple[int, ...] | None = None
    dofs: Digits = None
    set: str | None = None
    frame: NDArray[np.float64] | None = None
    near: Nearby | None = None


def resolve_interface(
    body: str,
    name: str,
    spec: InterfaceSpec,
    dofs: DofTable,
    nodes: Nodes | None,
    sets: Mapping[str, NDArray[np.int64]],
    node_sets: Mapping[str, NDArray[np.int64]] | None = None,
    expanded: Mapping[int, tuple[int, ...]] | None = None,
) -> Interface:
    """Find the nodes and components of an interface.

    Parameters
    ----------
    body, name : str
        Names, for messages.
    spec : InterfaceSpec
        The interface as the user names it.
    dofs : DofTable
        Rows of the body.
    nodes : Nodes, optional
        Its geometry; without it positions are zero and axes basic.
    sets : mapping of str to (k,) int64
        Rows of its dof sets.
    node_sets : mapping of str to (k,) int64, optional
        Nodes of the sets of nodes of its geometry.
    expanded : mapping of int to (tuple of int), optional
        Nodes that a node of a shell or a beam became; they stand for it where it has no rows of its own.

    Returns
    -------
    Interface

    Raises
    ------
    SceneError
        If a node is unknown, has no rows or lacks a dof, or the set or the frame is wrong.
    """
    where = f"body '{body}', interface '{name}'"
    if sum(given is not None for given in (spec.nodes, spec.set, spec.near)) != 1:
        raise SceneError(f"{where}: give either `node:` (or `nodes:`), `set:` or `near:`")
    named = spec.nodes
    if spec.near is not None:
        named = _nearby(where, spec.near, dofs, nodes)
    elif spec.set is not None and spec.set not in sets:
        named = _node_set(spec.set, node_sets or {})
    if spec.set is not None and named is None:
        members, components = _of_set(where, spec.set, spec.dofs, dofs, sets, node_sets or {})
    else:
        members = tuple(one for node in named or () for one in _standing_for(node, dofs, expanded or {}))
        components = tuple(_components(where, node, spec.dofs, dofs, nodes) for node in members)
    if not members:
        raise SceneError(f"{where}: it has no nodes")
    if len(set(members)) < len(members):
        twice = next(node for node in members if members.count(node) > 1)
        raise SceneError(f"{where}: node {twice} is named twice")
    position, axes = np.zeros((len(members), 3)), np.tile(np.eye(3), (len(members), 1, 1))
    if nodes is not None:
        at = nodes.index(np.array(members))
        position, axes = nodes.xyz[at], nodes.frame[at]
    frame = axes[0] if spec.frame is None else _rotation(where, spec.frame)
    return Interface(name, np.array(members, dtype=np.int64), components, position, frame, axes)


def _nearby(where: str, near: Nearby, dofs: DofTable, nodes: Nodes | None) -> tuple[int, ...]:
    """Nodes near a position, ordered along x, then y, then z, so that nodes of two bodies that coincide pair up."""
    if nodes is None or not len(nodes):
        raise SceneError(f"{where}: `near:` needs coordinates; give `geometry:`, or name the nodes")
    ids = np.unique(dofs.node[(dofs.component > 0) & (dofs.component <= _TRANSLATIONS)])
    ids = ids[nodes.index(ids) >= 0]
    xyz = nodes.xyz[nodes.index(ids)]
    away = np.linalg.norm(xyz - near.position, axis=1)
    found = np.flatnonzero(away <= near.within)
    place = "[{}]".format(", ".join(f"{x:g}" for x in near.position))
    if not found.size:
        closest = ", ".join(f"{ids[k]} ({away[k]:.4g} away)" for k in np.argsort(away, kind="stable")[:_NEAREST])
        low, high = ("[{}]".format(", ".join(f"{x:.4g}" for x in corner)) for corner in (xyz.min(0), xyz.max(0)))
        units = away.min(initial=np.inf) > _FAR * near.within
        raise SceneError(
            f"{where}: no node with rows lies within {near.within:g} of {place}; the nearest are {closest}, and the "
            f"body reaches from {low} to {high} in its own unit of length"
            + (": is the position in the body's basic frame, and in its units?" if units else "; make `within:` larger")
        )
    if near.nearest:
        best = found[away[found].argmin()]
        rival = found[(found != best) & (away[found] <= away[best] + _SAME_COORDINATE * near.within)]
        if rival.size:
            raise SceneError(
                f"{where}: nodes {ids[best]} and {ids[rival[0]]} are equally near to {place}; name one by `node:`"
            )
        return (int(ids[best]),)
    size = float(np.abs(xyz - xyz.mean(axis=0)).max()) or 1.0
    steps = np.round(xyz[found] / (_SAME_COORDINATE * size))
    return tuple(ids[found[np.lexsort((ids[found], *steps.T[::-1]))]].tolist())


def _node_set(name: str, node_sets: Mapping[str, NDArray[np.int64]]) -> tuple[int, ...] | None:
    """Nodes of a set by its name; capitals do not matter unless two names differ in them only."""
    alike = [name] if name in node_sets else [label for label in node_sets if label.lower() == name.lower()]
    return tuple(node_sets[alike[0]].tolist()) if len(alike) == 1 else None


def _standing_for(node: int, dofs: DofTable, expanded: Mapping[int, tuple[int, ...]]) -> list[int]:
    """The node itself if it has rows, else the nodes with rows that it became."""
    if node not in expanded or (dofs.rows(node, _MOTIONS) >= 0).any():
        return [node]
    return [one for one in expanded[node] if (dofs.rows(one, _MOTIONS) >= 0).any()] or [node]


def _of_set(
    where: str,
    name: str,
    digits: Digits,
    dofs: DofTable,
    sets: Mapping[str, NDArray[np.int64]],
    node_sets: Mapping[str, NDArray[np.int64]],
) -> tuple[tuple[int, ...], tuple[tuple[int, ...], ...]]:
    """Nodes of a dof set in order of their rows, and their components in it."""
    if name not in sets:
        known = ", ".join(f"{key} ({rows.size})" for key, rows in sets.items()) or "none"
        named = ", ".join(f"{key} ({nodes.size})" for key, nodes in node_sets.items()) or "none"
        raise SceneError(
            f"{where}: the body has no set '{name}' (dof sets: {known}; sets of nodes: {named}); name one of these, or "
            "nodes"
        )
    rows = sets[name]
    rows = rows[dofs.component[rows] != SCALAR]
    members = tuple(dict.fromkeys(int(node) for node in dofs.node[rows]))
    if not members:
        raise SceneError(f"{where}: set '{name}' holds scalar dofs only, which no joint can be attached to")
    wanted = None if digits is None else _digits(where, digits)
    parts = []
    for node in members:
        has = tuple(sorted(int(c) for c in dofs.component[rows[dofs.node[rows] == node]]))
        missing = "".join(str(c) for c in wanted or () if c not in has)
        if missing:
            raise SceneError(f"{where}: node {node} has no dof {missing} in set '{name}'")
        parts.append(wanted or has)
    return members, tuple(parts)


def _digits(where: str, digits: str | tuple[int, ...]) -> tuple[int, ...]:
    """Component numbers of a user's digits."""
    try:
        return components_from_digits(digits if isinstance(digits, str) else "".join(map(str, digits)))
    except DofMapError as error:
        raise SceneError(f"{where}: {error}") from error


def _components(where: str, node: int, digits: Digits, dofs: DofTable, nodes: Nodes | None) -> tuple[int, ...]:
    """Components of a node that belong to the interface: those that the user names, or all of the node."""
    has = np.flatnonzero(dofs.rows(node, np.arange(1 + _MOTIONS.size)) >= 0).tolist()
    if not has:
        raise SceneError(f"{where}: {_absent(node, dofs, nodes)}")
    if has == [SCALAR]:
        raise SceneError(f"{where}: {node} is a scalar point; a joint needs a node with displacements")
    if digits is None:
        return tuple(has)
    wanted = _digits(where, digits)
    missing = "".join(str(c) for c in wanted if c not in has)
    if missing:
        raise SceneError(
            f"{where}: node {node} has no dof {missing} in the matrices, it has {''.join(map(str, has))}; "
            "leave `dofs:` out to take all it has"
        )
    return wanted


def _absent(node: int, dofs: DofTable, nodes: Nodes | None) -> str:
    """Reason why a node cannot be an interface, and nodes that could."""
    known = np.unique(dofs.node[dofs.component != SCALAR])
    at = -1 if nodes is None else int(nodes.index(node)[0])
    if nodes is None or at < 0:
        if not known.size:
            return f"there is no node {node}; the body has scalar dofs only"
        near = known[np.argsort(np.abs(known - node), kind="stable")[:_NEAREST]]
        return (
            f"there is no node {node}; the matrices have {known.size} nodes, from {known.min()} to {known.max()}, "
            f"the nearest ids are {', '.join(map(str, near))}"
        )
    placed = known[nodes.index(known) >= 0]
    absent = f"node {node} is in the geometry but has no rows in the matrices"
    if not placed.size:
        return f"{absent}, and so has none of the {len(nodes)} nodes of the geometry; both must be of one model"
    away = np.linalg.norm(nodes.xyz[nodes.index(placed)] - nodes.xyz[at], axis=1)
    order = np.argsort(away, kind="stable")[:_NEAREST]
    near_by = ", ".join(f"{placed[k]} ({away[k]:.3g} away)" for k in order)
    return (
        f"{absent}: it was condensed out or is constrained. Keep it when the matrices are written, or take one of the "
        f"{placed.size} nodes with rows, such as {near_by}"
    )


def _rotation(where: str, frame: NDArray[np.float64]) -> NDArray[np.float64]:
    """The nearest exact rotation to the given axes."""
    axes = np.asarray(frame, dtype=np.float64)
    if axes.shape != (3, 3) or not np.isfinite(axes).all():
        raise SceneError(f"{where}: `frame:` needs three axes of three numbers")
    lengths = np.linalg.norm(axes, axis=1)
    if (lengths == 0).any():
        raise SceneError(f"{where}: an axis of `frame:` is zero")
    axes = axes / lengths[:, None]
    if np.abs(axes @ axes.T - np.eye(3)).max() > _CROOKED or np.linalg.det(axes) < 0:
        raise SceneError(f"{where}: the axes of `frame:` are not a right-handed set at right angles")
    u, _, vt = np.linalg.svd(axes)
    exact: NDArray[np.float64] = u @ vt
    return exact
