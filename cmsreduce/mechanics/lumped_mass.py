"""A tied body as it was before it was tied: its mass where its nodes are.

A mass matrix gathered at the nodes: a point mass and an inertia at each.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError
from cmsreduce.model import Damping, FEModel, Lumping, rigid_body_shapes

__all__ = [
    "lumped_mass",
    "total_mass",
    "untied_body",
]


def untied_body(body: FEModel) -> tuple[FEModel, sp.csr_array]:
    """The mass of a body over the dofs it was read with.

    Parameters
    ----------
    body : FEModel
        n dofs.

    Returns
    -------
    whole : FEModel
        Of g dofs, with the mass of every node in rows of its own, without stiffness; the body itself if nothing of it
        is tied.
    T : (g, n) sparse array
        Their motion under unit motion of each row of the body: ``body.M`` is T^T ``whole.M`` T.
    """
    if body.untied_mass is None:
        return body, sp.eye_array(body.n, format="csr")
    dofs, every = body.untied_mass.dofs, body.recovery
    rows = every.dofs.rows(dofs.node, dofs.component)
    # What nothing moves is held and has no row.
    moving = sp.diags_array((rows >= 0).astype(np.float64))
    whole = replace(
        body,
        K=sp.csc_array((len(dofs), len(dofs))),
        M=body.untied_mass.M,
        D=None,
        dofs=dofs,
        damping=Damping(),
        interfaces={},
        sets={},
        tied=None,
        untied_mass=None,
    )
    return whole, sp.csr_array(moving @ every.T[np.maximum(rows, 0)])


def lumped_mass(body: FEModel, lumping: Lumping) -> sp.csc_array:
    """Mass matrix of a body, as it is or gathered at its nodes.

    Parameters
    ----------
    body : FEModel
        n dofs, with geometry.
    lumping : Lumping
        ``consistent`` gives the matrix back. ``row-sum`` gives a node the force on it under unit acceleration of the
        whole body; quadratic elements get negative masses at their corners by it. ``diagonal`` gives it its own
        diagonal entry, all of them scaled to the mass of the body (Hinton, Rock and Zienkiewicz).

    Returns
    -------
    (n, n) sparse array
        A point mass at every node, the same in all the directions in which the node can move, and a 3 x 3 inertia of
        its rotations: the sum of their own rows, or their own block scaled like the masses. What couples translations
        with rotations is left out. Scalar dofs keep their diagonal, or row sum, unscaled. Of a body with tied nodes:
        the mass at its nodes as they were, in the rows that these follow.

    Raises
    ------
    DofMapError
        If the body has no geometry.

    Notes
    -----
    Sources: Hinton, Rock and Zienkiewicz, Earthquake Eng. Struct. Dyn. 4 (1976), for the scaled diagonal. The mean over
    directions makes the result independent of the frames that the nodes move along.
    """
    if lumping == "consistent":
        return body.M
    if body.nodes is None:
        raise DofMapError(f"body '{body.name}' has no geometry, so its mass cannot be gathered at its nodes")
    if body.untied_mass is not None:
        whole, T = untied_body(body)
        return sp.csc_array(T.T @ lumped_mass(whole, lumping) @ T)
    M, component = body.M, body.dofs.component
    translations, rotations = np.flatnonzero((component >= 1) & (component <= 3)), np.flatnonzero(component > 3)
    if lumping == "row-sum":
        R = rigid_body_shapes(body.dofs, body.nodes)[:, :3]
        # A row's own direction is R's row: its share of unit acceleration along that direction.
        own = np.einsum("nx,nx->n", M @ R, R)
    else:
        own = M.diagonal()
    _, node = np.unique(body.dofs.node, return_inverse=True)
    at = node[translations]
    many = np.bincount(at, minlength=int(node.max(initial=-1)) + 1)
    mass = np.bincount(at, own[translations], minlength=many.size) / np.maximum(many, 1)
    factor = 1.0
    if lumping == "diagonal" and mass.any():
        factor = total_mass(body) / mass.sum()
    values = np.where(component == 0, np.asarray(M.sum(axis=1)) if lumping == "row-sum" else M.diagonal(), 0.0)
    values[translations] = factor * mass[at]
    inertia = factor * _nodal_inertia(body, rotations, whole_rows=lumping == "row-sum")
    return sp.csc_array(sp.diags_array(values) + inertia)


def total_mass(body: FEModel) -> float:
    """Mass of a body: the largest of those that move along x, y and z, for it may be held in the others."""
    if body.nodes is None:
        raise DofMapError(f"body '{body.name}' has no geometry, so the directions of its rows are not known")
    R = rigid_body_shapes(body.dofs, body.nodes)[:, :3]
    return float(np.einsum("nx,nx->x", R, body.M @ R).max(initial=0.0))


def _nodal_inertia(body: FEModel, rotations: NDArray[np.int64], *, whole_rows: bool) -> sp.csc_array:
    """Inertia of each node's rotations: sums of its rows over all nodes, turned alike, or its own block."""
    n = body.n
    if not rotations.size:
        return sp.csc_array((n, n))
    assert body.nodes is not None
    J = sp.coo_array(body.M[rotations][:, rotations])
    i, j, value = rotations[J.row], rotations[J.col], J.data
    here = body.dofs.node[i] == body.dofs.node[j]
    if not whole_rows:
        return sp.csc_array((value[here], (i[here], j[here])), shape=(n, n))
    R = rigid_body_shapes(body.dofs, body.nodes)[:, 3:]
    # (J R)_i is the moment on a row for unit rotations of all nodes; R R^T of one node turns it back to its rows.
    moment = body.M[rotations][:, rotations] @ R[rotations]
    _, node = np.unique(body.dofs.node[rotations], return_inverse=True)
    same = sp.csr_array((np.ones(node.size), (np.arange(node.size), node)))
    pairs = sp.coo_array(same @ same.T)
    entries = np.einsum("px,px->p", moment[pairs.row], R[rotations[pairs.col]])
    A = sp.csc_array((entries, (rotations[pairs.row], rotations[pairs.col])), shape=(n, n))
    return sp.csc_array((A + A.T) / 2)
