"""Prices of formats that describe a body by less than its file holds, computed from the body."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.mechanics import rigid_mass_matrix
from cmsreduce.model import ModalIntegrals
from cmsreduce.write.component import ComponentFile, FlexibleBody, flexible_body
from cmsreduce.write.targets.nodal import nodal_mass
from cmsreduce.write.targets.radioss import left_out

__all__ = ["lumped_price", "price_of", "spin_price"]

_SHOWN = 6  # frequencies in a message
_ONE_PERCENT = 0.01
_SIX = 6

_UNDAMPED = (
    "Exudyn's file has no place for modal damping, so that the body vibrates without; give it to the object in Exudyn, "
    "or export the scene, which does"
)

Array = NDArray[np.float64]


def price_of(
    component: ComponentFile, integrals: ModalIntegrals | None, target: str, dialect: str | None
) -> tuple[str, ...]:
    """Prices of a target in a dialect, in words; none where the file holds the body as it is."""
    if target == "radioss":
        return (left_out(component),)
    if integrals is None:
        return ()
    if target == "exudyn" and component.arrays["modes/damping"].any():
        return (f"{component.name}: {_UNDAMPED}",)
    if target in ("discos", "dads") or (target, dialect) == ("mbdyn", "lumped"):
        return (lumped_price(component, integrals),)
    if (target, dialect) == ("mbdyn", "first-order"):
        return (spin_price(flexible_body(component, integrals, slow=True)),)
    return ()


def lumped_price(component: ComponentFile, integrals: ModalIntegrals) -> str:
    """Change of the first natural frequencies by lumping the mass at the nodes, in words.

    They are those of the free body, or of the body as it is held.
    """
    body = flexible_body(component, integrals)
    rigid, momenta, mass = nodal_mass(component, body).modal(body)
    consistent = np.vstack([integrals.phi, integrals.r_cross_phi])
    if component.rigid_count == _SIX:
        own = _frequencies(body, _without_momentum(rigid_mass_matrix(integrals), consistent, body.mass))
        changed = _frequencies(body, _without_momentum(rigid, momenta, mass))
    else:
        own, changed = _frequencies(body, body.mass), _frequencies(body, mass)
    shown = min(_SHOWN, own.size)
    by = ", ".join(f"{value:+.1f}" for value in 100 * (changed / own - 1)[:shown])
    return f"{body.name}: its mass is lumped at the nodes, which changes the first {shown} frequencies by {by} %"


def spin_price(body: FlexibleBody) -> str:
    """Angular velocity at which a file without integrals of second order leaves out 1 % of a modal stiffness, in words.

    Left out are the forces by squares of angular velocities w; those that grow with the deformation are
    int phi_a . (w w^T - w.w 1) phi_b dm.
    """
    missing = "forces by squares of angular velocities, Coriolis forces and the change of inertia with the deformation"
    P = body.integrals.phi_phi
    stiff = np.diagonal(body.stiffness) > 0
    if not P.any() or not stiff.any():
        return f"{body.name}: the file leaves out {missing}"
    K, largest = body.stiffness[np.ix_(stiff, stiff)], 0.0
    for axis in np.eye(3):
        C = np.einsum("ij,ijab->ab", np.eye(3) - np.outer(axis, axis), P)[np.ix_(stiff, stiff)]
        largest = max(largest, float(la.eigh((C + C.T) / 2, K, eigvals_only=True)[-1]))
    return (
        f"{body.name}: the file leaves out {missing}; at {np.sqrt(_ONE_PERCENT / largest):.3g} rad per unit of time "
        "they are 1 % of a modal stiffness, and they grow with the square"
    )


def _without_momentum(rigid: Array, momenta: Array, mass: Array) -> Array:
    """Modal mass (k, k) of a body that floats freely: its rigid motion is that without momentum."""
    return np.asarray(mass - momenta.T @ la.solve(rigid, momenta, assume_a="sym"))


def _frequencies(body: FlexibleBody, mass: Array) -> Array:
    """Natural frequencies (k,) of the modes that have one; infinite where lumps leave no mass."""
    moving = ~np.isnan(body.omega)
    square = np.ix_(moving, moving)
    # The stiffness is positive definite; the lumped mass need not be.
    slowness = la.eigh((mass + mass.T)[square] / 2, body.stiffness[square], eigvals_only=True)[::-1]
    with np.errstate(divide="ignore"):
        return np.asarray(1 / np.sqrt(np.maximum(slowness, 0.0)))
