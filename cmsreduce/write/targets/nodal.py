"""DISCOS and DADS: tables of nodal masses, inertias, coordinates and shapes as text."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import WriteError
from cmsreduce.model import ModalIntegrals, cross_matrix
from cmsreduce.write.component import ComponentFile, FlexibleBody, flexible_body
from cmsreduce.write.files import put_lines, table

__all__ = ["NodalMass", "nodal_mass", "write_nodal"]

# Relative to the mass of the body: lumping conserves it to round-off, unless nodes are missing in the file.
_COMPLETE = 1e-9

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class NodalMass:
    """Mass lumped at the nodes of a body.

    Parameters
    ----------
    mass : (n,) float64
        Mass of each node, the same in every direction.
    inertia : (n, 3, 3) float64
        Inertia of each node about itself, along the axes of the body's frame.
    """

    mass: Array
    inertia: Array

    @property
    def diagonal_inertia(self) -> Array:
        """Moments of inertia of each node, without its products (n, 3)."""
        return np.asarray(np.einsum("nii->ni", self.inertia))

    def modal(self, body: FlexibleBody) -> tuple[Array, Array, Array]:
        """Mass of translations and rotations (6, 6), momenta of the modes (6, k), and modal mass (k, k).

        Of the lumps without products of inertia, about the origin of the body's frame.
        """
        m, J, x = self.mass, self.diagonal_inertia, body.position
        arm = -cross_matrix(x)
        rigid = np.block(
            [[np.tile(np.eye(3), (m.size, 1, 1)), arm], [np.zeros_like(arm), np.tile(np.eye(3), (m.size, 1, 1))]]
        )
        shapes = np.concatenate([rigid, np.concatenate([body.translation, body.rotation], axis=1)], axis=2)
        inertia = np.column_stack([m, m, m, J])
        total = np.einsum("ni,nia,nib->ab", inertia, shapes, shapes, optimize=True)
        total = (total + total.T) / 2
        return total[:6, :6], total[:6, 6:], total[6:, 6:]


def nodal_mass(component: ComponentFile, body: FlexibleBody) -> NodalMass:
    """Lumped mass of every node, from ``nodes/lumped_mass`` and ``nodes/lumped_inertia`` of a component file.

    Raises
    ------
    WriteError
        If the file has none, or lacks nodes with mass.
    """
    arrays, remedy = component.arrays, "write the component file with `write: {all_nodes: true}`"
    if "nodes/lumped_mass" not in arrays:
        raise WriteError(f"component '{body.name}': its file has no nodal masses; {remedy}")
    mass = arrays["nodes/lumped_mass"]
    total = body.integrals.mass
    if abs(mass.sum() - total) > _COMPLETE * total:
        raise WriteError(
            f"component '{body.name}': the nodes in its file have {mass.sum():.6g} of its mass of {total:.6g}; {remedy}"
        )
    axes = body.integrals.axes
    return NodalMass(mass, np.einsum("ij,njk,lk->nil", axes, arrays["nodes/lumped_inertia"], axes))


def write_nodal(path: Path, component: ComponentFile, integrals: ModalIntegrals) -> None:
    """Write the tables from which DISCOS and DADS compute the integrals themselves.

    Blocks of numbers separated by blanks, each under a line ``$ NAME rows columns: meaning``. The modal mass in the
    file belongs to the lumped mass, too, because a code that reads both needs the same mass in both.

    Parameters
    ----------
    path : Path
        Name of the file, which is complete or absent.
    component : ComponentFile
        The body, with every node.
    integrals : ModalIntegrals
        Their frame is that of the tables.

    Raises
    ------
    WriteError
        If the component file lacks data, or the file cannot be written.
    """
    body = flexible_body(component, integrals)
    put_lines(path, _lines(body, nodal_mass(component, body)))


def _lines(body: FlexibleBody, lumps: NodalMass) -> Iterator[str]:
    yield f"$ NODAL DATA of {body.name}: {body.node.size} nodes, {body.k} modes, units {body.units.name}"
    yield from table("NODES", body.node[:, None], "node ids")
    yield from table("COORDINATES", body.position, "x y z of each node from the origin of the body frame")
    yield from table("MASSES", lumps.mass[:, None], "lumped mass of each node")
    rows = lumps.inertia.reshape(-1, 9)[:, [0, 4, 8, 1, 2, 5]]
    yield from table("INERTIAS", rows, "tensor of each node about itself: xx yy zz xy xz yz")
    shapes = np.concatenate([body.translation, body.rotation], axis=1)
    for mode in range(body.k):
        about = "translations x y z and rotations x y z of each node; rotations of solid nodes are not known and 0"
        yield from table(f"SHAPE {mode + 1}", shapes[:, :, mode], about)
    mass = np.einsum("n,nia,nib->ab", lumps.mass, body.translation, body.translation)
    mass = mass + np.einsum("nia,nij,njb->ab", body.rotation, lumps.inertia, body.rotation)
    yield from table("MODAL MASS", mass, "of the lumped mass")
    yield from table("MODAL STIFFNESS", body.stiffness)
    yield from table("MODAL DAMPING", body.damping, "viscous")
    yield "$ END"
