"""Proof of the shapes of a reduced body: its motions without stiffness must move all nodes as a rigid body does.

The stiffness proves the dofs that it resists. The dofs of one interface it does not resist at all, and sensors have no
rows in it; so the shapes themselves are compared with the geometry. Elastic shapes are compared with the rigid ones in
size, and with each other.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError
from cmsreduce.model import DofTable, Nodes, rigid_body_shapes

__all__ = ["elastic_doubts", "prove_rigid_shapes"]

Array = NDArray[np.float64]

# An eigensolver leaves so much of elastic motion in a rigid one; a wrong row is off by its own size.
_BY_SOLVER = 1e-4
# Rounding of shapes and of places, of which differences and arms take several.
_DIGITS, _PLACES = 100.0, 10.0
_TRANSLATIONS, _ALL = 3, 6
_NAMED = 5
# Elastic modes of one mass and the rigid motions of it move the nodes alike: by this factor more if only a light part
# takes part in all of them, less if all nodes are at the heaviest part.
_SCALE = 100.0
# Shapes that are alike to this share, or to these roundings, are one; few dofs may move alike in different modes.
_ONE_SHAPE, _FEWEST = 1e-7, 3
# Fits whose weights leave wrong nodes out.
_ROUNDS = 30
# What rotations are multiplied by, and coordinates divided by, in files that mix units.
_TURNS = {
    np.degrees(1.0): "its rotations are in degrees",
    -1.0: "its rotations have the other sign",
}
_LENGTHS = {"1000 times": 1e-3, "0.001 times": 1e3, "100 times": 1e-2, "25.4 times": 1 / 25.4, "39.37 times": 0.0254}


def prove_rigid_shapes(name: str, dofs: DofTable, nodes: Nodes, free: Array, rounding: float) -> None:
    """Refuse shapes of rigid motions that are not those of the geometry.

    Parameters
    ----------
    name : str
        Name of the body.
    dofs : DofTable
        p dofs whose motion is known.
    nodes : Nodes
        Places and frames of their nodes.
    free : (p, r) float64
        Shapes without stiffness. A body that is held in part, whose shapes are fewer than the rigid motions of its
        nodes, is not compared.
    rounding : float
        Relative rounding of the shapes.

    Raises
    ------
    DofMapError
        If a rigid motion of the nodes is no sum of these shapes; the message names the nodes, and the likely cause.
    """
    moving = np.flatnonzero(dofs.component > 0)
    dofs, free = dofs[moving], free[moving]
    if not moving.size:
        return
    at = np.unique(nodes.index(dofs.node))
    centre = nodes.xyz[at].mean(axis=0)
    length = float(np.sqrt(np.mean(np.sum((nodes.xyz[at] - centre) ** 2, axis=1)))) or 1.0
    # All rows are displacements: rotations by the length.
    size = np.where(dofs.component > _TRANSLATIONS, length, 1.0)
    R = size[:, None] * rigid_body_shapes(dofs, nodes, centre) / np.repeat([1.0, length], _TRANSLATIONS)
    values = la.svdvals(R)
    if free.shape[1] < int((values > _BY_SOLVER * values[0]).sum()):
        return
    scaled = size[:, None] * free
    scaled = scaled / np.maximum(np.linalg.norm(scaled, axis=0), np.finfo(float).tiny)
    limit = max(_BY_SOLVER, _DIGITS * rounding, _PLACES * float(np.max(nodes.xyz_rounding, initial=0.0)) / length)
    ids, node = np.unique(dofs.node, return_inverse=True)
    weight = np.ones(ids.size)
    if _off(scaled, R, weight, node).max() <= limit:
        return
    for _ in range(_ROUNDS):
        off = _off(scaled, R, weight, node)
        weight = 1 / np.sqrt(np.maximum(off, limit))
    count = int((off > limit).sum())
    worst = np.argsort(-off, kind="stable")[: min(_NAMED, count)]
    raise DofMapError(
        f"body '{name}': its shapes of frequency 0 are not the rigid motions of its nodes: {count} of {ids.size} nodes "
        f"move otherwise; the worst are {', '.join(f'{ids[k]} ({off[k]:.1e})' for k in worst)} (relative to the "
        f"largest motion; digits explain {limit:.1e}). Likely cause: {_cause(scaled, R, dofs, node, limit)}"
    )


def elastic_doubts(
    dofs: DofTable, shapes: Array, mass: Array, free: NDArray[np.int64], rounding: float
) -> tuple[str, ...]:
    """Reasons to doubt elastic shapes: their size beside that of the rigid ones, and two modes of one shape.

    A shape of modal mass 1 moves the nodes by about one over the root of the mass, whether it is rigid or elastic.

    Parameters
    ----------
    dofs : DofTable
        p dofs whose motion is known.
    shapes : (p, m) float64
        Rigid and elastic shapes.
    mass : (m,) float64
        Modal masses.
    free : (r,) int64
        Columns of the rigid shapes.
    rounding : float
        Relative rounding of the shapes.
    """
    moving = (dofs.component > 0) & (dofs.component <= _TRANSLATIONS)
    elastic = np.setdiff1d(np.flatnonzero(mass > 0), free)
    size = np.linalg.norm(shapes[moving], axis=0) / np.sqrt(np.where(mass > 0, mass, 1.0))
    found, rigid = [], size[free][size[free] > 0]
    if rigid.size and elastic.size:
        least, most = (float(value / np.median(rigid)) for value in (size[elastic].min(), size[elastic].max()))
        if most < 1 / _SCALE or least > _SCALE:
            found.append(
                f"the elastic shapes of modal mass 1 move the nodes {least:.2g} to {most:.2g} times as far as the "
                "rigid motions do, and modes of one body move them about alike. If the shapes are in another unit of "
                "length than the body, or have other modal masses, its responses are wrong by the square of this "
                "factor: give shapes and modal masses of one normalisation"
            )
    unit = shapes[:, elastic] / np.maximum(np.linalg.norm(shapes[:, elastic], axis=0), np.finfo(float).tiny)
    likeness = np.triu(abs(unit.T @ unit), 1)
    for i, j in np.argwhere(likeness > 1 - _BY_SOLVER):
        apart = unit[:, i] * np.sign(unit[:, i] @ unit[:, j]) - unit[:, j]
        moved = int((abs(unit[:, i]) > _BY_SOLVER).sum())
        if moved >= _FEWEST and abs(apart).max() <= max(_ONE_SHAPE, _DIGITS * rounding):
            found.append(f"modes {elastic[i] + 1} and {elastic[j] + 1} move all {len(dofs)} dofs alike: is one a copy?")
    return tuple(found)


def _off(free: Array, R: Array, weight: Array, node: NDArray[np.int64]) -> Array:
    """Largest motion of each node that no sum of the free shapes gives, of all rigid motions; nodes have weights."""
    w = weight[node][:, None]
    left = R - free @ np.linalg.lstsq(w * free, w * R, rcond=None)[0]
    found = np.zeros(weight.size)
    np.maximum.at(found, node, abs(left).max(axis=1))
    return np.asarray(found / abs(R).max())


def _cause(free: Array, R: Array, dofs: DofTable, node: NDArray[np.int64], limit: float) -> str:
    """The first cause that explains all shapes, and the remedy."""
    turns = dofs.component > _TRANSLATIONS
    even = np.ones(int(node.max()) + 1)
    if turns.any() and not turns.all():
        for factor, said in _TURNS.items():
            read = free / np.where(turns, factor, 1.0)[:, None]
            if _off(read, R, even, node).max() <= limit:
                return f"{said}. Write them in radians, right-handed about the axes of the displacements"
        for unit, factor in _LENGTHS.items():
            arms = R.copy()
            arms[~turns, _TRANSLATIONS:] *= factor
            if _off(free, arms, even, node).max() <= limit:
                return f"the coordinates are {unit} those of the shapes: give both in the same unit of length"
    return (
        "rows that belong to other nodes or axes (`rows:`, frames of nodes), or coordinates of another model. Write "
        "shapes and nodes from one model"
    )
