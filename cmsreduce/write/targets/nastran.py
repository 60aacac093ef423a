"""NASTRAN: a reduced body as a superelement of OP4 matrices, DMIG entries, and a deck of its interface grids."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh, null_space

from cmsreduce.errors import WriteError
from cmsreduce.model import SCALAR, DofTable
from cmsreduce.write.component import ComponentFile
from cmsreduce.write.files import atomic_path, put_lines

__all__ = [
    "Superelement",
    "superelement",
    "write_nastran",
]

# Rows of the shapes are scaled to unit length. Shapes are known to about nine digits, so a row that is a combination of
# the others to nine digits is dependent on them.
_DEPENDENT = 1e-9

Array = NDArray[np.float64]

_SYMMETRIC = 6  # form of a matrix in OP4 and DMIG
_LARGEST_ID = 99_999_999  # eight digits, a field of a card
# Axes that differ from the basic ones by less are the basic ones: round-off of products.
_BASIC = 1e-12

_MATRICES = {"K": "KAA", "M": "MAA", "D": "BAA", "loss": "K4AA"}
_DMIG = {"KAA": "K2GG", "MAA": "M2GG", "BAA": "B2GG", "K4AA": "K42GG"}
"""Case control that adds each matrix to the model."""


def write_nastran(path: Path, component: ComponentFile) -> tuple[Path, ...]:
    """Write a body as a superelement for NASTRAN: ``.op4``, ``.pch`` and ``.bdf`` of one stem.

    Rows are the interface dofs by node and component, each in its node's displacement frame, then one scalar point for
    each mode with the interfaces held. The OP4 file (binary, double precision) is exact; DMIG entries have ten digits.

    Parameters
    ----------
    path : Path
        Name of the files without its suffix; each file is complete or absent.
    component : ComponentFile
        The body.

    Returns
    -------
    tuple of Path
        Files written.

    Raises
    ------
    WriteError
        If the body has no interfaces or too few modes to move them, or a file cannot be written.
    """
    from pyyeti.nastran import op4

    body = superelement(component)
    points = _scalar_points(component, body)
    matrices = {name: getattr(body, letter) for letter, name in _MATRICES.items() if getattr(body, letter) is not None}
    labels = [*zip(body.interface.node.tolist(), body.interface.component.tolist(), strict=True)]
    labels += [(point, SCALAR) for point in points]
    exact, punch, deck = (path.with_suffix(suffix) for suffix in (".op4", ".pch", ".bdf"))
    with atomic_path(exact) as temporary:
        op4.write(str(temporary), matrices, forms=dict.fromkeys(matrices, _SYMMETRIC))
    put_lines(punch, _entries(matrices, labels))
    put_lines(deck, _cards(component, body, points, list(matrices), punch.name))
    return exact, punch, deck


@dataclass(frozen=True, eq=False)
class Superelement:
    """Mass and stiffness of i interface dofs and q fixed-interface modes.

    Parameters
    ----------
    interface : DofTable
        Interface dofs, sorted by node and component.
    omega : (q,) float64
        Frequencies with fixed interfaces, in rad per unit of time; infinite for shapes without mass.
    M, K : (i + q, i + q) float64
        Interface dofs first.
    D, loss : (i + q, i + q) float64, optional
        Viscous damping, and imaginary part of the stiffness.
    """

    interface: DofTable
    omega: Array
    M: Array
    K: Array
    D: Array | None
    loss: Array | None


def superelement(component: ComponentFile) -> Superelement:
    """Express a component's modes as constraint modes of its interfaces and fixed-interface modes of the same space.

    Parameters
    ----------
    component : ComponentFile
        m modes.

    Raises
    ------
    WriteError
        If it has no interface, or fewer shapes than its interface dofs need.

    Notes
    -----
    A constraint mode is the shape of least strain energy for a unit displacement of one interface dof. No stiffness
    couples it to the fixed-interface modes (Craig and Bampton, 1968).
    """
    interface, shapes = _interface(component)
    K, M, D = (component.arrays[f"modes/{name}"] for name in ("stiffness", "mass", "damping"))
    loss = component.arrays.get("modes/loss")
    psi = _constraint_modes(component, shapes, np.diag(K))
    omega, Y = _fixed_interface_modes(shapes, K, M)
    T = np.hstack([psi, Y])
    i, massless = shapes.shape[0], np.isinf(omega)
    reduced_K, reduced_M = _change(K, T), _change(M, T)
    # Remove the round-off of entries that are exactly zero or one: least strain energy, and modes of unit mass.
    reduced_K[:i, i:] = reduced_K[i:, :i] = 0.0
    reduced_K[i:, i:] = np.diag(np.where(massless, 1.0, omega) ** 2)
    reduced_M[i:, i:] = np.diag(np.where(massless, 0.0, 1.0))
    return Superelement(
        interface,
        omega,
        reduced_M,
        reduced_K,
        _change(D, T) if D.any() else None,
        None if loss is None else _change(loss, T),
    )


def _change(A: Array, T: Array) -> Array:
    B = T.T @ A @ T
    return np.asarray(0.5 * (B + B.T))


def _interface(component: ComponentFile) -> tuple[DofTable, Array]:
    """Dofs of all interfaces, each once, and their rows of the shapes (i, m)."""
    names = [f"interfaces/{name}" for name in component.interfaces]
    if not names:
        raise WriteError(f"component '{component.name}': a superelement needs interfaces, and this body has none")
    node = np.concatenate([component.arrays[f"{name}/node"] for name in names])
    part = np.concatenate([component.arrays[f"{name}/component"] for name in names])
    rows = np.vstack([component.arrays[f"{name}/shapes"] for name in names])
    _, first = np.unique(node * 8 + part, return_index=True)
    return DofTable(node[first], part[first]), rows[first]


def _constraint_modes(component: ComponentFile, shapes: Array, stiffness: Array) -> Array:
    """Modal coordinates (m, i) of the shapes of least strain energy that displace one interface dof each."""
    r, i = component.rigid_count, shapes.shape[0]
    scale = 1 / np.linalg.norm(shapes, axis=1)
    if not np.isfinite(scale).all():
        raise WriteError(f"component '{component.name}': an interface dof moves in no mode kept; keep more modes")
    scaled = scale[:, None] * shapes
    rigid, strained = scaled[:, :r], scaled[:, r:] / np.sqrt(stiffness[r:])
    # Rigid motions need no strain energy; only the remaining motions of the interface strain the body.
    left = null_space(rigid.T, rcond=_DEPENDENT) if r else np.eye(i)
    remaining = left.T @ strained
    if np.linalg.matrix_rank(left.T @ scaled[:, r:], tol=_DEPENDENT) < left.shape[1]:
        raise WriteError(
            f"component '{component.name}': its {shapes.shape[1]} modes cannot move its {i} interface dofs "
            "independently; keep more modes, or the constraint modes of the interface"
        )
    p = np.linalg.pinv(remaining) @ left.T if left.shape[1] else np.zeros((strained.shape[1], i))
    q = np.linalg.pinv(rigid, rcond=_DEPENDENT) @ (np.eye(i) - strained @ p)
    return np.asarray(np.vstack([q, p / np.sqrt(stiffness[r:])[:, None]]) * scale)


def _fixed_interface_modes(shapes: Array, K: Array, M: Array) -> tuple[Array, Array]:
    """Frequencies (q,) and modal coordinates (m, q) of the fixed-interface modes."""
    held = null_space(shapes / np.linalg.norm(shapes, axis=1)[:, None], rcond=_DEPENDENT)
    if not held.shape[1]:
        return np.zeros(0), held
    # There are shapes without mass and shapes without stiffness; K + shift M is positive for both. The lowest modes
    # keep their digits if the shift is not above them.
    k, m = held.T @ K @ held, held.T @ M @ held
    resisting = np.diag(K)[(np.diag(K) > 0) & (np.diag(M) > 0)]
    shift = resisting.min(initial=np.inf) if resisting.size else 1.0
    compliance, Y = eigh(0.5 * (m + m.T), 0.5 * (k + shift * m + (k + shift * m).T))
    compliance, Y = compliance[::-1], Y[:, ::-1]
    # Modal masses are 1 or 0, so the rank of the mass counts the combinations with mass, for any stiffness.
    massless = np.arange(Y.shape[1]) >= np.linalg.matrix_rank(m, rtol=_DEPENDENT, hermitian=True)
    squared = np.where(massless, np.inf, 1 / np.where(massless, 1.0, compliance) - shift)
    # The eigenvectors are orthonormal in K + shift M. Scale them to unit mass; those without mass have unit stiffness.
    return np.sqrt(np.maximum(squared, 0.0)), held @ (Y / np.sqrt(np.where(massless, 1.0, compliance)))


def _scalar_points(component: ComponentFile, body: Superelement) -> list[int]:
    first = int(body.interface.node.max()) + 1
    if first + body.omega.size > _LARGEST_ID:
        raise WriteError(
            f"component '{component.name}': node {first - 1} leaves no ids of eight digits for {body.omega.size} "
            "scalar points; number its interface nodes lower"
        )
    return list(range(first, first + body.omega.size))


def _entries(matrices: Mapping[str, NDArray[np.float64]], labels: list[tuple[int, int]]) -> Iterator[str]:
    """DMIG cards of wide fields, lower triangles column by column."""
    for name, matrix in matrices.items():
        yield f"DMIG    {name:<8}{0:8d}{6:8d}{2:8d}{0:8d}"
        for column, (node, component) in enumerate(labels):
            rows = [row for row in range(column, len(labels)) if matrix[row, column] != 0]
            if rows:
                yield f"DMIG*   {name:<16}{node:16d}{component:16d}"
            for row in rows:
                yield f"*       {labels[row][0]:16d}{labels[row][1]:16d}{_double(matrix[row, column])}"


def _double(value: float) -> str:
    """Sixteen characters with an exponent of two digits; smaller numbers are zero."""
    return f"{value if abs(value) > 1e-99 else 0.0:16.9E}".replace("E", "D")


def _cards(
    component: ComponentFile, body: Superelement, points: list[int], matrices: list[str], punch: str
) -> Iterator[str]:
    """Interface grids with their frames, scalar points, and the sets that order the rows."""
    node, parts = body.interface.node, body.interface.component
    yield f"$ Superelement of {component.name}: {len(body.interface)} interface dofs, {len(points)} modal coordinates"
    yield f"$ To use it, include {punch} in the bulk data and ask in case control for:"
    for name in matrices:
        yield f"$   {_DMIG[name]} = {name}"
    for point, omega in zip(points, body.omega, strict=True):
        yield f"$ {point}: {omega / (2 * np.pi):.6g} Hz with the interfaces held"
    yield "BEGIN BULK"
    grids = np.unique(node[parts != SCALAR])
    for number, grid in enumerate(grids, 1):
        yield from _grid(component, int(grid), number)
    for point in [*np.unique(node[parts == SCALAR]).tolist(), *points]:
        yield f"SPOINT  {point:8d}"
    for grid in grids:
        digits = "".join(str(part) for part in parts[node == grid])
        yield f"ASET1   {digits:>8}{grid:8d}"
    for point in [*np.unique(node[parts == SCALAR]).tolist(), *points]:
        yield f"ASET1   {0:8d}{point:8d}"
    yield "ENDDATA"


def _grid(component: ComponentFile, grid: int, number: int) -> Iterator[str]:
    """A grid in basic coordinates, with a frame of its own if its displacement axes are not the basic ones."""
    at = int(np.flatnonzero(component.arrays["nodes/id"] == grid)[0])
    xyz, axes = component.arrays["nodes/xyz"][at], component.arrays["nodes/frame"][at]
    own = abs(axes - np.eye(3)).max() > _BASIC
    if own:
        points = np.concatenate([np.zeros(3), axes[2], axes[0]])
        fields = "".join(f"{value:16.9E}" for value in points)
        yield f"CORD2R* {number:16d}{0:16d}{fields[:32]}"
        for start in range(32, len(fields), 64):
            yield f"*       {fields[start : start + 64]}"
    x, y, z = (f"{value:16.9E}" for value in xyz)
    yield f"GRID*   {grid:16d}{0:16d}{x}{y}"
    yield f"*       {z}{number if own else 0:16d}"
