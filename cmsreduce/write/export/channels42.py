"""Actuators and sensors of a scene in 42: thrusters on parts, the script that commands them, and columns of outputs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import WriteError
from cmsreduce.model import FIRST_ROTATION, Channel, JointTerm, PointTerm, StrutTerm
from cmsreduce.write.export.tree42 import Spacecraft

__all__ = ["Thruster", "command_lines", "sensor_table", "thrusters"]

_ARM = 1.0  # metres between the thrusters of a couple

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Thruster:
    """A force on a part that grows with the effort of an actuator of one sign.

    Parameters
    ----------
    actuator : str
        Name of the actuator.
    sign : int
        +1 or -1: thrusters only push, so that each force has two.
    part, node : int
        Number of the part, and of the node on it.
    axis : (3,) float64
        Direction of the force, in the frame of the part.
    force : float
        Force at the largest effort, in newtons.
    """

    actuator: str
    sign: int
    part: int
    node: int
    axis: Array
    force: float


def thrusters(tree: Spacecraft, efforts: dict[str, float]) -> list[Thruster]:
    """Thrusters of all actuators, at nodes that are added to the parts.

    Parameters
    ----------
    tree : Spacecraft
        Tree of the scene.
    efforts : dict of actuator to float
        Largest effort of each.

    Raises
    ------
    WriteError
        If the forces of an actuator would not stay on one line.
    """
    found: list[Thruster] = []
    for channel in tree.scene.actuators:
        for part, at, force, torque in _loads(tree, channel):
            for sign in (1, -1):
                found += _pushes(tree, channel.name, sign, part, at, force * efforts[channel.name])
                found += _couple(tree, channel.name, sign, part, at, torque * efforts[channel.name])
    return found


def _loads(tree: Spacecraft, channel: Channel) -> Iterator[tuple[int, Array, Array, Array]]:
    """Part, place, force and torque in the scene of a unit effort, for each place where it acts."""
    for term in channel.terms:
        match term:
            case PointTerm(point, direction):
                part, at = tree.place(point)
                turned = tree.scene.body(point.body).placement.rotation
                yield part, at, turned @ direction[:FIRST_ROTATION], turned @ direction[FIRST_ROTATION:]
            case JointTerm(joint, dof):
                yield from _joint_loads(tree, channel.name, joint, dof)
            case StrutTerm():
                raise AssertionError("the tree refuses actuators between two points")


def _joint_loads(tree: Spacecraft, name: str, joint: str, dof: int) -> Iterator[tuple[int, Array, Array, Array]]:
    """Opposite efforts on both sides of a joint: on the second interface, and against it on the first one."""
    placed = next(placed for placed in tree.scene.joints if placed.joint.name == joint)
    free = sorted(placed.joint.free)
    turning = [each for each in free if each >= FIRST_ROTATION]
    sliding = [each for each in free if each < FIRST_ROTATION]
    along = dof % FIRST_ROTATION
    stays = (
        all(each - FIRST_ROTATION == along for each in turning)
        if dof >= FIRST_ROTATION
        else sliding == [dof] and all(each - FIRST_ROTATION == along for each in turning)
    )
    if not stays:
        raise WriteError(
            f"actuator '{name}': joint '{joint}' moves in other directions, too, and thrusters of 42 are fixed to the "
            "parts, so that the efforts would not stay opposite; split the joint in two, or export to exudyn or mbdyn"
        )
    first, second = placed.joint.first, placed.joint.second
    turned = tree.scene.body(first.body).placement.rotation
    axis = turned @ placed.first_axes[along]
    zero = np.zeros(3)
    _, at = tree.place(second)
    for point, sign in ((second, 1.0), (first, -1.0)):
        part, _ = tree.place(point)
        yield (part, at, zero, sign * axis) if dof >= FIRST_ROTATION else (part, at, sign * axis, zero)


def _pushes(tree: Spacecraft, name: str, sign: int, part: int, at: Array, force: Array) -> Iterator[Thruster]:
    size = float(np.linalg.norm(force))
    if size:
        carrier = tree.parts[part]
        node = _node(tree, part, carrier.local(at), name)
        yield Thruster(name, sign, part, node, sign * (carrier.axes @ force) / size, size)


def _couple(tree: Spacecraft, name: str, sign: int, part: int, at: Array, torque: Array) -> Iterator[Thruster]:
    """Two forces at right angles to the torque, an arm apart."""
    size = float(np.linalg.norm(torque))
    if not size:
        return
    carrier = tree.parts[part]
    about = sign * (carrier.axes @ torque) / size
    arm = np.cross(about, np.eye(3)[np.argmin(abs(about))])
    arm /= np.linalg.norm(arm)
    push = np.cross(about, arm)
    for side in (0.5, -0.5):
        node = _node(tree, part, carrier.local(at) + side * _ARM * arm, name)
        yield Thruster(name, sign, part, node, np.sign(side) * push, size / _ARM)


def _node(tree: Spacecraft, part: int, at: Array, name: str) -> int:
    nodes = tree.parts[part].nodes
    for index, (place, _) in enumerate(nodes):
        if np.array_equal(place, at):
            return index
    nodes.append((at, name))
    return len(nodes) - 1


def command_lines(
    thrusters: Sequence[tuple[str, int, float]],
    laws: Mapping[str, Callable[[float], float]],
    seconds: float,
    step: float,
) -> Iterator[str]:
    """Script that commands thrusters, for laws of efforts over time; scene.py holds this function as text.

    42 takes a command between two steps and obeys it in the next step but one: the first two steps obey the one at
    time 0. A thrust is constant in a step: that of its middle. Thrusters are rows of actuator, sign and the effort at
    which they have their largest force.
    """
    yield "42: level of each thruster over time; level 1 is the force in SC_Scene.txt"
    on: dict[int, float] = {}
    for k in range(round(seconds / step)):
        middle = (k + 1.5) * step if k else step
        for index, (actuator, sign, largest) in enumerate(thrusters):
            level = max(sign * laws[actuator](middle) / largest, 0.0) + 0.0
            if level > 1:
                raise ValueError(
                    f"the effort of {actuator} is above {largest}: enlarge it, and the forces in SC_Scene.txt"
                )
            if level != on.get(index, 0.0):
                on[index] = level
                yield f"{k * step:.9g} SC[0].AC.Thr[{index}].ThrustLevelCmd = {level:.12g}"
    yield "EOF"


def sensor_table(tree: Spacecraft) -> Iterator[tuple[str, list[tuple[str, int, list[float]]] | str]]:
    """Where each sensor is in the output of 42, for scene.py; or the reason why it is not there.

    A term is a file, a column from 0 and a weight: joints in ``u`` (rates) and ``x``; or ``rate`` and ``turn``, the
    number of a part and the weights of its angular velocities.
    """
    for channel in tree.scene.sensors:
        found: list[tuple[str, int, list[float]]] = []
        why = ""
        for term in channel.terms:
            match term:
                case JointTerm(joint, dof):
                    index, hinge = tree.hinge_of(joint)
                    turns = dof >= FIRST_ROTATION
                    if turns and len(hinge.turns) == 3:
                        why = f"42 writes a quaternion for joint {joint}"
                        continue
                    among = hinge.turns if turns else hinge.slides
                    u, x = _columns(tree)[index][turns]
                    k = among.index(dof % FIRST_ROTATION)
                    found.append(
                        ("u", u + k, [float(hinge.sign)]) if channel.rate else ("x", x + k, [float(hinge.sign)])
                    )
                case PointTerm(point, direction):
                    if direction[:FIRST_ROTATION].any():
                        why = f"42 writes no translation of {point}"
                        continue
                    part, _ = tree.place(point)
                    turned = tree.scene.body(point.body).placement.rotation
                    about = tree.parts[part].axes @ turned @ direction[FIRST_ROTATION:]
                    found.append(("rate" if channel.rate else "turn", part, (about + 0.0).tolist()))
                case StrutTerm(a, b):
                    why = f"42 writes no distance of {a} and {b}"
        yield channel.name, why or found


def _columns(tree: Spacecraft) -> list[dict[bool, tuple[int, int]]]:
    """First columns of u.42 and x.42, from 0, of the slides (False) and the rotations (True) of each hinge."""
    u, x = 3, 4
    found = []
    for hinge in tree.hinges:
        turns, slides = len(hinge.turns), len(hinge.slides)
        quaternion = turns == 3
        found.append({True: (u, x), False: (u + turns, x + turns + quaternion)})
        u += turns + slides
        x += turns + slides + quaternion
    return found
