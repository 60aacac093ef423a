"""A body of a few particles that turn as well as move, whose integrals are sums that anyone can write down."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cmsreduce.model import ModalIntegrals, SecondOrder
from cmsreduce.write import ComponentFile

__all__ = ["FORMATS", "Particles", "particles"]

FORMATS = Path(__file__).parents[3] / "shared" / "data" / "formats"
"""Files that the programs of the targets accept."""


@dataclass(frozen=True, eq=False)
class Particles:
    """Nodes that carry rigid lumps of six particles each, along the axes of the body's frame.

    Of the particles: m (42,), x (42, 3), u (42, 3, k), masses, places and modes. Of the nodes: ``node_m`` (7,),
    ``node_J`` (7, 3, 3), ``node_x`` (7, 3), ``node_u`` and ``node_v`` (7, 3, k), translations and rotations.
    """

    m: np.ndarray
    x: np.ndarray
    u: np.ndarray
    node_m: np.ndarray
    node_J: np.ndarray
    node_x: np.ndarray
    node_u: np.ndarray
    node_v: np.ndarray
    omega: np.ndarray
    file: ComponentFile
    integrals: ModalIntegrals


def particles(size: float = 0.3, *, blind: bool = False, static: bool = False, still: bool = False) -> Particles:
    """Seven nodes and four modes, held by nothing but their springs.

    ``size`` scales the lumps: without any, nodes have mass but no inertia of their own; ``blind`` leaves the slope of
    one unknown, whose lump is a point; ``static`` makes the last mode one without mass: the rotation of such a point;
    ``still`` takes the momentum out of the modes (mean axes).
    """
    rng = np.random.default_rng(7)
    n, k = 7, 4
    node_m, xyz = rng.uniform(0.5, 2.0, n), rng.normal(size=(n, 3))
    half = size * rng.normal(size=(n, 3, 3))
    shapes = rng.normal(size=(n, 6, k))
    if static:
        half[3], shapes[:, :, -1], shapes[3, 3:, -1] = 0.0, 0.0, [0.1, 0.2, 0.3]
    if blind:
        half[2], shapes[2, 3:] = 0.0, 0.0
    # Two particles on either end of three lines through each node.
    arms = np.concatenate([half, -half], axis=1)
    m = np.repeat(node_m / 6, 6)
    node_J = np.einsum("n,nqij->nij", node_m / 6, [[r @ r * np.eye(3) - np.outer(r, r) for r in arm] for arm in arms])
    node_u, node_v = shapes[:, :3], shapes[:, 3:]
    if still:
        lumps = xyz[:, None] + arms
        rigid, weight = _rigid(lumps.reshape(-1, 3)), np.repeat(m, 3)[:, None]
        moved = (node_u[:, None] + np.cross(node_v[:, None], arms[..., None], axis=2)).reshape(-1, k)
        carried = np.linalg.solve(rigid.T @ (weight * rigid), rigid.T @ (weight * moved))
        node_u, node_v = node_u - (_rigid(xyz) @ carried).reshape(n, 3, k), node_v - carried[3:]
    u = (node_u[:, None] + np.cross(node_v[:, None], arms[..., None], axis=2)).reshape(-1, 3, k)
    moving = slice(0, k - 1) if static else slice(0, k)
    M = np.einsum("n,nia,nib->ab", m, u, u)
    to_unit = np.eye(k)
    to_unit[moving, moving] = np.linalg.inv(np.linalg.cholesky(M[moving, moving])).T
    node_u, node_v, u = node_u @ to_unit, node_v @ to_unit, u @ to_unit
    omega = np.array([3.0, 11.0, 40.0, np.nan if static else 90.0])
    rotation = node_v.copy()
    if blind:
        rotation[2] = np.nan
    arrays = {
        "modes/omega": omega,
        "modes/mass": np.diag(np.where(np.isnan(omega), 0.0, 1.0)),
        "modes/stiffness": np.diag(np.where(np.isnan(omega), 1.0, omega**2)),
        "modes/damping": np.diag(np.nan_to_num(0.02 * omega)),
        "nodes/id": np.array([2, 3, 5, 8, 13, 21, 34]),
        "nodes/xyz": xyz,
        "nodes/frame": np.tile(np.eye(3), (n, 1, 1)),
        "nodes/translation": node_u,
        "nodes/rotation": rotation,
        "nodes/lumped_mass": node_m,
        "nodes/lumped_inertia": node_J,
    }
    for name, node, row in (("root", 3, 1), ("tip", 34, 6)):
        arrays[f"interfaces/{name}/node"] = np.repeat(node, 6)
        arrays[f"interfaces/{name}/component"] = np.arange(1, 7)
        arrays[f"interfaces/{name}/shapes"] = np.vstack([node_u[row], node_v[row]])
    metres = {"name": "m-kg-s", "length_in_si": 1.0, "mass_in_si": 1.0, "time_in_si": 1.0}
    attributes = {"": {"name": "cloud"}, "units": metres}
    file = ComponentFile("cloud", "none", 0, int(static), arrays, {}, attributes, ())
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    axes *= np.linalg.det(axes)
    origin = np.array([0.3, -0.2, 0.5])
    node_x = (xyz - origin) @ axes.T
    x, u = (node_x[:, None] + arms @ axes.T).reshape(-1, 3), axes @ u
    squares = np.einsum("n,ni,nj->ij", m, x, x)
    integrals = ModalIntegrals(
        origin=origin,
        axes=axes,
        lumping="consistent",
        mass=m.sum(),
        first_moment=m @ x,
        inertia=np.trace(squares) * np.eye(3) - squares,
        phi=np.einsum("n,nia->ia", m, u),
        r_cross_phi=np.einsum("n,nia->ia", m, np.cross(x[:, :, None], u, axis=1)),
        modes=np.arange(k),
        second_order=SecondOrder(np.einsum("n,ni,nja->ija", m, x, u), np.einsum("n,nia,njb->ijab", m, u, u)),
    )
    node_J = axes @ node_J @ axes.T
    return Particles(m, x, u, node_m, node_J, node_x, axes @ node_u, axes @ node_v, omega, file, integrals)


def _rigid(places: np.ndarray) -> np.ndarray:
    """Translations and rotations about the origin of places (n, 3), as columns (3 n, 6)."""
    turns = np.cross(np.eye(3), places[:, None], axisa=1, axisb=2).swapaxes(1, 2)
    return np.concatenate([np.tile(np.eye(3), (len(places), 1, 1)), turns], axis=2).reshape(-1, 6)
