"""Mass of a body before it was tied, and mass lumped at the nodes: a point mass and an inertia at each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError
from cmsreduce.model import Damping, FEModel, Lumping, rigid_body_shapes

__all__ = ["lumped_mass", "moves_generalised", "total_mass", "untied_body"]


def moves_generalised(body: FEModel) -> bool:
    """Return whether mass moves with scalar dofs, as with the generalised coordinates of a superelement.

    The shapes of such coordinates over the body are not in its matrices. These determine the rigid mass and the
    momentum and modal mass of all shapes, but no integral of one direction with another, and no mass of a node.
    """
    as_read, _ = untied_body(body)
    scalar = np.flatnonzero(as_read.dofs.component == 0)
    return bool(abs(as_read.M[:, scalar]).sum() > 0)


def untied_body(body: FEModel) -> tuple[FEModel, sp.csr_array]:
    """Mass of a body over the dofs that it was read with.

    Parameters
    ----------
    body : FEModel
        n dofs.

    Returns
    -------
    as_read : FEModel
        With g dofs, the mass of every node in rows of its own, and no stiffness; the body itself without ties.
    T : (g, n) sparse array
        Motion of these dofs under unit motion of each row of the body: ``body.M`` is T^T ``as_read.M`` T.
    """
    if body.untied_mass is None:
        return body, sp.eye_array(body.n, format="csr")
    dofs, every = body.untied_mass.dofs, body.recovery
    rows = every.dofs.rows(dofs.node, dofs.component)
    # Dofs without a row are held.
    moving = sp.diags_array((rows >= 0).astype(np.float64))
    as_read = replace(
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
        _sound=(body.untied_mass.M,),
    )
    return as_read, sp.csr_array(moving @ every.T[np.maximum(rows, 0)])


def lumped_mass(body: FEModel, lumping: Lumping) -> sp.csc_array:
    """Mass matrix of a body, unchanged or lumped at its nodes.

    Parameters
    ----------
    body : FEModel
        n dofs, with geometry.
    lumping : Lumping
        ``consistent``: the matrix itself. ``row-sum``: the mass of a node is the force on it under unit acceleration of
        the whole body; quadratic elements get negative masses at their corners. ``diagonal``: the mass of a node is its
        diagonal entry, scaled so that the sum is the mass of the body (Hinton, Rock and Zienkiewicz).

    Returns
    -------
    (n, n) sparse array
        A point mass at every node, the same in all directions in which the node can move, and a 3 x 3 inertia of its
        rotations: the sum of their own rows, or their own block scaled like the masses. Coupling between translations
        and rotations is left out. Scalar dofs have none. The mass of tied nodes
        is lumped at these nodes, and then written in the rows that they follow.

    Raises
    ------
    DofMapError
        If the body has no geometry, or generalised coordinates have mass, which has no place among the nodes.

    Notes
    -----
    Source: Hinton, Rock and Zienkiewicz, Earthquake Eng. Struct. Dyn. 4 (1976), for the scaled diagonal. The mean over
    directions makes the result independent of the displacement frames of the nodes.
    """
    if lumping == "consistent":
        return body.M
    if body.nodes is None:
        raise DofMapError(f"body '{body.name}' has no geometry, so its mass cannot be lumped at its nodes")
    if moves_generalised(body):
        raise DofMapError(
            f"body '{body.name}': its mass cannot be lumped at its nodes, because generalised coordinates (scalar "
            "points) carry a part of it; leave `mass` of `write.integrals` out, which gives the consistent mass"
        )
    if body.untied_mass is not None:
        as_read, T = untied_body(body)
        return sp.csc_array(T.T @ lumped_mass(as_read, lumping) @ T)
    M, component = body.M, body.dofs.component
    translations, rotations = np.flatnonzero((component >= 1) & (component <= 3)), np.flatnonzero(component > 3)
    if lumping == "row-sum":
        R = rigid_body_shapes(body.dofs, body.nodes)[:, :3]
        # The row of R is the direction of the dof, along which the force is taken.
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
    values = np.zeros(body.n)
    values[translations] = factor * mass[at]
    inertia = factor * _nodal_inertia(body, rotations, whole_rows=lumping == "row-sum")
    return sp.csc_array(sp.diags_array(values) + inertia)


def total_mass(body: FEModel) -> float:
    """Mass of a body: the largest of the masses along x, y and z, because the body may be held in some directions."""
    if body.nodes is None:
        raise DofMapError(f"body '{body.name}' has no geometry, so the directions of its rows are not known")
    R = rigid_body_shapes(body.dofs, body.nodes)[:, :3]
    return float(np.einsum("nx,nx->x", R, body.M @ R).max(initial=0.0))


def _nodal_inertia(body: FEModel, rotations: NDArray[np.int64], *, whole_rows: bool) -> sp.csc_array:
    """Inertia of each node's rotations: sums of its rows over equal rotations of all nodes, or its own block."""
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
    # (J R)_i is the moment on a row under unit rotations of all nodes; R R^T of one node projects it on its rows.
    moment = body.M[rotations][:, rotations] @ R[rotations]
    _, node = np.unique(body.dofs.node[rotations], return_inverse=True)
    same = sp.csr_array((np.ones(node.size), (np.arange(node.size), node)))
    pairs = sp.coo_array(same @ same.T)
    entries = np.einsum("px,px->p", moment[pairs.row], R[rotations[pairs.col]])
    A = sp.csc_array((entries, (rotations[pairs.row], rotations[pairs.col])), shape=(n, n))
    return sp.csc_array((A + A.T) / 2)
