"""A reduced body as a Functional Mock-up Unit: small motions of the free body about rest."""

from __future__ import annotations

from pathlib import Path

from cmsreduce.model import DOF_NAMES, SCALAR
from cmsreduce.write.component import ComponentFile
from cmsreduce.write.targets.fmi.linear_model import LinearModel, Port
from cmsreduce.write.targets.fmi.unit import write_unit
from cmsreduce.write.targets.state_space import component_states

__all__ = ["write_body_unit"]


def write_body_unit(path: Path, component: ComponentFile, version: str) -> None:
    """Write a body as a unit: forces of its actuators and on its interface dofs in, sensors and displacements out.

    Parameters
    ----------
    path : Path
        Name of the file, which is complete or absent.
    component : ComponentFile
        The body. Its rigid motions are free and linear: the unit is right for small rotations.
    version : {"fmi3", "fmi2"}
        Version of the standard.

    Raises
    ------
    WriteError
        If the body has no state space (`component_states`), or as `write_unit`.
    """
    states, units = component_states(component), component.units
    forces, motions = _ports(component, ("force", "torque")), _ports(component, ("translation", "rotation"))
    model = LinearModel(
        name=component.name,
        about=f"body {component.name}, {component.method}: small motions about rest",
        A=states.A,
        B=states.B,
        C=states.C,
        D=states.D,
        inputs=(*map(Port, component.texts["inputs/name"]), *forces),
        outputs=(*map(Port, component.texts["outputs/name"]), *motions),
        frequency_hz=states.facts["frequency_hz"] / units.time,
        units=units,
    )
    write_unit(path, model, version)


def _ports(component: ComponentFile, quantities: tuple[str, str]) -> list[Port]:
    """Loads or displacements of the interface dofs, named INTERFACE.NODE.DOF; loads have ``f_`` before the dof."""
    found, mark = [], "f_" if quantities[0] == "force" else ""
    for face in component.interfaces:
        nodes, parts = (component.arrays[f"interfaces/{face}/{what}"].tolist() for what in ("node", "component"))
        for node, part in zip(nodes, parts, strict=True):
            if part == SCALAR:
                found.append(Port(f"{face}.{node}.{mark}scalar"))
            else:
                dof = DOF_NAMES[part - 1]
                found.append(Port(f"{face}.{node}.{mark}{dof}", quantities[dof.startswith("r")]))
    return found
