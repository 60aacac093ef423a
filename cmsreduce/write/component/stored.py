"""The modal integrals that a component file holds.

The geometric stiffness that a component file holds, and as a floating-frame code takes it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import WriteError
from cmsreduce.model import INERTIA_LOADS, SQUARES, Lumping, ModalIntegrals, ModalStiffening, UnitLoad
from cmsreduce.write.component.component_file import ComponentFile

__all__ = [
    "FrameStiffening",
    "frame_stiffening",
    "stored_integrals",
]

_ARRAYS = ("origin", "axes", "first_moment", "inertia", "phi", "r_cross_phi", "r_phi", "phi_phi", "modes")


def stored_integrals(component: ComponentFile) -> ModalIntegrals:
    """Modal integrals of a component file.

    Raises
    ------
    WriteError
        If it has none, or was written before there were any of second order.
    """
    arrays = component.arrays
    missing = [name for name in ("mass", *_ARRAYS) if f"integrals/{name}" not in arrays]
    if missing:
        raise WriteError(
            f"component '{component.name}': its file has no modal integrals (integrals/{missing[0]} is missing); a "
            "body without geometry has none, and a file of an earlier version is written again with `cmsreduce run`"
        )
    return ModalIntegrals(
        mass=float(arrays["integrals/mass"]),
        lumping=cast(Lumping, str(component.attributes["integrals"].get("lumping", "consistent"))),
        **{name: np.asarray(arrays[f"integrals/{name}"]) for name in _ARRAYS},
    )


# Of a length of one and of a direction: a frame that was meant to be the same is off by round-off of its axes.
_SAME_FRAME = 1e-12
_GROUP = "geometric_stiffness"
_PAIRS = tuple(("xyz".index(axes[0]), "xyz".index(axes[1])) for axes in SQUARES)

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FrameStiffening:
    """Stiffness of k deforming modes per unit load, along the axes and about the origin of the frame of the integrals.

    Parameters
    ----------
    acceleration, turning : (3, k, k) float64
        Per unit acceleration and angular acceleration of the frame.
    spinning : (6, k, k) float64
        Per product xx yy zz xy yz xz of its angular velocities.
    force, moment : mapping of node to (3, k, k) float64
        Per unit force and moment at a node.
    """

    acceleration: Array
    turning: Array
    spinning: Array
    force: Mapping[int, Array]
    moment: Mapping[int, Array]


def stored_stiffening(component: ComponentFile) -> ModalStiffening | None:
    """Geometric stiffness of a component file; None where it has none."""
    if f"{_GROUP}/K" not in component.arrays:
        return None
    return ModalStiffening(
        tuple(UnitLoad.parse(text) for text in component.texts[f"{_GROUP}/load"]),
        component.arrays[f"{_GROUP}/K"],
        component.arrays[f"{_GROUP}/origin"],
    )


def frame_stiffening(component: ComponentFile, integrals: ModalIntegrals) -> FrameStiffening | None:
    """Geometric stiffness of the deforming modes, about the frame of the integrals; None where the file has none.

    A term that the file lacks is zero here.

    Raises
    ------
    WriteError
        If the frame is another than that of the stored terms, and not all twelve inertia loads are there to restate
        them with.

    Notes
    -----
    With d from the stored origin to that of the frame, an angular acceleration a about the frame's origin is one about
    the stored origin and an acceleration - a x d; a spin w is one about the stored origin and - W d, W = w w^T - w.w 1.
    """
    stored = stored_stiffening(component)
    if stored is None:
        return None
    k = integrals.modes.size
    square = np.ix_(np.arange(len(stored.loads)), integrals.modes, integrals.modes)
    deforming = ModalStiffening(stored.loads, stored.K[square], stored.origin)
    A, d = integrals.axes, integrals.origin - stored.origin
    same = max(float(abs(A - np.eye(3)).max()), float(abs(d).max())) <= _SAME_FRAME
    lacking = [load.label for load in INERTIA_LOADS if deforming.of(load.label) is None]
    if not same and 0 < len(lacking) < len(INERTIA_LOADS):
        raise WriteError(
            f"component '{component.name}': its geometric stiffness is along the basic axes about {stored.origin}, and "
            f"its integrals are in another frame; to restate it, all twelve loads of a moving frame are needed, and "
            f"'{lacking[0]}' is not there: ask for all of them, or for integrals in the frame of the stiffness"
        )

    def of(kind: str, axes: tuple[str, ...]) -> Array:
        found = [deforming.of(f"{kind} {axis}") for axis in axes]
        return np.array([np.zeros((k, k)) if K is None else K for K in found])

    xyz = ("x", "y", "z")
    pull, turn, spin = of("acceleration", xyz), of("angular acceleration", xyz), of("centrifugal", SQUARES)
    products = [np.outer(A[i], A[j]) if i == j else np.outer(A[i], A[j]) + np.outer(A[j], A[i]) for i, j in _PAIRS]
    share = np.array([[S[a, b] for a, b in _PAIRS] for S in products])
    offset = np.array([(S - np.trace(S) * np.eye(3)) @ d for S in products])
    points: dict[str, dict[int, Array]] = {"force": {}, "moment": {}}
    for load in stored.loads:
        if load.at:
            node, axes = int(load.at), tuple(f"{load.at}.{axis}" for axis in xyz)
            points[load.kind][node] = np.einsum("ij,jab->iab", A, of(load.kind, axes))
    return FrameStiffening(
        acceleration=np.einsum("ij,jab->iab", A, pull),
        turning=np.einsum("ij,jab->iab", A, turn) - np.einsum("ij,jab->iab", np.cross(A, d), pull),
        spinning=np.einsum("ij,jab->iab", share, spin) - np.einsum("ij,jab->iab", offset, pull),
        force=points["force"],
        moment=points["moment"],
    )
