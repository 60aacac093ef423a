"""Forces that a body puts up against rigid motion, grid by grid: a free body puts up none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import FEModel

__all__ = ["Grounding", "grounding"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Grounding:
    """K R, and what it comes to at each node.

    Parameters
    ----------
    force : (n, r) float64
        K R: force at every dof under each rigid motion.
    node : (N,) int64
        Nodes, and scalar points.
    translation, rotation : (N,) float64
        Largest resultant force and moment at each node, over the motions; forces of scalar dofs count as forces.
    relative : (N,) float64
        Largest force at a dof i of each node, relative to sqrt(K_ii) max_j sqrt(K_jj) |R_j|, which bounds each of the
        parts that cancel in it, and of those that cancelled when the matrix was condensed.
    """

    force: Array
    node: NDArray[np.int64]
    translation: Array
    rotation: Array
    relative: Array

    @property
    def worst(self) -> int:
        """Position of the node that is held most, relative to its stiffness."""
        return int(self.relative.argmax())


def grounding(body: FEModel, shapes: Array) -> Grounding:
    """Forces that hold a body against rigid motions, which are a spring to ground or an error in the matrix.

    Parameters
    ----------
    body : FEModel
        Whose stiffness it is.
    shapes : (n, r) float64
        Rigid motions: unit translations and rotations from geometry, or any others.
    """
    force = np.asarray(body.K @ shapes)
    own = np.sqrt(abs(body.K.diagonal()))
    terms = own[:, None] * np.max(own[:, None] * abs(shapes), axis=0, initial=0.0)
    share = np.divide(abs(force), terms, out=np.zeros_like(terms), where=terms > 0).max(axis=1, initial=0.0)
    node, at = np.unique(body.dofs.node, return_inverse=True)
    rotational = body.dofs.component > 3

    def resultant(rows: NDArray[np.bool_]) -> Array:
        squares = np.zeros((node.size, shapes.shape[1]))
        np.add.at(squares, at[rows], force[rows] ** 2)
        return np.asarray(np.sqrt(squares.max(axis=1, initial=0.0)))

    relative = np.zeros(node.size)
    np.maximum.at(relative, at, share)
    return Grounding(force, node, resultant(~rotational), resultant(rotational), relative)
