"""A component file seen from another floating frame, from its own data alone (theory section 8)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.errors import WriteError
from cmsreduce.mechanics import (
    fitted_motion,
    integrals_about,
    mean_axis_motion,
    of_combined_modes,
    without_rigid_motion,
)
from cmsreduce.model import DofTable, FrameCondition, ModalIntegrals, Nodes, rigid_body_shapes
from cmsreduce.write.component.component_file import ComponentFile
from cmsreduce.write.component.integrals import stored_integrals

__all__ = ["in_frame", "with_unit_modal_mass"]

_SIX = 6
_ROWS = ("nodes/translation", "nodes/rotation", "dofs/shapes", "outputs/C1", "outputs/C2")
_MOMENTA = ("integrals/int_phi", "integrals/int_r_x_phi")
_FORMS = (
    *("modes/mass", "modes/stiffness", "modes/damping", "modes/gyroscopic", "modes/loss"),
    "geometric_stiffness/K",
)
"""Datasets that a change of the modes acts on: their columns, and both sides of quadratic forms."""
_OF_ONE_MODE = ("modes/source_hz", "modes/sigma", "modes/spacing", "modes/kind", "modes/why")

Array = NDArray[np.float64]


def in_frame(component: ComponentFile, condition: FrameCondition) -> ComponentFile:
    """The same body with its deforming modes relative to another floating frame.

    Parameters
    ----------
    component : ComponentFile
        A free body: six rigid modes.
    condition : FrameCondition
        ``mean-axis``: modes without momentum, about the centre of mass. ``clamped``: modes that do not move the
        interface ``at``, about its first node.

    Returns
    -------
    ComponentFile
        In memory. Shapes, modal matrices, inputs, outputs and integrals are those of the modes in the frame, as
        `write_component` writes them. The axes stay those of the integrals.

    Raises
    ------
    WriteError
        If the body has no integrals, is held to the ground, or lacks the interface, or if the condition leaves a rigid
        motion free.

    Notes
    -----
    A mode becomes phi - u, u a rigid motion: that of the interface (clamped), or the one with the mode's momentum (mean
    axes). u is a combination Phi_r d of the rigid modes, d = (R^T M Phi_r)^T u, because these are orthonormal.
    """
    _check_free(component, condition)
    integrals = stored_integrals(component)
    if condition.kind == "mean-axis":
        integrals = integrals_about(integrals, integrals.origin + integrals.axes.T @ integrals.centre_of_mass)
        motion = mean_axis_motion(integrals)
    else:
        basic, origin = _interface_motion(component, condition, integrals.modes)
        integrals = integrals_about(integrals, origin)
        motion = np.vstack([integrals.axes @ basic[:3], integrals.axes @ basic[3:]])
    A, o, free = integrals.axes, integrals.origin, slice(0, _SIX)
    momentum = component.arrays["integrals/int_phi"][:, free]
    turning = component.arrays["integrals/int_r_x_phi"][:, free] - np.cross(o, momentum, axisb=0, axisc=0)
    T = np.eye(component.omega.size)
    T[free, _SIX:] = -np.vstack([A @ momentum, A @ turning]).T @ motion
    changed = _changed(component, T, without_rigid_motion(integrals, motion))
    place = {"frame/origin": integrals.origin, "frame/axes": A}
    arrays = {name: value for name, value in changed.arrays.items() if not name.startswith("frame/")}
    frame = {"kind": condition.kind} | ({"at": condition.at} if condition.at else {})
    support = f"floating: the first {_SIX} modes are its rigid motions; the others are seen from a frame by {condition}"
    attributes: dict[str, Mapping[str, Any]] = {
        **changed.attributes,
        "": {**changed.attributes[""], "support": support},
        "frame": frame,
        "integrals": {**changed.attributes["integrals"], "about": f"floating frame, {condition}"},
    }
    return replace(changed, arrays=arrays | place, attributes=attributes)


def with_unit_modal_mass(component: ComponentFile) -> ComponentFile:
    """The same body with its deforming modes combined: orthogonal, each with the modal mass 1 (in memory).

    They are the natural vibrations of the body whose frame does not move. What belonged to one mode before, such as its
    influence coefficient, is left out.

    Raises
    ------
    WriteError
        If modes have no mass, or the body has no integrals.
    """
    if component.static_count:
        raise WriteError(
            f"component '{component.name}': {component.static_count} static modes have no mass, so they have no unit "
            "modal mass; leave `residuals` out of `reduce`, or give their nodes some inertia"
        )
    integrals = stored_integrals(component)
    square = np.ix_(integrals.modes, integrals.modes)
    mass = component.arrays["modes/mass"][square]
    if integrals.lumping != "consistent" and integrals.second_order is not None:
        mass = np.einsum("iiab->ab", integrals.phi_phi)
    stiffness = component.arrays["modes/stiffness"][square]
    lam, X = la.eigh((stiffness + stiffness.T) / 2, (mass + mass.T) / 2)
    # The sign that keeps a mode as it was, where it was of unit mass before.
    X = X * np.where(np.diagonal(X) < 0, -1.0, 1.0)
    T = np.eye(component.omega.size)
    T[square] = X
    changed = _changed(component, T, of_combined_modes(integrals, X))
    arrays = {name: value for name, value in changed.arrays.items() if name not in _OF_ONE_MODE}
    arrays = {name: value for name, value in arrays.items() if not name.startswith("modes/rankings/")}
    for name, exact in (("modes/mass", np.eye(lam.size)), ("modes/stiffness", np.diag(lam))):
        arrays[name] = arrays[name].copy()
        arrays[name][square] = exact
    omega, zeta = component.omega.copy(), np.zeros(component.omega.size)
    omega[integrals.modes] = np.sqrt(np.maximum(lam, 0.0))
    moving = omega > 0
    zeta[moving] = np.diagonal(arrays["modes/damping"])[moving] / (2 * omega[moving])
    arrays |= {"modes/omega": omega, "modes/frequency_hz": omega / (2 * np.pi), "modes/zeta": zeta}
    texts = {name: value for name, value in changed.texts.items() if name not in _OF_ONE_MODE}
    return replace(changed, arrays=arrays, texts=texts)


def _changed(component: ComponentFile, T: Array, integrals: ModalIntegrals) -> ComponentFile:
    """The body with the modes Phi T, whose integrals are given."""
    arrays = dict(component.arrays)
    for name, value in component.arrays.items():
        if name in (*_ROWS, *_MOMENTA) or (name.startswith("interfaces/") and name.endswith("/shapes")):
            arrays[name] = value @ T
        elif name in _FORMS:
            arrays[name] = T.T @ value @ T
        elif name == "inputs/B":
            arrays[name] = T.T @ value
    for name in ("origin", "axes", "first_moment", "inertia", "phi", "r_cross_phi"):
        arrays[f"integrals/{name}"] = getattr(integrals, name)
    if integrals.second_order is not None:
        arrays |= {"integrals/r_phi": integrals.r_phi, "integrals/phi_phi": integrals.phi_phi}
    return replace(component, arrays=arrays)


def _interface_motion(
    component: ComponentFile, condition: FrameCondition, modes: NDArray[np.int64]
) -> tuple[Array, Array]:
    """Rigid motion of the interface in each mode (6, k), along basic axes about its first node, and that node."""
    arrays, face = component.arrays, f"interfaces/{condition.at}"
    if f"{face}/node" not in arrays:
        known = ", ".join(component.interfaces) or "none"
        raise WriteError(
            f"component '{component.name}' has no interface '{condition.at}' for its frame (it has: {known})"
        )
    nodes = Nodes(arrays["nodes/id"], arrays["nodes/xyz"], arrays["nodes/frame"])
    dofs, position = DofTable(arrays[f"{face}/node"], arrays[f"{face}/component"]), arrays[f"{face}/position"]
    fit = fitted_motion(dofs, nodes, position)
    determined = round(np.trace(fit @ rigid_body_shapes(dofs, nodes, position[0])))
    if determined < _SIX:
        raise WriteError(
            f"component '{component.name}': a frame {condition} determines {determined} of six rigid motions; clamp it "
            "at an interface with rotations or with three nodes that are not in line"
        )
    return fit @ arrays[f"{face}/shapes"][:, modes], position[0]


def _check_free(component: ComponentFile, condition: FrameCondition) -> None:
    if component.rigid_count != _SIX:
        held = (
            "it is held to the ground, or moves in a plane" if component.rigid_count < _SIX else "it holds a mechanism"
        )
        raise WriteError(
            f"component '{component.name}': a frame by {condition} needs six rigid motions, and this body has "
            f"{component.rigid_count}: {held}. Give the matrices of the free body"
        )
