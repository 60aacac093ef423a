"""Modal integrals, geometric stiffness and floating frame in a component file, written and read back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import WriteError
from cmsreduce.mechanics import modal_integrals, modal_stiffening, moves_generalised, rigid_mass
from cmsreduce.model import (
    UNDETERMINED,
    FloatingFrame,
    GeometricStiffness,
    IntegralFrame,
    Lumping,
    ModalComponent,
    ModalIntegrals,
    ModalStiffening,
    OutboardMass,
    SecondOrder,
    UnitLoad,
    rigid_body_shapes,
)
from cmsreduce.write.component.component_file import ComponentFile
from cmsreduce.write.files import put, put_texts

__all__ = [
    "put_augmented",
    "put_frame",
    "put_integrals",
    "put_stiffening",
    "stored_integrals",
    "stored_stiffening",
    "support",
]

_LUMPED: tuple[tuple[Lumping, str], ...] = (("row-sum", "rigid_mass_row_sum"), ("diagonal", "rigid_mass_diagonal"))
_ARRAYS = ("origin", "axes", "first_moment", "inertia", "phi", "r_cross_phi", "modes")
_SECOND_ORDER = ("r_phi", "phi_phi")
_GROUP = "geometric_stiffness"


def put_integrals(group: Any, component: ModalComponent, about: IntegralFrame) -> None:
    """Write rigid mass, momentum of every mode, and the integrals of the deforming modes.

    Parameters
    ----------
    group : h5py.Group
        Group of the integrals.
    component : ModalComponent
        Modes of a body with geometry, relative to the floating frame if there is one.
    about : IntegralFrame
        Frame and mass of the integrals. The rigid mass and the momenta are of the consistent mass, in the basic frame.
    """
    body = component.body
    assert body.nodes is not None
    R = rigid_body_shapes(body.dofs, body.nodes)
    MR = body.M @ R
    rigid, momentum = np.asarray(R.T @ MR), MR.T @ component.Phi
    put(group, "rigid_mass", rigid, "", "R^T M R, 6 x 6, consistent mass, basic frame")
    for lumping, name in () if moves_generalised(body) else _LUMPED:
        lumped = rigid_mass(body, lumping=lumping)
        put(group, name, lumped, "", f"R^T M R of the mass lumped by {lumping}, basic frame")
    put(group, "int_phi", momentum[:3], "", "int phi dm, one column per mode, consistent mass, basic frame")
    put(group, "int_r_x_phi", momentum[3:], "", "int r x phi dm, one column per mode, consistent mass, basic frame")
    group.attrs["about"] = about.about
    group.attrs["lumping"] = about.lumping
    group.attrs["mass_matrix"] = "consistent: as given" if about.lumping == "consistent" else f"lumped: {about.lumping}"
    if rigid.diagonal()[:3].max() <= 0:
        for name, zero in (("mass", 0.0), ("first_moment", np.zeros(3)), ("inertia", rigid[3:, 3:])):
            put(group, name, zero)
        return
    modes = np.arange(component.rigid_count, component.omega.size)
    shapes = component.Phi[:, component.rigid_count :]
    found = modal_integrals(body, shapes, origin=about.origin, axes=about.axes, lumping=about.lumping, modes=modes)
    put(group, "mass", found.mass, "mass")
    put(group, "first_moment", found.first_moment, "mass length", "int r dm from the origin")
    put(group, "inertia", found.inertia, "mass length^2", "int (r.r 1 - r r^T) dm about the origin")
    put(group, "origin", found.origin, "length", "of the frame of the integrals, in basic")
    put(group, "axes", found.axes, "", "of that frame as rows, in basic")
    put(group, "modes", found.modes, "", "columns of the shapes that phi stands for below: elastic and static modes")
    put(group, "phi", found.phi, "", "int phi dm")
    put(group, "r_cross_phi", found.r_cross_phi, "", "int r x phi dm")
    if found.second_order is None:
        group.attrs["undetermined"] = UNDETERMINED
        return
    put(group, "r_phi", found.r_phi, "", "int r_i phi_j dm, entry [i, j, mode]")
    put(group, "phi_phi", found.phi_phi, "", "int phi_i phi_j dm, entry [i, j, a, b] of modes a and b")


def stored_integrals(component: ComponentFile) -> ModalIntegrals:
    """Modal integrals of a component file.

    Raises
    ------
    WriteError
        If it has none, or is of an early version without integrals of second order.
    """
    arrays = component.arrays
    whole = "undetermined" not in component.attributes.get("integrals", {})
    needed = ("mass", *_ARRAYS, *(_SECOND_ORDER if whole else ()))
    missing = [name for name in needed if f"integrals/{name}" not in arrays]
    if missing:
        raise WriteError(
            f"component '{component.name}': its file has no modal integrals (integrals/{missing[0]} is missing). A "
            "body without geometry has none; write a file of an earlier version again with `cmsreduce run`"
        )
    return ModalIntegrals(
        mass=float(arrays["integrals/mass"]),
        lumping=cast(Lumping, str(component.attributes["integrals"].get("lumping", "consistent"))),
        **{name: np.asarray(arrays[f"integrals/{name}"]) for name in _ARRAYS},
        second_order=SecondOrder(*(arrays[f"integrals/{name}"] for name in _SECOND_ORDER)) if whole else None,
    )


def put_stiffening(group: Any, stiffening: GeometricStiffness, Phi: NDArray[np.float64]) -> None:
    """Write the geometric stiffness of a body in its modes Phi (n, m)."""
    reduced = modal_stiffening(stiffening, Phi)
    group.attrs["axes"] = "basic frame of the body"
    group.attrs["held"] = stiffening.held
    put_texts(group, "load", [load.label for load in reduced.loads], about="unit load of each matrix")
    put_texts(group, "source", stiffening.sources, about="where each comes from")
    put(group, "origin", reduced.origin, "length", "reference point of accelerations and rotations, in basic")
    put(group, "K", reduced.K, "", "Phi^T K_l Phi per unit of load l: the stiffness is K + sum of load times K_l")


def stored_stiffening(component: ComponentFile) -> ModalStiffening | None:
    """Geometric stiffness of a component file; None where it has none."""
    if f"{_GROUP}/K" not in component.arrays:
        return None
    return ModalStiffening(
        tuple(UnitLoad.parse(text) for text in component.texts[f"{_GROUP}/load"]),
        component.arrays[f"{_GROUP}/K"],
        component.arrays[f"{_GROUP}/origin"],
    )


def put_frame(group: Any, frame: FloatingFrame | None) -> None:
    """Write the floating frame: its condition, its place, and the rigid motion removed from the deforming modes."""
    group.attrs["kind"] = "none" if frame is None else frame.condition.kind
    if frame is None:
        return
    condition = frame.condition
    for name, text in (("at", condition.at), ("to", condition.to), ("roll", condition.roll)):
        if text:
            group.attrs[name] = text
    group.attrs["residual"] = frame.residual
    put(group, "origin", frame.origin, "length", "of the floating frame in the body at rest, in basic")
    put(group, "axes", frame.axes, "", "of the floating frame as rows, in basic")
    put(group, "node", frame.node, "", "nodes of the condition; none for mean axes")
    put(group, "component", frame.component.astype(np.int8), "", "1..3 translations, 4..6 rotations of each")
    put(group, "removed", frame.removed, "", "amounts of the rigid modes removed from each deforming mode")


def put_augmented(group: Any, masses: Sequence[OutboardMass]) -> None:
    """Write the rigid mass of all bodies outboard of each interface, about the interface, along basic axes."""
    for outboard in masses:
        own = group.create_group(outboard.interface)
        put(own, "point", outboard.point, "length", "first node of the interface, in basic: reference point")
        put(own, "mass", outboard.mass, "mass")
        put(own, "first_moment", outboard.first_moment, "mass length", "int r dm from the point, basic axes")
        put(own, "inertia", outboard.inertia, "mass length^2", "int (r.r 1 - r r^T) dm about the point")
        put(own, "rigid_mass", outboard.rigid_mass, "", "of translations and rotations, 6 x 6")
        put_texts(own, "bodies", outboard.bodies, "bodies outboard of the interface")


def support(component: ModalComponent, frame: FloatingFrame | None) -> str:
    """Support of the body in its modes, in words; a floating-frame code adds the rigid motion itself."""
    if not component.rigid_count:
        return "held: no rigid motion is left in the modes"
    rigid = f"floating: the first {component.rigid_count} modes are its rigid motions"
    if frame is None:
        return rigid
    dofs: dict[int, str] = {}
    for node, part in zip(frame.node.tolist(), frame.component.tolist(), strict=True):
        dofs[node] = dofs.get(node, "") + str(part)
    at = ", ".join(f"{node} {parts}" for node, parts in dofs.items())
    return f"{rigid}; the others are seen from a frame by {frame.condition}{f' (nodes and dofs {at})' if at else ''}"
