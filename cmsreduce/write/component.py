"""The component file: a reduced body as a multibody code takes it (docs/component-file.md)."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.linalg.integrator_steps import INTEGRATORS, step_limit
from cmsreduce.linalg.modal_integrals import modal_integrals
from cmsreduce.model import Check, FEModel, Interface, ModalComponent, rigid_body_shapes
from cmsreduce.write.datasets import hdf5_file, put, put_texts, put_units
from cmsreduce.write.nodal_mass import lumps_of_nodes
from cmsreduce.write.shapes import basic_shapes

__all__ = ["FORMAT", "FORMAT_VERSION", "write_component"]

FORMAT = "cmsreduce-component"
FORMAT_VERSION = 2

Row = NDArray[np.float64]


def write_component(
    path: Path,
    component: ModalComponent,
    *,
    nodes: Sequence[int],
    inputs: Mapping[str, Row],
    outputs: Mapping[str, tuple[Row, Row]],
    checks: Sequence[Check],
    provenance: Mapping[str, Any],
    all_nodes: bool = False,
) -> None:
    """Write a component file.

    Parameters
    ----------
    path : Path
        Where; the file is whole or not there.
    component : ModalComponent
        Modes that were kept.
    nodes : sequence of int
        Nodes whose shapes are written, besides those of the interfaces.
    inputs : mapping of name to (m,) float64
        Modal force of a unit effort of each actuator.
    outputs : mapping of name to ((m,), (m,)) float64
        Displacement and rate row of each sensor.
    checks : sequence of Check
        What the body was checked for.
    provenance : mapping
        ``settings`` and ``notes`` of the run, and anything else that is JSON.
    all_nodes : bool
        Write the shapes at every node.

    Raises
    ------
    WriteError
        If the file cannot be written.
    """
    body = component.body
    with hdf5_file(path) as file:
        file.attrs["format"] = FORMAT
        file.attrs["format_version"] = FORMAT_VERSION
        file.attrs["name"] = component.name
        file.attrs["method"] = component.method
        file.attrs["frame"] = "basic frame of the body"
        file.attrs["support"] = _support(component)
        file.attrs["created_utc"] = datetime.now(UTC).isoformat(timespec="seconds")
        _provenance(file.create_group("provenance"), body, provenance)
        put_units(file.create_group("units"), body.units)
        _modes(file.create_group("modes"), component)
        chosen = _chosen(body, nodes, all_nodes)
        _dofs(file.create_group("dofs"), component, chosen)
        if body.nodes is not None:
            _nodes(file.create_group("nodes"), component, chosen)
            if all_nodes:
                _lumps(file["nodes"], body)
            _integrals(file.create_group("integrals"), component)
        faces = file.create_group("interfaces")
        for name, face in body.interfaces.items():
            _interface(faces.create_group(name), component, face, name)
        m = component.omega.size
        into = file.create_group("inputs")
        put_texts(into, "name", inputs)
        put(into, "B", np.array(list(inputs.values())).reshape(len(inputs), m).T, about="modal force of a unit effort")
        out = file.create_group("outputs")
        put_texts(out, "name", outputs)
        put(
            out, "C1", np.array([d for d, _ in outputs.values()]).reshape(len(outputs), m), about="displacement outputs"
        )
        put(out, "C2", np.array([v for _, v in outputs.values()]).reshape(len(outputs), m), about="rate outputs")
        _integration(file.create_group("integration"), component)
        done = file.create_group("checks")
        put_texts(done, "name", [check.name for check in checks])
        put(done, "value", np.array([check.value for check in checks], dtype=np.float64))
        put(done, "limit", np.array([check.limit for check in checks], dtype=np.float64))


def _support(component: ModalComponent) -> str:
    """How the body was held when its modes were computed: their rigid motion is what a floating frame brings itself."""
    if not component.rigid_count:
        return "held: no rigid motion is left in the modes"
    return f"floating: the first {component.rigid_count} modes are its rigid motions"


def _provenance(group: Any, body: FEModel, provenance: Mapping[str, Any]) -> None:
    import h5py
    import scipy

    from cmsreduce import __version__

    versions = {
        "cmsreduce": __version__,
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "h5py": h5py.__version__,
        "python": platform.python_version(),
    }
    for name, version in versions.items():
        group.attrs[f"{name}_version"] = version
    for key, value in provenance.items():
        put_texts(group, key, [json.dumps(value, sort_keys=True, default=str)], about="JSON")
    put_texts(group, "source", [Path(source.path).name for source in body.sources], about="files read")
    put_texts(group, "sha256", [source.sha256 for source in body.sources], about="of each file")
    put_texts(group, "holds", [source.holds for source in body.sources], about="what was taken from each file")


def _modes(group: Any, component: ModalComponent) -> None:
    # A static mode has no frequency.
    omega = np.where(np.isinf(component.omega), np.nan, component.omega)
    group.attrs["rigid_count"] = component.rigid_count
    group.attrs["static_count"] = component.static_count
    group.attrs["basis_size"] = component.basis_size
    group.attrs["damping_law"] = component.damping.law if component.D is None else "matrix"
    put(group, "omega", omega, "rad/time", "natural frequencies; rigid first and zero, static last and NaN")
    put(group, "frequency_hz", omega / (2 * np.pi), "cycles/time")
    put(group, "zeta", component.zeta, "", "damping ratios; half the loss factor for structural damping")
    put(group, "mass", np.diag(component.mass), "", "modal mass: 1, and 0 of a static mode")
    put(group, "stiffness", np.diag(component.stiffness), "rad^2/time^2", "omega^2, and 1 of a static mode")
    damping = np.diag(component.viscous) if component.D is None else component.D
    put(group, "damping", damping, "rad/time", "viscous damping")
    if component.damping.structural is not None:
        put(group, "loss", np.diag(component.loss), "rad^2/time^2", "imaginary part of a complex stiffness")
    put_texts(group, "kind", component.kind, "basis shape with most of each mode's kinetic energy, strain if static")
    put(group, "source_hz", component.source_hz, "cycles/time", "normal mode it comes from, NaN for static shapes")
    put(group, "sigma", component.sigma, "", "influence coefficient, NaN if unranked")
    put(group, "spacing", component.spacing, "", "half-power width over distance to the nearest mode")
    put_texts(group, "why", component.why, "why the mode was kept")
    if component.rankings:
        table = group.create_group("rankings")
        for name, values in component.rankings.items():
            put(table, name, values, "", "coefficient of each mode in this ranking, NaN for rigid and static modes")


def _chosen(body: FEModel, nodes: Sequence[int], all_nodes: bool) -> NDArray[np.int64]:
    if all_nodes:
        return np.unique(body.recovery.dofs.node)
    at_faces = [face.node for face in body.interfaces.values()]
    return np.unique(np.concatenate([np.asarray(nodes, dtype=np.int64), *at_faces]))


def _dofs(group: Any, component: ModalComponent, chosen: NDArray[np.int64]) -> None:
    recovery = component.body.recovery
    dofs = recovery.dofs
    rows = np.flatnonzero(np.isin(dofs.node, chosen))
    put(group, "node", dofs.node[rows])
    put(group, "component", dofs.component[rows], "", "1..3 translations, 4..6 rotations, 0 scalar")
    put_texts(group, "label", [f"{n}.{c}" for n, c in zip(dofs.node[rows], dofs.component[rows], strict=True)])
    shapes = recovery.T[rows] @ component.Phi
    put(group, "shapes", shapes, "", "rows: dofs in their displacement frames; columns: modes")


def _nodes(group: Any, component: ModalComponent, chosen: NDArray[np.int64]) -> None:
    body = component.body
    assert body.nodes is not None
    at = body.nodes.index(chosen)
    chosen, at = chosen[at >= 0], at[at >= 0]
    put(group, "id", chosen)
    put(group, "xyz", body.nodes.xyz[at], "length", "in the body's basic frame")
    put(group, "frame", body.nodes.frame[at], "", "displacement axes as rows, in basic")
    for name in ("translation", "rotation"):
        shapes = basic_shapes(body, body.nodes, component.Phi, chosen, name)
        put(group, name, shapes, "", f"{name} of each mode along basic x y z, NaN where it is not known")


def _lumps(group: Any, body: FEModel) -> None:
    mass, inertia = lumps_of_nodes(body, group["id"][()])
    put(group, "lumped_mass", mass, "mass", "of each node: the diagonal of the mass matrix scaled to the body's mass")
    put(group, "lumped_inertia", inertia, "mass length^2", "of each node about itself, basic axes")


def _interface(group: Any, component: ModalComponent, face: Interface, name: str) -> None:
    rows = component.body.interface_rows(name)
    put(group, "node", np.repeat(face.node, [len(parts) for parts in face.components]))
    put(group, "component", np.array([c for parts in face.components for c in parts], dtype=np.int8))
    put(group, "position", face.position, "length", "of each node, in basic")
    put(group, "frame", face.frame, "", "joint axes as rows, in basic")
    put(group, "shapes", component.Phi[rows], "", "rows: interface dofs in displacement frames; columns: modes")


def _integrals(group: Any, component: ModalComponent) -> None:
    body = component.body
    assert body.nodes is not None
    R = rigid_body_shapes(body.dofs, body.nodes)
    MR = body.M @ R
    rigid, coupling = R.T @ MR, MR.T @ component.Phi
    mass = rigid.diagonal()[:3]
    # A coordinate shows in the two motions across it; a body held in some directions lacks one or both.
    across = np.where(mass.sum() - mass > 0, mass.sum() - mass, 1.0)
    moment = np.array([rigid[5, 1] - rigid[4, 2], rigid[3, 2] - rigid[5, 0], rigid[4, 0] - rigid[3, 1]])
    group.attrs["mass_matrix"] = "consistent: as given"
    group.attrs["about"] = "origin of the body's basic frame"
    put(group, "mass", mass.max(), "mass")
    put(group, "first_moment", mass.max() * moment / across, "mass length", "int r dm")
    put(group, "inertia", rigid[3:, 3:], "mass length^2")
    put(group, "rigid_mass", rigid, "", "R^T M R, 6 x 6")
    put(group, "int_phi", coupling[:3], "", "int phi dm, one column per mode")
    put(group, "int_r_x_phi", coupling[3:], "", "int r x phi dm, one column per mode")
    if mass.max() > 0:
        _second_order(group, component)


def _second_order(group: Any, component: ModalComponent) -> None:
    """Integrals over the modes that deform the body, as floating-frame codes take them."""
    modes = np.arange(component.rigid_count, component.omega.size)
    found = modal_integrals(component.body, component.Phi[:, modes], modes=modes)
    group.attrs["lumping"] = found.lumping
    put(group, "origin", found.origin, "length", "of the frame of the integrals, in basic")
    put(group, "axes", found.axes, "", "of that frame as rows, in basic")
    put(group, "modes", found.modes, "", "columns of the shapes that phi stands for below: elastic and static modes")
    put(group, "phi", found.phi, "", "int phi dm")
    put(group, "r_cross_phi", found.r_cross_phi, "", "int r x phi dm")
    put(group, "r_phi", found.r_phi, "", "int r_i phi_j dm, entry [i, j, mode]")
    put(group, "phi_phi", found.phi_phi, "", "int phi_i phi_j dm, entry [i, j, a, b] of modes a and b")


def _integration(group: Any, component: ModalComponent) -> None:
    """Largest steps (theory section 8)."""
    top = float(component.omega[component.elastic].max(initial=0.0))
    group.attrs["highest_omega"] = top
    group.attrs["highest_hz"] = top / (2 * np.pi)
    if top > 0:
        group.attrs["central_difference_stable_step"] = 2 / top
        for name in INTEGRATORS:
            group.attrs[f"{name}_step_1_percent"] = step_limit(name, 1e-2) / top
            group.attrs[f"{name}_step_0.1_percent"] = step_limit(name, 1e-3) / top
