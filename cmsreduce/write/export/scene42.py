"""42 (NASA): a folder of input files, which 42 runs as it is.

Source: the readers of 42 (commit 11e3cc3; 42init.c, 42cmd.c, iokit), which take values by their order in the file, and
runs of that version.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator, Sequence
from importlib.resources import files
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import MultibodyScene
from cmsreduce.write.export.channels42 import Thruster, command_lines, sensor_table, thrusters
from cmsreduce.write.export.first_slew import FirstSlew, first_slew
from cmsreduce.write.export.spacecraft42 import Hinge, Part, Spacecraft, euler, spacecraft
from cmsreduce.write.files import number, put_lines
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
        "Inp_Sim.txt": list(_simulation(scene, slew, step)),
        "SC_Scene.txt": list(_spacecraft(tree, thrusts, step)),
        "Orb_Far.txt": _ORBIT,
        "Inp_Cmd.txt": list(command_lines(table, laws, slew.seconds, step)),  # type: ignore[no-untyped-call]
        "Inp_ScOutput.txt": list(_outputs(step)),
        "scene.py": _script(tree, slew, table),
        **_OTHERS,
    }
    for index, part in enumerate(tree.parts):
        if part.nodes and part.file is None:
            texts[_nodes_name(index)] = list(_nodes(part))
    for index, hinge in enumerate(tree.hinges):
        if hinge.has_elements:
            texts[_hinge_name(index)] = list(_elements(hinge))
    written = [folder / name for name in texts]
    for path, lines in zip(written, texts.values(), strict=True):
        put_lines(path, lines)
    for index, part in enumerate(tree.parts):
        if part.file is not None and part.modes is not None:
            written += write_42(folder / _flex_name(index, part), part.file, part.modes.integrals, part.joints)
    return tuple(written)


def _step(tree: Spacecraft, slew: FirstSlew) -> float:
    """Step of a slew that resolves the band, and in which the highest mode of a body is stable."""
    highest = max((part.modes.omega.max(initial=0.0) for part in tree.parts if part.modes is not None), default=0.0)
    step = min(slew.step, _STEP_TIMES_OMEGA / highest) if highest else slew.step
    return float(slew.seconds / np.ceil(slew.seconds / step))


def _values(*values: float | str | int) -> str:
    return "  ".join(number(value) if isinstance(value, float) else str(value) for value in values)


def _row(about: str, *values: float | str | int) -> str:
    """Values, and what they are: 42 reads the rest of a line as a comment of at most 119 characters."""
    return f"{_values(*values)}  ! {about}"


def _vector(about: str, values: Sequence[float] | Array) -> str:
    return _row(about, *(float(value) + 0.0 for value in values))


def _heading(text: str) -> str:
    return f" {text} ".center(72, "*")


def _simulation(scene: MultibodyScene, slew: FirstSlew, step: float) -> Iterator[str]:
    from cmsreduce import __version__

    yield f"42: scene of cmsreduce {__version__}, {_plain(scene.name, 40)}"
    yield _heading("Simulation Control")
    yield _row("Time Mode", "FAST")
    yield _row("Sim Duration, Step Size [sec]", float(slew.seconds), float(step))
    yield _row("File Output Interval [sec]", float(step))
    yield _row("RNG Seed", 0)
    yield _row("Graphics Front End?", "FALSE")
    yield _row("Command Script File Name", "Inp_Cmd.txt" if slew.actuator else "NONE")
    yield _heading("Reference Orbits")
    yield _row("Number of Reference Orbits", 1)
    yield _row("Input file name for Orb 0", "TRUE", "Orb_Far.txt")
    yield _heading("Spacecraft")
    yield _row("Number of Spacecraft", 1)
    yield _row("Existence, RefOrb, Input file for SC 0", "TRUE", 0, "SC_Scene.txt")
    yield from _ENVIRONMENT


def _plain(words: str, most: int) -> str:
    return re.sub(r"[^A-Za-z0-9_ .-]", "_", words)[:most]


_ENVIRONMENT = (
    _heading("Environment"),
    _row("Date (UTC) (Month, Day, Year)", "01 01 2025"),
    _row("Time (UTC) (Hr,Min,Sec)", "00 00 0.00"),
    _row("Leap Seconds (sec)", 37.0),
    _row("F10.7, Ap (USER, NOMINAL or TWOSIGMA)", "USER"),
    _row("USER-provided F10.7", 230.0),
    _row("USER-provided Ap", 100.0),
    _row("Magfield (NONE,DIPOLE,IGRF)", "NONE"),
    _row("IGRF Degree and Order", 2, 2),
    _row("Earth Gravity Model N and M", 2, 0),
    _row("Mars Gravity Model N and M", 2, 0),
    _row("Luna Gravity Model N and M", 2, 0),
    _row("Aerodynamic Forces & Torques (Shadows)", "FALSE", "FALSE"),
    _row("Gravity Gradient Torques", "FALSE"),
    _row("Solar Pressure Forces & Torques (Shadows)", "FALSE", "FALSE"),
    _row("Residual Magnetic Moment Torques", "FALSE"),
    _row("Gravity Perturbation Forces", "FALSE"),
    _row("Thruster Plume Forces & Torques", "FALSE"),
    _row("Contact Forces and Torques", "FALSE"),
    _row("CFD Slosh Forces and Torques", "FALSE"),
    _row("Albedo Effect on CSS Measurements", "FALSE"),
    _row("Output Environmental Torques to Files", "FALSE"),
    _heading("Celestial Bodies of Interest"),
    _row("Ephem Option", "MEAN"),
    *(_row(world, "TRUE" if world == "Earth" else "FALSE") for world in ("Mercury", "Venus", "Earth", "Mars")),
    *(_row(world, "FALSE") for world in ("Jupiter", "Saturn", "Uranus", "Neptune", "Pluto", "Asteroids and Comets")),
    _heading("Lagrange Point Systems of Interest"),
    *(_row(system, "FALSE") for system in ("Earth-Moon", "Sun-Earth", "Sun-Jupiter")),
    _heading("Ground Stations"),
    _row("Number of Ground Stations", 0),
)

# So far from the Earth that its gravity changes nothing in a slew. 36 lines follow the type of the orbit.
_ORBIT = (
    "42: orbit of the scene",
    _row("Description", "Far from the Earth"),
    _row("Orbit Type (ZERO, FLIGHT, CENTRAL, THREE_BODY)", "CENTRAL"),
    _heading("if ZERO"),
    _row("World", "EARTH"),
    _row("Use Polyhedron Gravity", "FALSE"),
    _heading("if FLIGHT"),
    _row("Region Number", 0),
    _row("Use Polyhedron Gravity", "FALSE"),
    _heading("if CENTRAL"),
    _row("Orbit Center", "EARTH"),
    _row("Secular Orbit Drift Due to J2", "FALSE"),
    _row("Use Keplerian elements (KEP) or (RV) or FILE", "KEP"),
    _row("Use Peri/Apoapsis (PA) or min alt/ecc (AE)", "PA"),
    _row("Periapsis & Apoapsis Altitude, km", 1.0e6, 1.0e6),
    _row("Min Altitude (km), Eccentricity", 1.0e6, 0.0),
    _row("Inclination (deg)", 0.0),
    _row("Right Ascension of Ascending Node (deg)", 0.0),
    _row("Argument of Periapsis (deg)", 0.0),
    _row("True Anomaly (deg)", 0.0),
    _row("RV Initial Position (km)", 0.0, 0.0, 0.0),
    _row("RV Initial Velocity (km/sec)", 0.0, 0.0, 0.0),
    _row("TLE, TRV, or SPLINE file format", "TRV"),
    _row("File name", '"NONE"'),
    _row("Label to find in TLE or TRV file", '"NONE"'),
    _heading("if THREE_BODY"),
    _row("Lagrange system", "SUNEARTH"),
    _row("Propagate using", "LAGDOF_MODES"),
    _row("Initialize with MODES or XYZ or FILE", "MODES"),
    _row("Libration point", "L2"),
    _row("XY Semi-major axis, km", 0.0),
    _row("Initial XY Phase, deg", 0.0),
    _row("Sense", "CW"),
    _row("Second XY Mode Semi-major Axis, km", 0.0),
    _row("Second XY Mode Initial Phase, deg", 0.0),
    _row("Sense", "CW"),
    _row("Z Semi-axis, km", 0.0),
    _row("Initial Z Phase, deg", 0.0),
    _row("Initial X, Y, Z (Non-dimensional)", 0.0, 0.0, 0.0),
    _row("Initial Xdot, Ydot, Zdot (Non-dimensional)", 0.0, 0.0, 0.0),
    _row("Format, Label to find in file", "TRV", '"NONE"'),
    _row("File name", '"NONE"'),
    _heading("Formation Frame Parameters"),
    _row("Formation Frame Fixed in [NL]", "N"),
    _row("Euler Angles (deg) and Sequence", 0.0, 0.0, 0.0, 123),
    _row("Formation Origin expressed in [NL]", "N"),
    _row("Formation Origin wrt Ref Orbit (m)", 0.0, 0.0, 0.0),
)

_OTHERS: dict[str, Sequence[str]] = {
    "Inp_Region.txt": ("42: regions", _row("Number of Regions", 0)),
    "Inp_TDRS.txt": ("42: relay satellites", *(f'FALSE "TDRS-{k}"  ! Exists, Designation' for k in range(1, 11))),
    "Inp_IPC.txt": ("42: sockets", _row("Number of Sockets", 0)),
    "Inp_AcOutput.txt": (
        "42: outputs of flight software",
        *(_row("Enabled, Interval", "FALSE", 1.0e3) for _ in range(14)),
    ),
}


def _outputs(step: float) -> Iterator[str]:
    """Attitudes and rates of all parts, at every step."""
    yield "42: outputs of the spacecraft"
    for what in ("Sc", "ScB", "ScG", "ScWhl", "ScGyro", "ScShaker"):
        yield _row(f"{what} Enabled, Interval", "TRUE" if what in ("Sc", "ScB") else "FALSE", float(step))


def _spacecraft(tree: Spacecraft, thrusts: list[Thruster], step: float) -> Iterator[str]:
    from scipy.spatial.transform import Rotation

    base = tree.parts[0]
    yield "42: spacecraft"
    yield _row("Description", _plain(tree.scene.name, 40) or "-")
    yield _row("Label", '"S/C"')
    yield _row("Sprite File Name", "NONE")
    yield _row("Flight Software Identifier", "PASSIVE_FSW")
    yield _row("FSW Sample Time, sec", float(step))
    yield _heading("Orbit Parameters")
    yield _row("Orbit Prop FIXED, EULER_HILL, ENCKE, or COWELL", "ENCKE")
    yield _row("Pos of CM or ORIGIN, wrt F", "CM")
    yield _row("Pos wrt Formation (m), expressed in F", 0.0, 0.0, 0.0)
    yield _row("Vel wrt Formation (m/s), expressed in F", 0.0, 0.0, 0.0)
    yield _heading("Initial Attitude")
    yield _row("Ang Vel wrt [NL], Att [QA] wrt [NLF]", "NQN")
    yield _row("Ang Vel (deg/sec)", 0.0, 0.0, 0.0)
    # 42 turns frames: the quaternion of scipy for the transposed matrix, scalar last in both.
    yield _vector("Quaternion", Rotation.from_matrix(base.axes.T).as_quat())
    yield _row("Angles (deg) & Euler Sequence", 0.0, 0.0, 0.0, 213)
    yield _heading("Dynamics Flags")
    yield _row("Solve Dynamics by GAUSS_ELIM or ORDER_N", "GAUSS_ELIM")
    yield _row("Compute Constraint Forces and Torques", "FALSE")
    yield _row("Mass Props referenced to REFPT_CM or REFPT_JOINT", "REFPT_CM")
    yield _row("Flex Active", "TRUE" if tree.modes else "FALSE")
    yield _row("Include 2nd Order Flex Terms", "TRUE" if tree.modes else "FALSE")
    yield _row("Shaker File Name", "NONE")
    yield _row("Drag Coefficient", 0.0)
    yield from (_heading(""), _heading("Body Parameters"), _heading(""))
    yield _row("Number of Bodies", len(tree.parts))
    for index, part in enumerate(tree.parts):
        yield from _part(index, part)
    yield from (_heading(""), _heading("Joint Parameters"), _heading(""))
    yield "(Number of Joints is Number of Bodies minus one)"
    for index, hinge in enumerate(tree.hinges):
        yield from _hinge(index, hinge)
    if not tree.hinges:
        yield from ["none"] * 16
    yield _heading("Wheel Parameters")
    yield _row("Wheel Drag Active", "FALSE")
    yield _row("Wheel Jitter Active", "FALSE")
    yield from _none("wheels", 8)
    yield _heading("MTB Parameters")
    yield from _none("MTBs", 4)
    yield _heading("Thruster Parameters")
    if not thrusts:
        yield from _none("Thrusters", 6)
    else:
        yield _row("Number of Thrusters", len(thrusts))
    for index, each in enumerate(thrusts):
        yield f"====  Thr {index}: {_plain(each.actuator, 40)} {each.sign:+d}  ===="
        yield _row("Mode (PULSED or PROPORTIONAL)", "PROPORTIONAL")
        yield _row("Thrust Force (N)", each.force)
        yield _vector("Thrust Axis", each.axis)
        yield _row("Body", each.part)
        yield _row("Node", each.node)
    sensors = {"Gyro": 11, "Magnetometer": 8, "Coarse Sun Sensor": 8, "Fine Sun Sensor": 8, "Star Tracker": 8, "GPS": 6}
    for what, lines in (sensors | {"Accelerometer": 11, "Fine Guidance Sensor": 7}).items():
        yield _heading(what)
        yield from _none(what, lines)


def _none(what: str, lines: int) -> Iterator[str]:
    """No item of a kind: 42 skips the lines of one."""
    yield _row(f"Number of {what}", 0)
    yield from ["none"] * lines


def _part(index: int, part: Part) -> Iterator[str]:
    J = part.inertia
    yield f"====  Body {index}: {_plain(part.name, 60)}  ===="
    yield _row("Mass", float(part.mass))
    yield _vector("Moments of Inertia (kg-m^2)", J.diagonal())
    yield _vector("Products of Inertia (xy,xz,yz)", -J[[0, 0, 1], [1, 2, 2]])
    yield _row("Location of mass center, m", 0.0, 0.0, 0.0)
    yield _row("Constant Embedded Momentum (Nms)", 0.0, 0.0, 0.0)
    yield _row("Constant Embedded Magnetic Dipole (A-m^2)", 0.0, 0.0, 0.0)
    yield _row("Geometry Input File Name", "Point.obj")
    flexible = part.file is not None
    nodes = (
        _flex_name(index, part).replace("Flex_", "Nodes_") if flexible else _nodes_name(index) if part.nodes else "NONE"
    )
    yield _row("Node File Name", nodes)
    yield _row("Flex File Name", _flex_name(index, part) if flexible else "NONE")


def _hinge(index: int, hinge: Hinge) -> Iterator[str]:
    turns, slides = ((*axes, *sorted({0, 1, 2} - set(axes))) for axes in (hinge.turns, hinge.slides))
    angles, places = (np.pad(values, (0, 3 - len(values))) for values in (hinge.angles, hinge.places))
    yield f"====  Joint {index}: {_plain(hinge.name, 60)}  ===="
    yield _row("Type of joint (PASSIVE, ACTUATED, others)", "PASSIVE")
    yield _row("Inner, outer body indices", hinge.inner, hinge.outer)
    kind = "SPHERICAL" if len(hinge.turns) == 3 else "GIMBAL"
    yield _row("RotDOF, Seq, GIMBAL or SPHERICAL", len(hinge.turns), "".join(str(axis + 1) for axis in turns), kind)
    yield _row("TrnDOF, Seq", len(hinge.slides), "".join(str(axis + 1) for axis in slides))
    yield _row("RotDOF Locked", "FALSE", "FALSE", "FALSE")
    yield _row("TrnDOF Locked", "FALSE", "FALSE", "FALSE")
    yield _vector("Initial Angles [deg]", np.rad2deg(angles))
    yield _row("Initial Rates, deg/sec", 0.0, 0.0, 0.0)
    yield _vector("Initial Displacements [m]", places)
    yield _row("Initial Displacement Rates, m/sec", 0.0, 0.0, 0.0)
    yield _row("Bi to Gi Static Angles [deg] & Seq", *euler(hinge.inner_axes), 321)
    # From the joint to the body: the other way round.
    yield _row("Go to Bo Static Angles [deg] & Seq", *euler(hinge.outer_axes.T), 321)
    yield _vector("Position wrt inner body origin, m", hinge.inner_place)
    yield _vector("Position wrt outer body origin, m", hinge.outer_place)
    yield _row("Parameter File Name", _hinge_name(index) if hinge.has_elements else "NONE")


def _elements(hinge: Hinge) -> Iterator[str]:
    yield "42: passive joint"
    yield _plain(hinge.name, 60) or "-"
    yield _heading("in the order of its motions")
    for about, values in (
        ("Rotational spring coefficients, N-m/rad", hinge.rotation_spring),
        ("Rotational damping coefficients, N-m-s/rad", hinge.rotation_damper),
        ("Translational spring coefficients, N/m", hinge.slide_spring),
        ("Translational damping coefficients, N-s/m", hinge.slide_damper),
    ):
        yield _vector(about, np.pad(values, (0, 3 - len(values))))


def _nodes(part: Part) -> Iterator[str]:
    yield "42: nodes of a body"
    yield _row("Description", _plain(part.name, 40))
    yield _row("Number of Nodes", len(part.nodes))
    yield _heading("Node Location, Comment")
    for place, comment in part.nodes:
        yield f'{_values(*(float(value) + 0.0 for value in place))}  "{_plain(comment, 30)}"'


def _script(tree: Spacecraft, slew: FirstSlew, table: list[tuple[str, int, float]]) -> Sequence[str]:
    """scene.py: laws of the actuators, and sensors from the output of 42."""
    from jinja2 import Environment, StrictUndefined

    from cmsreduce import __version__

    template = files("cmsreduce.write.export").joinpath("scene42.py.j2").read_text(encoding="utf-8")
    environment = Environment(undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    sensors = dict(sensor_table(tree))
    source = re.sub("  # type: ignore.*", "", inspect.getsource(command_lines))
    parts = [f"{part.name}" + ("" if part.mass else ", a hub without mass") for part in tree.parts]
    return (
        environment.from_string(template)
        .render(
            title=f"Scene '{tree.scene.name}' in 42, from the configuration '{tree.scene.configuration.name}'.",
            version=__version__,
            effort=repr(slew.effort),
            seconds=repr(slew.seconds),
            laws=[(repr(each.name), each.name == slew.actuator) for each in tree.scene.actuators],
            thrusters=table,
            parts=parts,
            modes=[(part.name, part.modes.k) for part in tree.parts if part.modes is not None],
            sensors={name: terms for name, terms in sensors.items() if not isinstance(terms, str)},
            missing={name: why for name, why in sensors.items() if isinstance(why, str)},
            source=source,
        )
        .splitlines()
    )


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
