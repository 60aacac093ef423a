"""MATLAB files of state-space models: MAT 5, which MATLAB, Octave and scipy read."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import WriteError
from cmsreduce.model import Interface, ModalComponent, Units
from cmsreduce.write.atomic import atomic_path

__all__ = ["StateSpace", "component_states", "write_matlab"]

# Fixed text in place of the date that scipy writes, so that equal input gives equal bytes.
_HEADER = b"MATLAB 5.0 MAT-file, written by cmsreduce".ljust(116)
# A MAT 5 file counts its bytes in 32 bits.
_LARGEST = 2**31

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class StateSpace:
    """x' = A x + B u, y = C x + D u, with names.

    Parameters
    ----------
    A, B, C, D : float64
        The model.
    inputs, outputs : sequence of str
        Names of the channels.
    facts : mapping
        What else is known of it: arrays, texts, lists of texts.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    inputs: Sequence[str]
    outputs: Sequence[str]
    facts: Mapping[str, Any] = field(default_factory=dict)

    def variables(self) -> dict[str, Any]:
        """The model as MATLAB variables."""
        own = {"A": self.A, "B": self.B, "C": self.C, "D": self.D}
        return {**own, "inputs": list(self.inputs), "outputs": list(self.outputs), **self.facts}


def component_states(
    component: ModalComponent, inputs: Mapping[str, Array], outputs: Mapping[str, tuple[Array, Array]]
) -> StateSpace:
    """State space of a reduced body: amplitudes of its modes, then their rates.

    Parameters
    ----------
    component : ModalComponent
        m modes: rigid, elastic, static.
    inputs : mapping of name to (m,) float64
        Modal force of a unit effort of each actuator; forces on the dofs of the interfaces follow them.
    outputs : mapping of name to ((m,), (m,)) float64
        Displacement and rate row of each sensor; displacements of the dofs of the interfaces follow them.

    Raises
    ------
    WriteError
        If its damping has no real state space, or a sensor measures the rate of a static mode that an input moves.
    """
    if component.damping.structural is not None:
        raise WriteError(
            f"component '{component.name}': structural damping is a complex stiffness and has no real state space; "
            "give it modal damping, or take `matlab` out of write.formats"
        )
    faces = component.body.interfaces
    labels = [label for name, face in faces.items() for label in _labels(name, face)]
    rows = [component.body.interface_rows(name) for name in faces]
    at_faces = component.Phi[np.concatenate(rows)] if rows else np.empty((0, component.omega.size))
    m, s = component.elastic.stop, component.omega.size
    force = np.vstack([*inputs.values(), at_faces]).T
    C1 = np.vstack([*(row for row, _ in outputs.values()), at_faces])
    C2 = np.vstack([*(rate for _, rate in outputs.values()), np.zeros_like(at_faces)])
    if (C2[:, m:] @ force[m:]).any():
        raise WriteError(
            f"component '{component.name}': a rate sensor feels a static mode, whose rate is the derivative of an "
            "input and no state; measure the displacement, or take `matlab` out of write.formats"
        )
    damping = np.diag(component.viscous) if component.D is None else component.D
    stiffness = np.diag(component.stiffness[:m])
    A = np.block([[np.zeros((m, m)), np.eye(m)], [-stiffness, -damping[:m, :m]]])
    omega = component.omega[:m]
    return StateSpace(
        A,
        np.vstack([np.zeros((m, force.shape[1])), force[:m]]),
        np.hstack([C1[:, :m], C2[:, :m]]),
        C1[:, m:s] @ force[m:s],
        [*inputs, *labels],
        [*outputs, *labels],
        {
            "name": component.name,
            "method": component.method,
            "rigid_count": component.rigid_count,
            "frequency_hz": omega / (2 * np.pi),
            "zeta": component.zeta[:m],
            "units": _units(component.body.units),
            "states": "amplitudes of the modes, then their rates",
        },
    )


def write_matlab(path: Path, variables: Mapping[str, Any]) -> None:
    """Write a MAT 5 file.

    Parameters
    ----------
    path : Path
        Where; the file is whole or not there.
    variables : mapping
        Arrays, numbers, texts; a list of texts becomes a cell array, a mapping a structure, a list of mappings a cell
        array of structures.

    Raises
    ------
    WriteError
        If the file cannot be written, or is too large for the format.
    """
    from scipy.io import savemat

    image = io.BytesIO()
    values = {name: _value(value) for name, value in variables.items()}
    savemat(image, values, do_compression=True, oned_as="column")  # type: ignore[arg-type]
    content = _HEADER + image.getvalue()[len(_HEADER) :]
    if len(content) >= _LARGEST:
        raise WriteError(f"{path}: {len(content) / 2**30:.1f} GiB are more than a MAT 5 file holds; keep fewer modes")
    with atomic_path(path) as temporary:
        temporary.write_bytes(content)


def _value(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _value(part) for name, part in value.items()}
    if isinstance(value, (list, tuple)):
        cells = np.empty((len(value), 1), dtype=object)
        for place, part in enumerate(value):
            cells[place, 0] = _value(part)
        return cells
    return value


def _labels(name: str, face: Interface) -> list[str]:
    return [f"{name}.{node}.{c}" for node, parts in zip(face.node, face.components, strict=True) for c in parts]


def _units(units: Units) -> dict[str, Any]:
    """What the units are worth in SI."""
    return {"name": units.name, "length_in_si": units.length, "mass_in_si": units.mass, "time_in_si": units.time}
