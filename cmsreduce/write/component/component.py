"""Writer of the component file: a reduced body for multibody codes (docs/component-file.md)."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import combined, dense, observed
from cmsreduce.mechanics import ACCURACIES, advised_steps, moves_generalised, numerical_damping
from cmsreduce.model import (
    CostlyModes,
    FEModel,
    Finding,
    FloatingFrame,
    GeometricStiffness,
    IntegralFrame,
    Interface,
    ModalComponent,
    OutboardMass,
    with_gyroscopic,
)
from cmsreduce.write.component.component_file import FORMAT, FORMAT_VERSION
from cmsreduce.write.component.integrals import put_augmented, put_frame, put_integrals, put_stiffening, support
from cmsreduce.write.component.shapes import basic_shapes, lumps_of_nodes
from cmsreduce.write.files import hdf5_file, put, put_json, put_texts, put_units
from cmsreduce.write.seal import put_seal

__all__ = ["write_component"]

Row = NDArray[np.float64]


def write_component(
    path: Path,
    component: ModalComponent,
    *,
    nodes: Sequence[int],
    inputs: Mapping[str, Row],
    outputs: Mapping[str, tuple[Row, Row]],
    checks: Sequence[Finding],
    provenance: Mapping[str, Any],
    all_nodes: bool = False,
    frame: FloatingFrame | None = None,
    about: IntegralFrame | None = None,
    augmented: Sequence[OutboardMass] = (),
    costly: CostlyModes | None = None,
    stiffening: GeometricStiffness | None = None,
) -> None:
    """Write a component file.

    Parameters
    ----------
    path : Path
        Name of the file, which is complete or absent.
    component : ModalComponent
        Modes that were kept.
    nodes : sequence of int
        Nodes whose shapes are written in addition to those of the interfaces.
    inputs : mapping of name to (m,) float64
        Modal force of a unit effort of each actuator.
    outputs : mapping of name to ((m,), (m,)) float64
        Displacement and rate row of each sensor.
    checks : sequence of Finding
        Results of the body's checks.
    provenance : mapping
        ``settings`` and ``notes`` of the run, and other JSON values.
    all_nodes : bool
        Write the shapes at every node.
    frame : FloatingFrame, optional
        Floating frame of the deforming modes; by default these are written as they are.
    about : IntegralFrame, optional
        Frame and mass of the integrals; by default the basic frame and the consistent mass.
    augmented : sequence of OutboardMass
        Masses outboard of the interfaces.
    costly : CostlyModes, optional
        Modes that force small integrator steps but do not matter in the band.
    stiffening : GeometricStiffness, optional
        Geometric stiffness.

    Raises
    ------
    WriteError
        If the file cannot be written.
    """
    body = component.body
    T = np.eye(component.omega.size) if frame is None else frame.change
    # A mode that is treated statically has no mass, and so no part in integrals over the mass.
    inertial = replace(component, Phi=component.inertial_shapes)
    if frame is not None:
        inertial = replace(component, Phi=combined(inertial.Phi, T))
        component = replace(component, Phi=combined(component.Phi, T))
    with hdf5_file(path) as file:
        file.attrs["format"] = FORMAT
        file.attrs["format_version"] = FORMAT_VERSION
        file.attrs["name"] = component.name
        file.attrs["method"] = component.method
        file.attrs["frame"] = "basic frame of the body"
        file.attrs["support"] = support(component, frame)
        file.attrs["created_utc"] = datetime.now(UTC).isoformat(timespec="seconds")
        _provenance(file.create_group("provenance"), body, provenance)
        put_units(file.create_group("units"), body.units)
        _modes(file.create_group("modes"), component, T)
        put_frame(file.create_group("frame"), frame)
        chosen = _chosen(body, nodes, all_nodes)
        _dofs(file.create_group("dofs"), component, chosen)
        if body.nodes is not None:
            _nodes(file.create_group("nodes"), component, chosen)
            if all_nodes and not moves_generalised(body):
                _lumps(file["nodes"], body)
            put_integrals(file.create_group("integrals"), inertial, about or IntegralFrame.basic())
        if augmented:
            put_augmented(file.create_group("augmented"), augmented)
        if stiffening is not None:
            put_stiffening(file.create_group("geometric_stiffness"), stiffening, component.Phi)
        if any(not term.constant for term in component.terms):
            _parameters(file.create_group("parameters"), component, T)
        faces = file.create_group("interfaces")
        for name, face in body.interfaces.items():
            _interface(faces.create_group(name), component, face, name)
        m = component.omega.size
        into = file.create_group("inputs")
        put_texts(into, "name", inputs)
        forces = np.array(list(inputs.values())).reshape(len(inputs), m) @ T
        put(into, "B", forces.T, about="modal force of a unit effort")
        out = file.create_group("outputs")
        put_texts(out, "name", outputs)
        for number, name in enumerate(("C1", "C2")):
            rows = np.array([pair[number] for pair in outputs.values()]).reshape(len(outputs), m) @ T
            put(out, name, rows, about=f"{('displacement', 'rate')[number]} outputs")
        _integration(file.create_group("integration"), component, costly)
        done = file.create_group("checks")
        put_texts(done, "name", [check.name for check in checks])
        put(done, "value", np.array([check.value for check in checks], dtype=np.float64))
        put(done, "limit", np.array([check.limit for check in checks], dtype=np.float64))
        put_seal(file)


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
    put_json(group, provenance)
    put_texts(group, "source", [Path(source.path).name for source in body.sources], about="files read")
    put_texts(group, "sha256", [source.sha256 for source in body.sources], about="of each file")
    put_texts(group, "holds", [source.holds for source in body.sources], about="what was taken from each file")


def _modes(group: Any, component: ModalComponent, T: Row) -> None:
    # A static mode has no frequency.
    omega = np.where(np.isinf(component.omega), np.nan, component.omega)
    group.attrs["rigid_count"] = component.rigid_count
    group.attrs["static_count"] = component.static_count
    group.attrs["basis_size"] = component.basis_size
    group.attrs["damping_law"] = component.damping.law if component.D is None else "matrix"
    put(group, "omega", omega, "rad/time", "natural frequencies; rigid first and zero, static last and NaN")
    put(group, "frequency_hz", omega / (2 * np.pi), "cycles/time")
    put(group, "zeta", component.zeta, "", "damping ratios; half the loss factor for structural damping")
    mass = T.T @ np.diag(component.mass) @ T
    put(group, "mass", mass, "", "modal mass: 1, and 0 of a static mode, except for rigid motion that the frame adds")
    put(group, "stiffness", np.diag(component.stiffness), "rad^2/time^2", "omega^2, and 1 of a static mode")
    damping = np.diag(component.viscous) if component.D is None else T.T @ component.D @ T
    put(group, "damping", damping, "rad/time", "viscous damping")
    gyroscopic = with_gyroscopic(None, component.terms)
    if gyroscopic is not None:
        put(group, "gyroscopic", T.T @ dense(gyroscopic) @ T, "rad/time", "skew; its forces are beside the damping's")
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


def _parameters(group: Any, component: ModalComponent, T: Row) -> None:
    """Write what parameters add to the modal matrices: M + sum of p^power M_p, and K, D and G alike."""
    words = {"M": "mass", "K": "stiffness", "D": "damping", "G": "gyroscopic"}
    for term in (term for term in component.terms if not term.constant):
        own = group.require_group(term.parameter)
        name = words[term.letter]
        put(own, name, term.over(T).dense, about=f"added to modes/{name}, times the parameter to the power stated")
        own.attrs[f"{name}_power"] = term.power


def _chosen(body: FEModel, nodes: Sequence[int], all_nodes: bool) -> NDArray[np.int64]:
    if all_nodes:
        return body.recovery.dofs.node_ids
    at_faces = [face.node for face in body.interfaces.values()]
    return np.unique(np.concatenate([np.asarray(nodes, dtype=np.int64), *at_faces]))


def _dofs(group: Any, component: ModalComponent, chosen: NDArray[np.int64]) -> None:
    recovery = component.body.recovery
    dofs = recovery.dofs
    rows = np.flatnonzero(np.isin(dofs.node, chosen))
    put(group, "node", dofs.node[rows])
    put(group, "component", dofs.component[rows], "", "1..3 translations, 4..6 rotations, 0 scalar")
    put_texts(group, "label", [f"{n}.{c}" for n, c in zip(dofs.node[rows], dofs.component[rows], strict=True)])
    shapes = observed(recovery.T[rows], component.Phi)
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


def _integration(group: Any, component: ModalComponent, costly: CostlyModes | None) -> None:
    """Write largest steps (theory section 8), and the modes that force them but do not matter in the band."""
    top = float(component.omega[component.elastic].max(initial=0.0))
    group.attrs["highest_omega"] = top
    group.attrs["highest_hz"] = top / (2 * np.pi)
    for name, steps in advised_steps(top).items():
        if 0 < steps["stable"] < np.inf:
            group.attrs[f"{name}_stable_step"] = steps["stable"]
        for accuracy in ACCURACIES:
            group.attrs[f"{name}_step_{accuracy}"] = steps[accuracy]
            group.attrs[f"{name}_damping_{accuracy}"] = numerical_damping(name, top * steps[accuracy])
    if costly is not None:
        group.attrs["serving_hz"] = costly.serving_hz
        columns = np.array([each.mode for each in costly.modes], dtype=np.int64)
        put(group, "costly", columns, "", "columns of modes that force small steps but do not matter in the band")
        put(group, "share", np.array([each.share for each in costly.modes]), "", "of flexibility in the band, of each")
