"""MBDyn: scene.mbd, which runs as it is, and the .fem file of each body beside it.

Source: the input manual of MBDyn 1.7.3 (structural nodes, joints, forces, drive callers), and runs of that version.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from cmsreduce.model import MultibodyScene, RigidBody, SceneBody
from cmsreduce.write.component import read_component, stored_integrals
from cmsreduce.write.export.body_frame import BodyFrame
from cmsreduce.write.export.first_slew import FirstSlew, first_slew
from cmsreduce.write.export.mbdyn_channels import actuator_laws, add_actuator, add_sensor
from cmsreduce.write.export.mbdyn_input import MbdynInput, matrix, real, vector
from cmsreduce.write.export.mbdyn_joints import add_ground, add_joint
from cmsreduce.write.files import put_lines
from cmsreduce.write.targets import write_mbdyn

__all__ = ["write_mbdyn_scene"]

# Newton's residual relative to the largest effort: four digits above round-off.
_TOLERANCE = 1e-8
# Spectral radius of the integrator: 1 keeps all energy, less damps what the step does not resolve.
_RADIUS = 0.9


def write_mbdyn_scene(folder: Path, scene: MultibodyScene) -> tuple[Path, ...]:
    """Write scene.mbd and a .fem file for each body that differs from the others.

    Parameters
    ----------
    folder : Path
        Folder of the files.
    scene : MultibodyScene
        In the configuration in which the simulation starts, at rest.

    Returns
    -------
    tuple of Path
        scene.mbd first.

    Raises
    ------
    WriteError
        If a body, a joint or a channel has no form in MBDyn.
    """
    deck = MbdynInput(scene, {body.name: BodyFrame.of(body) for body in scene.bodies})
    slew = first_slew(scene)
    files = {body.file: folder / f"{body.file.stem}.fem" for body in scene.bodies if body.file is not None}
    lines = list(_lines(deck, slew, {file: path.name for file, path in files.items()}))
    for file, path in files.items():
        component = read_component(file)
        write_mbdyn(path, component, stored_integrals(component), "points")
    path = folder / "scene.mbd"
    put_lines(path, "\n".join(lines).split("\n"))
    return (path, *files.values())


def _lines(deck: MbdynInput, slew: FirstSlew, fem: Mapping[Path, str]) -> Iterator[str]:
    """The input file; elements are made first, because nodes follow from what attaches to them."""
    scene = deck.scene
    for body in scene.bodies:
        deck.label("body", body.name, f"body {body.name}")
    laws = list(actuator_laws(deck, slew))
    for body in scene.bodies:
        if body.rigid is not None:
            _add_rigid(deck, body, body.rigid)
    for point in scene.ground:
        add_ground(deck, point)
    for joint in scene.joints:
        add_joint(deck, joint)
    for channel in scene.actuators:
        add_actuator(deck, channel)
    for channel in scene.sensors:
        add_sensor(deck, channel)
    for body in scene.bodies:
        if body.file is not None:
            _add_flexible(deck, body, fem[body.file])
    yield from _head(deck, slew)
    yield "# Labels in the output files."
    for number, (label, about) in enumerate(deck.labels.items(), start=1):
        yield f"set: const integer {label} = {number}; # {about}"
    yield from _problem(deck)
    yield from ("", "# Efforts of the actuators over time.", *laws)
    yield from ("", "begin: nodes;", *(f"    {card}" for card in deck.node_cards()), "end: nodes;")
    yield from ("", "begin: elements;", *(f"    {card}" for card in (*deck.elements, *deck.drives)), "end: elements;")


def _head(deck: MbdynInput, slew: FirstSlew) -> Iterator[str]:
    from cmsreduce import __version__

    scene, units = deck.scene, deck.scene.scene.units.name
    yield f"# Scene '{scene.name}' for MBDyn, at rest in the configuration '{scene.configuration.name}'."
    yield "#"
    yield "# mbdyn -f scene.mbd runs a first slew. Change SECONDS, STEP and the laws of the actuators."
    yield "# scene.mod: label.mode, amplitude, rate and acceleration of each mode, at each step."
    yield "# scene.mov: label, place, rotation vector, velocity and angular velocity of each node."
    yield "# scene.drv: label and value of each sensor."
    yield f"# Written by cmsreduce {__version__} for MBDyn 1.7.3. Units {units}, angles in radians."
    yield ""
    yield f"# {slew.seconds_why}"
    yield f"set: const real SECONDS = {real(slew.seconds)};"
    yield f"# {slew.step_why}"
    yield f"set: const real STEP = {real(slew.step)};"
    yield "# Largest residual, in the units of the efforts."
    yield f"set: const real TOLERANCE = {real(_TOLERANCE * (slew.effort or 1.0))};"
    yield ""


def _problem(deck: MbdynInput) -> Iterator[str]:
    counts = {"structural nodes": len(deck.node_cards()), **deck.counts}
    yield f"""
begin: data;
    problem: initial value;
end: data;

begin: initial value;
    initial time: 0.;
    final time: SECONDS;
    time step: STEP;
    method: ms, {_RADIUS};
    tolerance: TOLERANCE;
    max iterations: 50;
    derivatives coefficient: 1.e-6;
    derivatives tolerance: 1.e3*TOLERANCE;
    derivatives max iterations: 50;
    linear solver: umfpack;
end: initial value;

begin: control data;"""
    yield from (f"    {what}: {number};" for what, number in counts.items())
    yield """    # Every part is in its place already.
    skip initial joint assembly;
    default orientation: orientation vector;
    output precision: 16;
end: control data;"""


def _add_rigid(deck: MbdynInput, body: SceneBody, rigid: RigidBody) -> None:
    label = deck.label("body", body.name)
    at = vector(deck.scene.in_scene(body.name, rigid.cg))
    deck.carriers[label] = f"dynamic, {at}, {matrix(body.placement.rotation)}, null, null"
    inertia = ", ".join(real(value) for value in rigid.inertia.ravel())
    deck.element("body", label, f"{label}, {real(rigid.mass)}, null, matr, {inertia}")


def _add_flexible(deck: MbdynInput, body: SceneBody, fem: str) -> None:
    """The modal joint, and the node of its frame where that floats."""
    label, frame = deck.label("body", body.name), deck.frames[body.name]
    assert frame.reduced is not None
    at = vector(deck.scene.in_scene(body.name, frame.origin))
    turned = matrix(body.placement.rotation @ frame.axes.T)
    carrier = f"clamped, position, {at}, orientation, {turned}"
    if not frame.held:
        deck.carriers[label] = f"modal, {at}, {turned}, null, null"
        carrier = label
    nodes = deck.attached.get(body.name, {})
    ends = "".join(f', "{node}", {place.node}, null' for node, place in nodes.items())
    # Without invariant 9, neither inertia nor forces of a spin grow by squares of the deformation.
    shapes = f'{frame.reduced.k}, from file, damping from file, "{fem}", {len(nodes)}{ends}, use invariant 9'
    deck.element("joint", label, f"modal, {carrier}, {shapes}")
