"""42 (NASA): a folder of input files, which 42 runs as it is.

Source: the readers of 42 (commit 11e3cc3; 42init.c, 42cmd.c, iokit), which take values by their order in the file, and
runs of that version.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import MultibodyScene
from cmsreduce.write.export.body_frame import rendered
from cmsreduce.write.export.channels42 import Thruster, command_lines, sensor_table, thrusters
from cmsreduce.write.export.first_slew import FirstSlew, first_slew
from cmsreduce.write.export.spacecraft42 import spacecraft
from cmsreduce.write.export.surroundings42 import SURROUNDINGS, heading, plain, row, simulation_lines, values, vector
from cmsreduce.write.export.tree42 import Hinge, Part, Spacecraft, euler
from cmsreduce.write.files import put_lines
from cmsreduce.write.targets import write_42

__all__ = ["write_42_scene"]

# Of a Runge-Kutta step of fourth order, times the largest angular frequency: the limit of stability is 2.8.
_STEP_TIMES_OMEGA = 1.0
_WORD = 20  # characters of a name of a body in the name of a file, which has 39

Array = NDArray[np.float64]


def write_42_scene(folder: Path, scene: MultibodyScene) -> tuple[Path, ...]:
    """Write the files that 42 reads, and scene.py, which commands its thrusters and reads the sensors from its output.

    Parameters
    ----------
    folder : Path
        Folder of the files.
    scene : MultibodyScene
        In the configuration in which the simulation starts, at rest.

    Returns
    -------
    tuple of Path
        Inp_Sim.txt first.

    Raises
    ------
    WriteError
        If a body, a joint or a channel has no form in 42.
    """
    tree = spacecraft(scene)
    slew = first_slew(scene)
    step = _step(tree, slew)
    largest = {each.name: _largest(slew.effort if each.name == slew.actuator else 1.0) for each in scene.actuators}
    thrusts = thrusters(tree, largest)
    table = [(each.actuator, each.sign, largest[each.actuator]) for each in thrusts]
    laws = {name: (slew.law if name == slew.actuator else _off) for name in largest}
    texts: dict[str, Sequence[str]] = {
        "Inp_Sim.txt": list(simulation_lines(scene.name, slew.seconds, step)),
        "SC_Scene.txt": list(_spacecraft(tree, thrusts, step)),
        "Inp_Cmd.txt": list(command_lines(table, laws, slew.seconds, step)),
        "Inp_ScOutput.txt": list(_outputs(step)),
        "scene.py": _script(tree, slew, table),
        **SURROUNDINGS,
    }
    for index, part in enumerate(tree.parts):
        if part.nodes and part.file is None:
            texts[_nodes_name(index)] = list(_nodes(part))
    for index, hinge in enumerate(tree.hinges):
        if hinge.has_elements:
            texts[_hinge_name(index)] = list(_elements(hinge))
    written = [folder / name for name in texts]
    for path, lines in zip(written, texts.values(), strict=True):
        put_lines(path, "\n".join(lines).split("\n"))
    for index, part in enumerate(tree.parts):
        if part.file is not None and part.modes is not None:
            written += write_42(folder / _flex_name(index, part), part.file, part.modes.integrals, part.joints)
    return tuple(written)


def _step(tree: Spacecraft, slew: FirstSlew) -> float:
    """Step of a slew that resolves the band, and in which the highest mode of a body is stable."""
    highest = max((part.modes.omega.max(initial=0.0) for part in tree.parts if part.modes is not None), default=0.0)
    step = min(slew.step, _STEP_TIMES_OMEGA / highest) if highest else slew.step
    return float(slew.seconds / np.ceil(slew.seconds / step))


def _outputs(step: float) -> Iterator[str]:
    """Attitudes and rates of all parts, at every step."""
    yield "42: outputs of the spacecraft"
    for what in ("Sc", "ScB", "ScG", "ScWhl", "ScGyro", "ScShaker"):
        yield row(f"{what} Enabled, Interval", "TRUE" if what in ("Sc", "ScB") else "FALSE", float(step))


def _spacecraft(tree: Spacecraft, thrusts: list[Thruster], step: float) -> Iterator[str]:
    from scipy.spatial.transform import Rotation

    base = tree.parts[0]
    yield "42: spacecraft"
    yield row("Description", plain(tree.scene.name, 40) or "-")
    yield row("Label", '"S/C"')
    yield row("Sprite File Name", "NONE")
    yield row("Flight Software Identifier", "PASSIVE_FSW")
    yield row("FSW Sample Time, sec", float(step))
    yield heading("Orbit Parameters")
    yield row("Orbit Prop FIXED, EULER_HILL, ENCKE, or COWELL", "ENCKE")
    yield row("Pos of CM or ORIGIN, wrt F", "CM")
    yield row("Pos wrt Formation (m), expressed in F", 0.0, 0.0, 0.0)
    yield row("Vel wrt Formation (m/s), expressed in F", 0.0, 0.0, 0.0)
    yield heading("Initial Attitude")
    yield row("Ang Vel wrt [NL], Att [QA] wrt [NLF]", "NQN")
    yield row("Ang Vel (deg/sec)", 0.0, 0.0, 0.0)
    # 42 turns frames: the quaternion of scipy for the transposed matrix, scalar last in both.
    yield vector("Quaternion", Rotation.from_matrix(base.axes.T).as_quat())
    yield row("Angles (deg) & Euler Sequence", 0.0, 0.0, 0.0, 213)
    yield heading("Dynamics Flags")
    yield row("Solve Dynamics by GAUSS_ELIM or ORDER_N", "GAUSS_ELIM")
    yield row("Compute Constraint Forces and Torques", "FALSE")
    yield row("Mass Props referenced to REFPT_CM or REFPT_JOINT", "REFPT_CM")
    yield row("Flex Active", "TRUE" if tree.modes else "FALSE")
    yield row("Include 2nd Order Flex Terms", "TRUE" if tree.modes else "FALSE")
    yield row("Shaker File Name", "NONE")
    yield row("Drag Coefficient", 0.0)
    yield from (heading(""), heading("Body Parameters"), heading(""))
    yield row("Number of Bodies", len(tree.parts))
    for index, part in enumerate(tree.parts):
        yield from _part(index, part)
    yield from (heading(""), heading("Joint Parameters"), heading(""))
    yield "(Number of Joints is Number of Bodies minus one)"
    for index, hinge in enumerate(tree.hinges):
        yield from _hinge(index, hinge)
    if not tree.hinges:
        yield from ["none"] * 16
    yield heading("Wheel Parameters")
    yield row("Wheel Drag Active", "FALSE")
    yield row("Wheel Jitter Active", "FALSE")
    yield from _none("wheels", 8)
    yield heading("MTB Parameters")
    yield from _none("MTBs", 4)
    yield heading("Thruster Parameters")
    if not thrusts:
        yield from _none("Thrusters", 6)
    else:
        yield row("Number of Thrusters", len(thrusts))
    for index, each in enumerate(thrusts):
        yield f"====  Thr {index}: {plain(each.actuator, 40)} {each.sign:+d}  ===="
        yield row("Mode (PULSED or PROPORTIONAL)", "PROPORTIONAL")
        yield row("Thrust Force (N)", each.force)
        yield vector("Thrust Axis", each.axis)
        yield row("Body", each.part)
        yield row("Node", each.node)
    sensors = {"Gyro": 11, "Magnetometer": 8, "Coarse Sun Sensor": 8, "Fine Sun Sensor": 8, "Star Tracker": 8, "GPS": 6}
    for what, lines in (sensors | {"Accelerometer": 11, "Fine Guidance Sensor": 7}).items():
        yield heading(what)
        yield from _none(what, lines)


def _none(what: str, lines: int) -> Iterator[str]:
    """No item of a kind: 42 skips the lines of one."""
    yield row(f"Number of {what}", 0)
    yield from ["none"] * lines


def _part(index: int, part: Part) -> Iterator[str]:
    J = part.inertia
    yield f"====  Body {index}: {plain(part.name, 60)}  ===="
    yield row("Mass", float(part.mass))
    yield vector("Moments of Inertia (kg-m^2)", J.diagonal())
    yield vector("Products of Inertia (xy,xz,yz)", -J[[0, 0, 1], [1, 2, 2]])
    yield row("Location of mass center, m", 0.0, 0.0, 0.0)
    yield row("Constant Embedded Momentum (Nms)", 0.0, 0.0, 0.0)
    yield row("Constant Embedded Magnetic Dipole (A-m^2)", 0.0, 0.0, 0.0)
    yield row("Geometry Input File Name", "Point.obj")
    flexible = part.file is not None
    nodes = (
        _flex_name(index, part).replace("Flex_", "Nodes_") if flexible else _nodes_name(index) if part.nodes else "NONE"
    )
    yield row("Node File Name", nodes)
    yield row("Flex File Name", _flex_name(index, part) if flexible else "NONE")


def _hinge(index: int, hinge: Hinge) -> Iterator[str]:
    turns, slides = ((*axes, *sorted({0, 1, 2} - set(axes))) for axes in (hinge.turns, hinge.slides))
    angles, places = (np.pad(start, (0, 3 - len(start))) for start in (hinge.angles, hinge.places))
    yield f"====  Joint {index}: {plain(hinge.name, 60)}  ===="
    yield row("Type of joint (PASSIVE, ACTUATED, others)", "PASSIVE")
    yield row("Inner, outer body indices", hinge.inner, hinge.outer)
    kind = "SPHERICAL" if len(hinge.turns) == 3 else "GIMBAL"
    yield row("RotDOF, Seq, GIMBAL or SPHERICAL", len(hinge.turns), "".join(str(axis + 1) for axis in turns), kind)
    yield row("TrnDOF, Seq", len(hinge.slides), "".join(str(axis + 1) for axis in slides))
    yield row("RotDOF Locked", "FALSE", "FALSE", "FALSE")
    yield row("TrnDOF Locked", "FALSE", "FALSE", "FALSE")
    yield vector("Initial Angles [deg]", np.rad2deg(angles))
    yield row("Initial Rates, deg/sec", 0.0, 0.0, 0.0)
    yield vector("Initial Displacements [m]", places)
    yield row("Initial Displacement Rates, m/sec", 0.0, 0.0, 0.0)
    yield row("Bi to Gi Static Angles [deg] & Seq", *euler(hinge.inner_axes), 321)
    # From the joint to the body: the other way round.
    yield row("Go to Bo Static Angles [deg] & Seq", *euler(hinge.outer_axes.T), 321)
    yield vector("Position wrt inner body origin, m", hinge.inner_place)
    yield vector("Position wrt outer body origin, m", hinge.outer_place)
    yield row("Parameter File Name", _hinge_name(index) if hinge.has_elements else "NONE")


def _elements(hinge: Hinge) -> Iterator[str]:
    yield "42: passive joint"
    yield plain(hinge.name, 60) or "-"
    unlike = len(hinge.turns) == 3 and len(set(hinge.rotation_spring)) > 1
    limit = "; unlike springs do not keep the energy" if unlike else ""
    yield heading(f"in the order of its motions{limit}")
    for about, coefficients in (
        ("Rotational spring coefficients, N-m/rad", hinge.rotation_spring),
        ("Rotational damping coefficients, N-m-s/rad", hinge.rotation_damper),
        ("Translational spring coefficients, N/m", hinge.slide_spring),
        ("Translational damping coefficients, N-s/m", hinge.slide_damper),
    ):
        yield vector(about, np.pad(coefficients, (0, 3 - len(coefficients))))


def _nodes(part: Part) -> Iterator[str]:
    yield "42: nodes of a body"
    yield row("Description", plain(part.name, 40))
    yield row("Number of Nodes", len(part.nodes))
    yield heading("Node Location, Comment")
    for place, comment in part.nodes:
        yield f'{values(*(float(value) + 0.0 for value in place))}  "{plain(comment, 30)}"'


def _script(tree: Spacecraft, slew: FirstSlew, table: list[tuple[str, int, float]]) -> Sequence[str]:
    """scene.py: laws of the actuators, and sensors from the output of 42."""
    sensors = dict(sensor_table(tree))
    parts = [f"{part.name}" + ("" if part.mass else ", a hub without mass") for part in tree.parts]
    return rendered(
        "scene42.py.j2",
        title=f"Scene '{tree.scene.name}' in 42, from the configuration '{tree.scene.configuration.name}'.",
        effort=repr(slew.effort),
        seconds=repr(slew.seconds),
        laws=[(repr(each.name), each.name == slew.actuator) for each in tree.scene.actuators],
        thrusters=table,
        parts=parts,
        modes=[(part.name, part.modes.k) for part in tree.parts if part.modes is not None],
        sensors={name: terms for name, terms in sensors.items() if not isinstance(terms, str)},
        missing={name: why for name, why in sensors.items() if isinstance(why, str)},
        source=inspect.getsource(command_lines),
    ).splitlines()


def _largest(effort: float) -> float:
    """Effort at which thrusters have their largest force: a power of ten, well above that of the first slew."""
    return float(10.0 ** (np.ceil(np.log10(abs(effort) or 1.0)) + 1))


def _off(_: float) -> float:
    return 0.0


def _nodes_name(index: int) -> str:
    return f"Nodes_{index}.txt"


def _hinge_name(index: int) -> str:
    return f"Joint_{index}.txt"


def _flex_name(index: int, part: Part) -> str:
    return f"Flex_{index}_{re.sub(r'[^A-Za-z0-9]', '_', part.name)[:_WORD]}.txt"
