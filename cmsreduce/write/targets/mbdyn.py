"""MBDyn: the .fem file of a modal joint, in record groups."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import WriteError
from cmsreduce.mechanics import mass_points
from cmsreduce.model import ModalIntegrals
from cmsreduce.write.component import ComponentFile, FlexibleBody, flexible_body
from cmsreduce.write.files import number, put_lines
from cmsreduce.write.targets.nodal import NodalMass, nodal_mass

__all__ = ["MbdynDialect", "write_mbdyn"]

MbdynDialect = Literal["points", "invariants", "lumped", "first-order"]
"""Group 11 of mass points, or of the lumped mass of all nodes, which every version reads; groups 14 to 18 of recent
versions; or groups 9, 10, 12 and 13 alone, which every version reads, for modes without momentum."""

_RIGID = 12  # group whose first row is one number, the mass

Array = NDArray[np.float64]


def write_mbdyn(
    path: Path, component: ComponentFile, integrals: ModalIntegrals, dialect: MbdynDialect = "points"
) -> None:
    """Write the body for MBDyn's modal joint.

    All groups describe the same mass: that of the integrals, or in the dialect ``lumped`` that of the nodal masses. In
    the dialect ``points``, nodes have no mass, and points after them, with numbers above those of all nodes, have the
    integrals of the body: MBDyn 1.7.3 forms its invariants from them without the price of lumping. The slope of a node
    of solid elements is not known and written as zero: attach such a node by its translations only.

    Parameters
    ----------
    path : Path
        Name of the file, which is complete or absent.
    component : ComponentFile
        The body.
    integrals : ModalIntegrals
        Integrals over its modes, about the origin of the modal node.
    dialect : {"points", "invariants", "lumped", "first-order"}
        Record groups that describe the mass.

    Raises
    ------
    WriteError
        If the component file lacks data or deforming modes, the modes have momentum in the dialect ``first-order``, or
        the file cannot be written.
    """
    body = flexible_body(component, integrals, slow=dialect == "first-order")
    if not body.k:
        raise WriteError(
            f"component '{body.name}': it keeps no mode that deforms it, and MBDyn's modal joint needs one; keep more "
            "modes, or make it a `body` of MBDyn with the mass, centre and inertia of its component file"
        )
    if dialect == "points":
        body, groups = _points(body)
    elif dialect == "first-order":
        groups = _first_order(body)
    elif dialect == "invariants":
        groups = _invariants(body)
    else:
        groups = _lumped(body, nodal_mass(component, body))
    put_lines(path, _lines(body, groups))


def _lines(body: FlexibleBody, groups: dict[int, tuple[str, Array]]) -> Iterator[str]:
    yield "** MBDyn MODAL DATA FILE"
    yield f'** NODE SET "ALL" of {body.name}, units {body.units.name}'
    yield ""
    yield "** RECORD GROUP 1, HEADER"
    yield "**   REVISION,  NODE,  NORMAL, ATTACHMENT, CONSTRAINT, REJECTED MODES."
    yield f"  REV0 {body.node.size} {body.k} 0 0 0"
    yield "**"
    yield "** RECORD GROUP 2, FINITE ELEMENT NODE LIST"
    yield " ".join(str(node) for node in body.node)
    yield "**"
    at_rest = np.zeros((1, body.k))
    leading = {
        3: ("INITIAL MODAL DISPLACEMENTS", at_rest),
        4: ("INITIAL MODAL VELOCITIES", at_rest),
        5: ("NODAL X COORDINATES", body.position[:, :1]),
        6: ("NODAL Y COORDINATES", body.position[:, 1:2]),
        7: ("NODAL Z COORDINATES", body.position[:, 2:]),
    }
    yield from _groups(leading)
    yield "** RECORD GROUP 8, MODE SHAPES"
    shapes = np.concatenate([body.translation, body.rotation], axis=1)
    for mode in range(body.k):
        yield f"**    NORMAL MODE SHAPE #  {mode + 1}"
        yield from _rows(shapes[:, :, mode])
    yield "**"
    yield from _groups(groups)


def _groups(groups: dict[int, tuple[str, Array]]) -> Iterator[str]:
    for group, (title, values) in sorted(groups.items()):
        yield f"** RECORD GROUP {group}, {title}"
        if group == _RIGID:
            yield from _rows(values[:1, :1])
            yield from _rows(values[1:])
        else:
            yield from _rows(values)
        yield "**"


def _points(body: FlexibleBody) -> tuple[FlexibleBody, dict[int, tuple[str, Array]]]:
    """The body with points after its nodes, which have all its mass."""
    points = mass_points(body.integrals)
    n, p = body.node.size, points.mass.size
    masses = np.zeros((n + p, 6))
    masses[n:, :3] = points.mass[:, None]
    with_points = replace(
        body,
        node=np.r_[body.node, body.node.max(initial=0) + 1 + np.arange(p)],
        position=np.vstack([body.position, points.position]),
        translation=np.concatenate([body.translation, points.translation]),
        rotation=np.concatenate([body.rotation, np.zeros_like(points.translation)]),
    )
    return with_points, _consistent(body) | {11: ("DIAGONAL OF LUMPED MASS MATRIX", masses)}


def _first_order(body: FlexibleBody) -> dict[int, tuple[str, Array]]:
    """Groups of the consistent mass; without groups 11 and 14 to 18 the modes do not act on the rigid motion."""
    if body.has_momentum:
        raise WriteError(
            f"component '{body.name}': the dialect first-order leaves out the momentum of the modes, and these have "
            "some; write the body about mean axes: `--for mbdyn-1.7.3-first-order`, or "
            "`write: {frame: {kind: mean-axis}}`"
        )
    return _consistent(body)


def _consistent(body: FlexibleBody) -> dict[int, tuple[str, Array]]:
    integrals = body.integrals
    return {
        9: ("MODAL MASS MATRIX", body.mass),
        10: ("MODAL STIFFNESS MATRIX", body.stiffness),
        _RIGID: ("RIGID BODY INERTIA MATRIX", _rigid(integrals.mass, integrals.centre_of_mass, integrals.inertia)),
        13: ("MODAL DAMPING MATRIX", body.damping),
    }


def _invariants(body: FlexibleBody) -> dict[int, tuple[str, Array]]:
    integrals, k = body.integrals, body.k
    # S(a) S(b) = b a^T - (a . b) 1, with S(a) b = a x b.
    eight = np.einsum("iij,ab->ajb", integrals.r_phi, np.eye(3)) - np.transpose(integrals.r_phi, (1, 2, 0))
    nine = np.transpose(integrals.phi_phi, (1, 2, 3, 0)) - np.einsum("iijk,ab->ajkb", integrals.phi_phi, np.eye(3))
    return _consistent(body) | {
        14: ("INVARIANT 3", integrals.phi),
        15: ("INVARIANT 4", integrals.r_cross_phi),
        16: ("INVARIANT 8", eight.reshape(3, 3 * k)),
        17: ("INVARIANT 5", body.phi_cross_phi.reshape(3, k * k)),
        18: ("INVARIANT 9", nine.reshape(3, 3 * k * k)),
    }


def _lumped(body: FlexibleBody, lumps: NodalMass) -> dict[int, tuple[str, Array]]:
    m, J = lumps.mass, lumps.diagonal_inertia
    rigid, _, mass = lumps.modal(body)
    centre = np.array([rigid[5, 1], rigid[3, 2], rigid[4, 0]]) / rigid[0, 0]
    return {
        9: ("MODAL MASS MATRIX", mass),
        10: ("MODAL STIFFNESS MATRIX", body.stiffness),
        11: ("DIAGONAL OF LUMPED MASS MATRIX", np.column_stack([m, m, m, J])),
        _RIGID: ("RIGID BODY INERTIA MATRIX", _rigid(rigid[0, 0], centre, rigid[3:, 3:])),
        13: ("MODAL DAMPING MATRIX", body.damping),
    }


def _rigid(mass: float, centre: Array, inertia: Array) -> Array:
    """Mass, centre of mass, and inertia about it (5, 3), from the inertia about the origin."""
    about_centre = inertia - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    return np.vstack([np.array([mass, 0.0, 0.0]), centre, about_centre])


def _rows(values: Array) -> Iterator[str]:
    for row in values:
        yield " ".join(number(value) for value in row)
