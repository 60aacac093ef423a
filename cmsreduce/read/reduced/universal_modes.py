"""Modes of universal files, measured or computed: datasets 55 and 2414, through the library pyuff."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError, ReadError
from cmsreduce.model import DofTable, Nodes, RigidBody, Source, Units, rigid_body_shapes
from cmsreduce.read.files import sha256_of
from cmsreduce.read.geometry import other_length, read_geometry
from cmsreduce.read.mesh import universal_arrays
from cmsreduce.read.reduced.modal_body import ModalBody
from cmsreduce.read.reduced.modes import with_rigid_motions

__all__ = ["read_universal_modes"]

# Shapes are printed with six digits.
_ROUNDING = 5e-6
# Share of a complex shape out of phase with the rest, above which one real shape does not stand for it.
_OUT_OF_PHASE = 0.1
# A shape is a rigid motion if no more of it than this is left beside one: shapes have six digits.
_RIGID = 1e-4
_NORMAL_MODE = 2
_NO_SCALE = (
    "so that its shape has no scale: write `modal_mass:` with a mass for each mode (1 for shapes of unit modal mass)"
)
# Results that are displacements: of no stated kind, general, and displacement.
_DISPLACEMENTS, _OTHERS = (0, 1, 8), {11: "velocities", 12: "accelerations"}

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Mode:
    """A mode: frequency in Hz, damping ratio, modal mass (0 if unknown), real shape, and the share out of phase."""

    number: int
    hz: float
    zeta: float
    mass: float
    shape: Array
    apart: float


def read_universal_modes(
    name: str,
    path: Path,
    *,
    geometry: Path | None,
    units: Units,
    modal_mass: Sequence[float] | None = None,
    rigid: RigidBody | None = None,
    grounded: bool = False,
) -> ModalBody:
    """Read a body by the modes of a universal file.

    Parameters
    ----------
    name : str
        Name of the component.
    path : Path
        The file.
    geometry : Path, optional
        Deck or mesh with the nodes; by default the file itself (datasets 15 and 2411).
    units : Units
        Unit system of the file.
    modal_mass : sequence of float, optional
        One a mode, in place of those of the file.
    rigid : RigidBody, optional
        Mass properties of a free body whose modes are elastic ones alone.
    grounded : bool
        True if the body was held to the ground.

    Raises
    ------
    ReadError
        If the file cannot be read, or has no modes of displacement.
    MatrixError
        If a mode has no modal mass or is no motion in phase, or rigid motions are missing.

    Notes
    -----
    A complex shape is turned by the phase that makes the sum of its squares real and positive, and its real part is
    taken; the share that is lost, ||Im|| / ||phi||, is at most 10 %, and stated. A complex mode of eigenvalue s and
    modal A has the modal mass A / (2 i Im s), turned likewise, as a mode with proportional damping has. A loss factor
    counts as half as large a damping ratio. Directions in which no mode moves a node were not measured, and are left
    out.
    """
    arrays = universal_arrays(path)
    node, modes = _modes(name, path, arrays)
    shape = read_geometry(path if geometry is None else geometry)
    nodes = shape.nodes
    lost = nodes.index(node) < 0
    if lost.any():
        raise ReadError(
            f"{path}: node {node[lost.argmax()]} of its shapes is not in {geometry or path}; name the file of its "
            "nodes as `geometry:`"
        )
    if modal_mass is not None and len(modal_mass) != len(modes):
        raise MatrixError(f"body '{name}': {len(modal_mass)} modal masses are given, but {path} has {len(modes)} modes")
    mass = np.array([mode.mass for mode in modes] if modal_mass is None else modal_mass)
    if (mass <= 0).any():
        without = modes[int((mass <= 0).argmax())]
        raise MatrixError(
            f"body '{name}': mode {without.number} ({without.hz:g} Hz) of {path} has modal mass {without.mass:g}, "
            + _NO_SCALE
        )
    shapes = np.stack([mode.shape for mode in modes], axis=-1)
    at, component = np.nonzero(shapes.any(axis=-1))
    dofs = DofTable(node[at], (component + 1).astype(np.int8))
    omega = 2 * np.pi * np.array([mode.hz for mode in modes]) * units.time
    table = shapes[at, component]
    if not grounded:
        omega[_rigid(table, dofs, nodes)] = 0.0
    zeta = np.array([mode.zeta for mode in modes])
    worst = max(modes, key=lambda mode: mode.apart)
    turned = (
        f"{name}: complex shapes are taken as real ones; at most {100 * worst.apart:.2g} % of a shape is out of phase "
        f"(mode {worst.number}, {worst.hz:g} Hz)",
    )
    files = {path: f"{len(modes)} modes"} | ({} if geometry is None else {geometry: "geometry"})
    modal = ModalBody(
        name=name,
        K=np.diag(omega**2 * mass),
        M=np.diag(mass),
        D=np.diag(2 * zeta * omega * mass),
        dofs=dofs,
        shapes=table,
        nodes=nodes,
        units=units,
        rounding=_ROUNDING,
        sources=tuple(Source(str(each), sha256_of(each), what) for each, what in files.items()),
        remarks=(*(turned if worst.apart > 0 else ()), *other_length(name, shape, units)),
    )
    return with_rigid_motions(modal, rigid, grounded)


def _modes(name: str, path: Path, arrays: dict[str, NDArray[np.generic]]) -> tuple[NDArray[np.int64], list[_Mode]]:
    """Nodes, and every mode of displacements in order of frequency."""
    figures = arrays["modes"].astype(np.float64)
    kinds = figures[:, 2].astype(int)
    chosen = np.flatnonzero(np.isin(kinds, _DISPLACEMENTS))
    if not chosen.size:
        other = next((words for kind, words in _OTHERS.items() if kind in kinds), None)
        raise ReadError(
            f"{path}: there are no modes of displacements in it (datasets 55 and 2414, normal or complex modes)"
            + (f", only shapes of {other}: write them as displacements" if other else "")
        )
    node = arrays[f"nodes {chosen[0]}"].astype(np.int64)
    modes = []
    for at in chosen:
        if not np.array_equal(arrays[f"nodes {at}"], node):
            raise ReadError(
                f"{path}: its modes are at different nodes (datasets {chosen[0] + 1} and {at + 1} of modes); write all "
                "modes at the same nodes"
            )
        modes.append(_mode(name, path, figures[at], arrays[f"shape {at}"]))
    return node, sorted(modes, key=lambda mode: mode.hz)


def _mode(name: str, path: Path, figures: Array, given: NDArray[np.generic]) -> _Mode:
    number, analysis, _, hz, mass, zeta, loss = figures[:7]
    pole, A = complex(*figures[7:9]), complex(*figures[9:11])
    if given.ndim != 2 or given.shape[1] not in (3, 6):
        raise ReadError(
            f"{path}: mode {number:g} has {given.shape[-1]} numbers at a node, where a motion has three or six"
        )
    shape = given.astype(np.complex128)
    if not (np.isfinite(figures).all() and np.isfinite(shape).all()) or hz < 0:
        raise ReadError(
            f"{path}: mode {number:g} ({hz:g} Hz) has a negative frequency, or a number that is infinite or none: the "
            "program that wrote it failed there; write it again"
        )
    turn = np.exp(-0.5j * np.angle((shape**2).sum()))
    shape = shape * turn
    apart = float(np.linalg.norm(shape.imag) / max(np.linalg.norm(shape), np.finfo(float).tiny))
    if int(analysis) != _NORMAL_MODE:
        hz, zeta, loss = abs(pole) / (2 * np.pi), -pole.real / max(abs(pole), np.finfo(float).tiny), 0.0
        # Of a mode with proportional damping, A is real times i.
        mass = complex(A * turn**2 / (2j * pole.imag)).real if pole.imag else 0.0
    if apart > _OUT_OF_PHASE:
        raise MatrixError(
            f"body '{name}': the complex mode {number:g} ({hz:g} Hz) of {path} is out of phase by {100 * apart:.2g} % "
            f"of its shape; up to {100 * _OUT_OF_PHASE:g} % it is taken as a real one. Give real modes of the body: "
            "fit them with proportional damping"
        )
    return _Mode(int(number), float(hz), float(zeta) + float(loss) / 2, float(mass), shape.real, apart)


def _rigid(table: Array, dofs: DofTable, nodes: Nodes) -> NDArray[np.bool_]:
    """Modes that move the nodes as a rigid body does: programs compute their frequencies as almost zero."""
    R = rigid_body_shapes(dofs, nodes, nodes.xyz.mean(axis=0))
    size = np.linalg.norm(table, axis=0)
    left = np.linalg.norm(table - R @ np.linalg.lstsq(R, table, rcond=None)[0], axis=0)
    # A mode that no node shows is none of them.
    return np.asarray((left <= _RIGID * size) & (size > _ROUNDING * size.max(initial=0.0)))
