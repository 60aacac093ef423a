"""Component files and the system file of a run, and bodies that files of other programs cannot hold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cmsreduce.errors import ConfigError
from cmsreduce.mechanics import moves_generalised
from cmsreduce.model import UNDETERMINED, Configuration, FEModel, Values
from cmsreduce.pipeline.bodies import FlexibleBody
from cmsreduce.pipeline.results.mass_and_frame import frame_of, integral_frame_of, outboard_of
from cmsreduce.pipeline.results.result import component_checks
from cmsreduce.pipeline.results.step_advice import body_costly_modes
from cmsreduce.pipeline.results.units import channel_quantities
from cmsreduce.pipeline.run import Run
from cmsreduce.pipeline.store import diagnostic
from cmsreduce.write import PROFILES, TARGETS, JoinedNodes, Profile, write_component, write_system

__all__ = ["refuse_unwritable", "write_body", "write_system_file"]

_SIX = 6


def refuse_unwritable(run: Run, values: Values) -> None:
    """Refuse files of other programs that have no place for any body as it was read, before anything is computed.

    Where they have a place for another body, the run goes on, and the one that they cannot hold fails alone.

    Parameters
    ----------
    run : Run
        Its pipeline writes files.
    values : Values
        Values of the parameters in these files.

    Raises
    ------
    ConfigError
        Names the formats, a body and the remedy.
    """
    keys = run.pipeline.write
    assert keys is not None
    asked = {f"'{each}'": Profile(each, keys.dialects.get(each)) for each in keys.formats if each in TARGETS}
    asked |= {f"'{each}' (targets)": PROFILES[each] for each in keys.targets}
    unfit: dict[tuple[str, str], list[str]] = {}
    for each, profile in asked.items():
        # Not `run.bodies`, which computes the health of all bodies first.
        why = {name: _unfit(profile, run.flexible(name), values, keys.all_nodes) for name in run.flexible_names}
        if why and all(why.values()):
            unfit.setdefault(next(iter(why.items())), []).append(each)
    if unfit:
        (name, reason), formats = next(iter(unfit.items()))
        raise ConfigError(
            f"write: component '{name}' cannot be written as {', '.join(formats)}: {reason}, or leave them out"
        )


def _unfit(profile: Profile, flexible: FlexibleBody, values: Values, all_nodes: bool) -> str:
    """Why files of a program have no place for a body, and the remedy; empty if they have."""
    target, body, rigid = TARGETS[profile.target], flexible.body, flexible.rigid.shape[1]
    if body.damping.structural is not None and not target.structural:
        return "they have no place for structural damping, a complex stiffness; give half of it as `modal`"
    if not target.gyroscopic and any(term.gyroscopic and term.factor(values) for term in body.terms):
        return "they have no place for gyroscopic forces of wheels and rotors; hdf5, matlab, abcd and fmi have"
    if body.nodes is None and target.integrals:
        return "they need modal integrals, which a body without geometry lacks; give `geometry:`"
    if (target.free or profile.mean_axes) and rigid != _SIX:
        held = "; hold it by a joint in place of `grounded: true`" if body.grounded else ""
        return f"they take bodies with six rigid motions, and it has {rigid}{held}"
    if reason := target.joins(JoinedNodes.of_body(body)):
        return f"they have no place for its interfaces: {reason}"
    if target.integrals and (lost := _moves_unknown(body)):
        return (
            f"they hold bodies that move in all directions, and node {lost} of it lacks a translation, as in a plane "
            "body; matlab, abcd and fmi have a place for it"
        )
    if (profile.dialect or next(iter(target.dialects), "")) in target.lumped and not all_nodes:
        return "they need the masses of all nodes; set `write: {all_nodes: true}`"
    return ""


def _moves_unknown(body: FEModel) -> int:
    """An interface node with a translation that is no row and is not held; 0 if there is none."""
    nodes = np.unique(np.concatenate([np.empty(0, np.int64), *(each.node for each in body.interfaces.values())]))
    asked = np.repeat(nodes, 3), np.tile(np.arange(1, 4), nodes.size)
    known = body.recovery.dofs.rows(*asked) >= 0
    if body.constrained is not None:
        known |= body.constrained.rows(*asked) >= 0
    return int(next(iter(nodes[~known.reshape(-1, 3).all(axis=1)]), 0))


@diagnostic("the component file of '{}'", about=lambda run, name, *_: name, required=True)
def write_body(run: Run, name: str, path: Path, notes: Sequence[str] = ()) -> Path | None:
    """Write the component file of a body, with notes of the run."""
    model, component = run.model.assembled, run.written(name)
    wiring = model.wiring(Configuration("as built"))
    columns, L = model.stack.body_columns(name), run.written_motions(name)

    def on_body(rows: np.ndarray[Any, np.dtype[np.float64]]) -> Any:
        return rows[:, columns] @ L

    forces, displacements, rates = on_body(wiring.B), on_body(wiring.C1), on_body(wiring.C2)
    inputs = {c.name: row for c, row in zip(run.scene.actuators, forces, strict=True) if row.any()}
    measured = zip(run.scene.sensors, displacements, rates, strict=True)
    outputs = {c.name: (d, v) for c, d, v in measured if d.any() or v.any()}
    frame = frame_of(run, name)
    write_component(
        path,
        component,
        nodes=[int(label) for label in model.substructures[name].motion],
        inputs=inputs,
        outputs=outputs,
        checks=component_checks(run, name),
        provenance=_provenance(run, notes),
        all_nodes=run.pipeline.write is not None and run.pipeline.write.all_nodes,
        frame=frame,
        about=integral_frame_of(run, name, frame),
        augmented=outboard_of(run, name),
        costly=body_costly_modes(run, name),
        stiffening=run.bodies[name].stiffening,
    )
    body = component.body
    if body.nodes is not None and body.second_order is None and moves_generalised(body):
        run.stages.note(
            f"{name}: {UNDETERMINED}. Its file leaves them out; exudyn and sid files are for slow rotations, without "
            "forces by squares of angular velocities; 42, mbdyn, mbsim, discos, dads and treetops need them"
        )
    return path


@diagnostic("the file system.h5", tuple, required=True)
def write_system_file(run: Run, path: Path | None = None) -> tuple[Path, ...]:
    """Write the assembled system in every configuration, by default to system.h5 of the run."""
    path = path or run.folder / "system.h5"
    model = run.model.assembled
    systems = [model.system(configuration) for configuration in run.scene.configurations]
    write_system(
        path,
        systems,
        provenance=_provenance(run, run.stages.notes),
        units=run.scene.units,
        quantities=channel_quantities(run.scene),
    )
    return (path,)


def _provenance(run: Run, notes: Sequence[str]) -> Mapping[str, Any]:
    return {
        "pipeline": run.pipeline.name,
        "settings": run.pipeline.record(exclude_none=True),
        "notes": list(notes),
    }
