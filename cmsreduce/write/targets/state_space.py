"""State space of a reduced body, as a MATLAB file (MAT 5, read by MATLAB, Octave and scipy) or as text."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import WriteError
from cmsreduce.write.component import ComponentFile
from cmsreduce.write.files import atomic_path, number, put_lines

__all__ = [
    "StateSpace",
    "component_states",
    "write_abcd",
    "write_matlab",
    "write_states",
]

# Fixed text in place of the date that scipy writes, so that equal input gives equal bytes.
MAT_MARK = "MATLAB 5.0 MAT-file, written by cmsreduce"
_HEADER = MAT_MARK.encode().ljust(116)
# A MAT 5 file counts its bytes in 32 bits.
_LARGEST = 2**31
# A change of coordinates leaves this share of the largest entry where there is none.
_ROUNDING = 1e-12
# A static mode follows its load at once if its damper has less than this share of its spring's force at the highest
# frequency. Round-off of shapes that no damper moves is squared here.
_NO_LAG = 1e-9

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
        Other data of the model: arrays, texts, lists of texts.
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


def write_matlab(path: Path, variables: Mapping[str, Any]) -> None:
    """Write a MAT 5 file.

    Parameters
    ----------
    path : Path
        Name of the file, which is complete or absent.
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
        raise WriteError(f"{path}: {len(content) / 2**30:.1f} GiB do not fit in a MAT 5 file; keep fewer modes")
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


def component_states(component: ComponentFile) -> StateSpace:
    """State space of a reduced body: amplitudes of its modes, then their rates.

    Parameters
    ----------
    component : ComponentFile
        m modes: rigid, elastic, static. Inputs are its actuators, then forces on the dofs of its interfaces. Outputs
        are its sensors, then displacements of these dofs. The modes are orthonormal, also if the file has a floating
        frame.

    Raises
    ------
    WriteError
        If its damping has no real state space or acts on a static mode, or a sensor measures the rate of a static mode
        that an input moves.
    """
    arrays, name = component.arrays, component.name
    if "modes/loss" in arrays:
        raise WriteError(
            f"component '{name}': structural damping is a complex stiffness and has no real state space; give it "
            "modal damping, or take `matlab`, `abcd` and `fmi` out of write.formats"
        )
    faces = tuple(component.interfaces)
    labels = [label for face in faces for label in _labels(component, face)]
    back = _to_free_modes(component)
    shapes = [np.empty((0, back.shape[0])), *(arrays[f"interfaces/{face}/shapes"] for face in faces)]
    at_faces = np.vstack(shapes) @ back
    m = component.elastic.stop
    force = np.hstack([back.T @ arrays["inputs/B"], at_faces.T])
    C1 = np.vstack([arrays["outputs/C1"] @ back, at_faces])
    C2 = np.vstack([arrays["outputs/C2"] @ back, np.zeros_like(at_faces)])
    if (C2[:, m:] @ force[m:]).any():
        raise WriteError(
            f"component '{name}': a rate sensor measures a static mode, whose rate is the derivative of an input and "
            "not a state; measure the displacement, or take `matlab`, `abcd` and `fmi` out of write.formats"
        )
    damping, turning = back.T @ arrays["modes/damping"] @ back, component.gyroscopic
    _refuse_lag(component, np.diagonal(damping)[m:])
    if turning is not None:
        turning = back.T @ turning @ back
        damping = damping + turning
    if turning is not None and abs(turning[m:]).max(initial=0.0) > _ROUNDING * abs(turning).max():
        raise WriteError(
            f"component '{name}': gyroscopic forces act on a static mode, which adds mass to the others as no state "
            "space of them has it; leave `residuals` out of `reduce`, or give the node of the wheel its inertia"
        )
    stiffness = np.diag(arrays["modes/stiffness"])
    A = np.block([[np.zeros((m, m)), np.eye(m)], [-np.diag(stiffness[:m]), -damping[:m, :m]]])
    return StateSpace(
        A,
        np.vstack([np.zeros((m, force.shape[1])), force[:m]]),
        np.hstack([C1[:, :m], C2[:, :m]]),
        C1[:, m:] @ force[m:],
        [*component.texts["inputs/name"], *labels],
        [*component.texts["outputs/name"], *labels],
        {
            "name": name,
            "method": component.method,
            "rigid_count": component.rigid_count,
            "frequency_hz": component.omega[:m] / (2 * np.pi),
            "zeta": arrays["modes/zeta"][:m],
            "units": dict(component.attributes["units"]),
            "states": "amplitudes of the modes, then their rates",
        },
    )


def _refuse_lag(component: ComponentFile, damping: Array) -> None:
    """Refuse damped static modes, of unit stiffness: damping of a positive matrix couples only those to the others."""
    highest = component.omega[component.elastic].max(initial=0.0) or np.inf
    if (damping[damping > 0] * highest > _NO_LAG).any():
        raise WriteError(
            f"component '{component.name}': a static mode is damped, so that it lags behind its load as no amplitude "
            "and rate of the other modes do; give the body a modal damping ratio, which does not act on such modes, "
            "leave `residuals` out of `reduce`, or give its nodes some inertia"
        )


def write_states(path: Path, component: ComponentFile) -> None:
    """Write the state space of a body as a MAT 5 file.

    Raises
    ------
    WriteError
        If it has none (`component_states`), or the file cannot be written.
    """
    write_matlab(path, component_states(component).variables())


def write_abcd(path: Path, component: ComponentFile) -> None:
    """Write the state space of a body as text: names of channels, then A, B, C and D row by row.

    Parameters
    ----------
    path : Path
        Name of the file, which is complete or absent. Lines that begin with ``%`` are headings: ``% A rows columns``.
    component : ComponentFile
        The body.

    Raises
    ------
    WriteError
        If it has none (`component_states`), or the file cannot be written.
    """
    states = component_states(component)
    about = f"x' = A x + B u, y = C x + D u, x {states.facts['states']}, units {component.units.name}"
    lines = [f"% STATE SPACE {component.name}: {about}"]
    lines += [f"% INPUTS {' '.join(states.inputs)}", f"% OUTPUTS {' '.join(states.outputs)}"]
    for letter in "ABCD":
        matrix: Array = getattr(states, letter)
        lines.append(f"% {letter} {matrix.shape[0]} {matrix.shape[1]}")
        lines += [" ".join(number(value) for value in row) for row in matrix]
    put_lines(path, lines)


def _labels(component: ComponentFile, face: str) -> list[str]:
    nodes, parts = (component.arrays[f"interfaces/{face}/{what}"] for what in ("node", "component"))
    return [f"{face}.{node}.{part}" for node, part in zip(nodes, parts, strict=True)]


def _to_free_modes(component: ComponentFile) -> Array:
    """Modes of the free body as combinations of those in the file (m, m): restores what a floating frame removed."""
    back = np.eye(component.omega.size)
    if "frame/removed" in component.arrays:
        r = component.rigid_count
        back[:r, r:] = component.arrays["frame/removed"]
    return back
