"""Mass of one body by its consistent and its lumped mass matrices, and the frame that its file is written in."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble import outboard_masses
from cmsreduce.config import BASIC, CENTRE
from cmsreduce.errors import SceneError
from cmsreduce.mechanics import REMOVED, floating_frame, moves_generalised, rigid_mass
from cmsreduce.model import (
    LUMPINGS,
    FEModel,
    Finding,
    FloatingFrame,
    IntegralFrame,
    OutboardMass,
    RigidBody,
)
from cmsreduce.pipeline.run import Run
from cmsreduce.report import InspectedLine, number, numbers
from cmsreduce.verify import mass_change, rigid_mass_properties
from cmsreduce.write import ComponentFile

__all__ = [
    "body_totals",
    "file_totals",
    "frame_checks",
    "frame_lines",
    "frame_of",
    "integral_frame_of",
    "outboard_of",
    "total_data",
    "total_findings",
    "total_lines",
]

Totals = Mapping[str, NDArray[np.float64]]
"""R^T M R (6, 6) about the basic origin by kind of mass matrix, the consistent one first."""

_STORED = {
    "consistent": "integrals/rigid_mass",
    "row-sum": "integrals/rigid_mass_row_sum",
    "diagonal": "integrals/rigid_mass_diagonal",
}


def body_totals(body: FEModel) -> Totals:
    """Totals of a body; empty for a body without geometry or without mass."""
    if body.nodes is None or not body.M.nnz:
        return {}
    # The mass of generalised coordinates has no place among the nodes, so it cannot be lumped.
    lumpings = LUMPINGS[:1] if moves_generalised(body) else LUMPINGS
    return {lumping: rigid_mass(body, lumping=lumping) for lumping in lumpings}


def file_totals(file: ComponentFile) -> Totals:
    """Totals of a component file, those that it holds; files of early versions have only the consistent one."""
    return {lumping: file.arrays[path] for lumping, path in _STORED.items() if path in file.arrays}


def total_lines(totals: Totals) -> Iterator[InspectedLine]:
    """Each total, and the differences of the lumped ones from the consistent one."""
    for lumping, rigid in totals.items():
        found = rigid_mass_properties(rigid)
        differences = ""
        if lumping != "consistent":
            change = mass_change(totals["consistent"], rigid)
            differences = "; differences " + ", ".join(f"{what} {value:.2e}" for what, value in change.items())
        yield InspectedLine(
            f"{lumping} mass {number(found.mass.max(initial=0.0), 9)}, centre of mass {numbers(found.cg)}, inertia "
            f"about it {numbers(found.inertia.diagonal())}{differences}"
        )


def total_data(totals: Totals) -> dict[str, Any]:
    """Mass, centre of mass and inertia about it by each mass matrix, as plain values."""
    found = {lumping: rigid_mass_properties(rigid) for lumping, rigid in totals.items()}
    return {
        lumping: {
            "mass": float(part.mass.max(initial=0.0)),
            "centre_of_mass": part.cg.tolist(),
            "inertia": part.inertia.tolist(),
        }
        for lumping, part in found.items()
    }


def total_findings(name: str, totals: Totals) -> Iterator[Finding]:
    """Differences of the lumped inertias from the consistent one, without a limit."""
    for lumping, rigid in totals.items():
        if lumping == "consistent":
            continue
        change = mass_change(totals["consistent"], rigid)
        note = ", ".join(f"{what} {value:.2e} off" for what, value in change.items() if what != "inertia")
        figure = f"inertia of the {lumping} mass against the consistent one"
        yield Finding(figure, change["inertia"], note=note, subject=name)


def frame_of(run: Run, name: str) -> FloatingFrame | None:
    """Floating frame that a body of a run is written in; None where the pipeline asks for none.

    Raises
    ------
    FloatingFrameError
        If the body has not six rigid motions, or its frame does not determine them.
    """
    keys = run.pipeline.write_of(name)
    if keys.frame is None:
        return None
    component = run.written(name)
    return floating_frame(
        component.body, component.Phi, component.rigid_count, keys.frame.condition(), keys.integrals.mass
    )


def frame_checks(frame: FloatingFrame | None) -> tuple[Finding, ...]:
    """Check that the modes hold no rigid motion of the frame that they are written in."""
    if frame is None:
        return ()
    return (Finding(f"rigid motion left in the modes: {frame.condition}", frame.residual, REMOVED),)


def integral_frame_of(run: Run, name: str, frame: FloatingFrame | None) -> IntegralFrame:
    """Point, axes and mass matrix of the modal integrals of a body of a run.

    Without a point or axes in the keys they are those of the floating frame.
    """
    body, keys = run.written(name).body, run.pipeline.write_of(name).integrals
    plain = IntegralFrame.basic(keys.mass)
    if body.nodes is None:
        return plain
    about, origin, axes = plain.about, plain.origin, plain.axes
    if keys.about is None and frame is not None:
        about, origin = f"origin of the floating frame: {frame.condition}", frame.origin
    elif keys.about == CENTRE:
        about, origin = "centre of mass", rigid_mass_properties(rigid_mass(body, lumping=keys.mass)).cg
    elif isinstance(keys.about, tuple):
        own = run.pipeline.components[name].units_in(run.scene.units)
        about, origin = "point given", np.array(keys.about) * own.length / run.scene.units.length
    elif keys.about not in (None, BASIC):
        about, origin = f"interface {keys.about}", body.interfaces[str(keys.about)].position[0]
    if keys.axes is None and frame is not None:
        axes = frame.axes
    elif keys.axes not in (None, BASIC):
        axes = body.interfaces[str(keys.axes)].frame
    return IntegralFrame(about, origin, axes, keys.mass)


def outboard_of(run: Run, name: str) -> tuple[OutboardMass, ...]:
    """Masses outboard of the interfaces of a body; empty, with a note, where one of them is not known."""
    bodies: dict[str, FEModel | RigidBody] = {other: flexible.body for other, flexible in run.bodies.items()}
    try:
        return outboard_masses(run.bodies[name].body, {**bodies, **run.rigid_bodies}, run.scene)
    except SceneError as error:
        run.stages.note(f"{name}: the mass outboard of it is not in its file: {error}")
        return ()


def frame_lines(file: ComponentFile) -> Iterator[InspectedLine]:
    """Support of a component file, point and mass matrix of its integrals, and masses outboard of its interfaces."""
    if "support" in file.attributes[""]:
        yield InspectedLine(str(file.attributes[""]["support"]))
    integrals = file.attributes.get("integrals", {})
    if "lumping" in integrals and "about" in integrals:
        yield InspectedLine(f"integrals about {integrals['about']}, mass {integrals['lumping']}")
    if "undetermined" in integrals:
        yield InspectedLine(str(integrals["undetermined"]))
    for path, names in file.texts.items():
        if path.startswith("augmented/"):
            face = path.split("/")[1]
            mass = float(file.arrays[f"augmented/{face}/mass"])
            yield InspectedLine(f"mass {number(mass, 9)} of {', '.join(names) or 'its joint'}", f"outboard of {face}")
