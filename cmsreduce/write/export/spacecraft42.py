"""A scene as the tree of bodies and joints that 42 (NASA) integrates.

Runs of 42 (commit 11e3cc3) decided how the tree is made. A torque of a joint on the node of a flexible body reaches its
modes twice, modes of body 0 are added up from step to step, and no force or rate can be had at a node. So wherever
something attaches to a flexible body, a hub without mass is welded to it: joints, efforts and sensors act on hubs, and
body 0 is rigid.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import WriteError
from cmsreduce.model import (
    FIRST_ROTATION,
    FrameCondition,
    JointTerm,
    MultibodyScene,
    Point,
    PointTerm,
    SceneBody,
    SceneJoint,
    StrutTerm,
)
from cmsreduce.write.component import (
    flexible_body,
    in_frame,
    read_component,
    stored_integrals,
    with_unit_modal_mass,
)
from cmsreduce.write.export.tree42 import Hinge, Part, Spacecraft

__all__ = ["spacecraft"]

_SIX = 6
_MOTIONS = frozenset(range(_SIX))
# Of direction cosines: axes that were not turned differ by round-off.
_TURNED = 1e-9

Array = NDArray[np.float64]


def spacecraft(scene: MultibodyScene) -> Spacecraft:
    """Make the tree of a scene, from the base body outwards.

    Raises
    ------
    WriteError
        If the scene holds what 42 cannot: ground, closed loops, several bodies that float apart, interfaces of several
        nodes, a slope that is not known, units other than SI.
    """
    _check(scene)
    tree = Spacecraft(scene)
    attached = _attached(scene)
    inboard = {placed.outboard: placed for placed in scene.joints}
    (base,) = (body for body in scene.bodies if body.name not in inboard)
    _add_body(tree, base, attached[base.name], None)
    at = 0
    order = [base.name]
    while at < len(order):
        for outer, placed in inboard.items():
            first, second = placed.joint.first, placed.joint.second
            near, far = (second, first) if first.body == outer else (first, second)
            if near.body == order[at]:
                _add_body(tree, scene.body(outer), attached[outer], (placed, near, far))
                order.append(outer)
        at += 1
    return tree


def _check(scene: MultibodyScene) -> None:
    units = scene.scene.units
    if (units.length, units.mass, units.time) != (1.0, 1.0, 1.0):
        raise WriteError(
            f"42 is in SI, and the scene in {units.name}: set `scene: {{units: m-kg-s}}`, and `units: {units.name}` at "
            "each component whose files are in these units"
        )
    held = [str(point) for point in scene.ground] + [body.name for body in scene.bodies if body.grounded]
    if held:
        raise WriteError(f"42 holds no body to the ground, and '{held[0]}' is; export the scene to exudyn or mbdyn")
    loop = [placed.joint.name for placed in scene.joints if placed.closes_loop]
    if loop:
        raise WriteError(f"42 has trees of bodies only, and joint '{loop[0]}' closes a loop; export to exudyn or mbdyn")
    inboard = {placed.outboard for placed in scene.joints}
    roots = [body.name for body in scene.bodies if body.name not in inboard]
    if len(roots) != 1:
        raise WriteError(
            f"a spacecraft of 42 is one tree, and {', '.join(roots)} float apart: join them, or leave out all but one"
        )
    for actuator in scene.actuators:
        if any(isinstance(term, StrutTerm) for term in actuator.terms):
            raise WriteError(
                f"actuator '{actuator.name}': 42 has no force between two points; thrusters are fixed to their bodies"
            )


def _attached(scene: MultibodyScene) -> dict[str, dict[int, bool]]:
    """Nodes of flexible bodies at which something attaches, each with whether it needs the slope of the node."""
    found: dict[str, dict[int, bool]] = {body.name: {} for body in scene.bodies}

    def attach(point: Point, *, turns: bool) -> None:
        body = scene.body(point.body)
        if body.rigid is None:
            nodes = found[point.body]
            node = body.node(point.name)
            nodes[node] = nodes.get(node, False) or turns

    for placed in scene.joints:
        joint = placed.joint
        if len(placed.locked) != 1:
            raise WriteError(
                f"joint '{joint.name}': it joins {len(placed.locked)} pairs of nodes, and a joint of 42 one; tie the "
                "nodes of each interface to one"
            )
        acting = [element.dof for element in joint.elements]
        turns = any(dof >= FIRST_ROTATION for dof in (*placed.locked[0], *acting))
        for point in (joint.first, joint.second):
            attach(point, turns=turns)
    for channel in (*scene.actuators, *scene.sensors):
        for term in channel.terms:
            match term:
                case PointTerm(point, direction):
                    attach(point, turns=bool(np.any(direction[FIRST_ROTATION:])))
                case JointTerm() | StrutTerm():
                    pass
    return found


def _add_body(
    tree: Spacecraft, body: SceneBody, nodes: dict[int, bool], joint: tuple[SceneJoint, Point, Point] | None
) -> None:
    """Add a body with its hubs, and the joint that carries it."""
    place = body.placement
    if body.rigid is not None:
        rigid = body.rigid
        origin = tree.scene.in_scene(body.name, rigid.cg)
        number = tree.add(Part(body.name, origin, place.rotation.T, rigid.mass, rigid.inertia))
        tree.bodies[body.name] = number
        if joint is not None:
            _add_joint(tree, *joint)
        return
    part = _flexible(body)
    part.origin = tree.scene.in_scene(body.name, part.origin)
    part.axes = part.axes @ place.rotation.T
    assert part.modes is not None
    for node, turns in nodes.items():
        if node not in part.modes.node:
            raise WriteError(f"component '{body.name}': node {node} is not in its file")
        if turns and node in part.modes.blind:
            raise WriteError(
                f"component '{body.name}': the slope of node {node} is not known, and a joint, a moment or a rotation "
                "needs it; tie several nodes to an interface with rotations"
            )
    inward = body.node(joint[2].name) if joint is not None else next(iter(nodes), int(part.modes.node[0]))
    _add_hub(tree, body, part, inward)
    if joint is not None:
        _add_joint(tree, *joint)
    tree.bodies[body.name] = tree.add(part)
    _weld(tree, part, inward, outwards=False)
    for node in nodes:
        if node != inward:
            _add_hub(tree, body, part, node)
            _weld(tree, part, node, outwards=True)


def _flexible(body: SceneBody) -> Part:
    """A flexible body in mean axes, its frame in its own basic frame."""
    assert body.file is not None
    component = read_component(body.file)
    if component.rigid_count != _SIX:
        raise WriteError(
            f"component '{body.name}': it has {component.rigid_count} rigid motions, and a body of 42 has six"
        )
    component = with_unit_modal_mass(in_frame(component, FrameCondition("mean-axis")))
    integrals = stored_integrals(component)
    modes = flexible_body(component, integrals)
    return Part(body.name, integrals.origin, integrals.axes, integrals.mass, integrals.inertia, component, modes)


def _node_place(part: Part, node: int) -> Array:
    assert part.modes is not None
    return np.asarray(part.modes.position[np.flatnonzero(part.modes.node == node)[0]])


def _add_hub(tree: Spacecraft, body: SceneBody, part: Part, node: int) -> None:
    origin = part.origin + part.axes.T @ _node_place(part, node)
    tree.hubs[body.name, node] = tree.add(Part(f"{body.name} node {node}", origin, part.axes))


def _weld(tree: Spacecraft, part: Part, node: int, *, outwards: bool) -> None:
    """Hold a hub to its node: the hub is the outer part, or carries the body."""
    body, hub = tree.parts.index(part), tree.hubs[part.name, node]
    ends = (body, hub) if outwards else (hub, body)
    places = (_node_place(part, node), np.zeros(3)) if outwards else (np.zeros(3), _node_place(part, node))
    part.joints[str(node)] = len(tree.hinges)
    tree.hinges.append(Hinge(f"{part.name} node {node}", *ends, np.eye(3), np.eye(3), *places))


def _add_joint(tree: Spacecraft, placed: SceneJoint, near: Point, far: Point) -> None:
    """Add a joint of the scene, in its configuration."""
    from scipy.spatial.transform import Rotation

    joint, scene = placed.joint, tree.scene
    inner, outer = (tree.place(point)[0] for point in (near, far))
    # An offset is fixed to the first body.
    _, at = tree.place(joint.second)
    first, second = (scene.body(point.body) for point in (joint.first, joint.second))
    inwards = joint.first == near
    # Angles turn about axes of the first interface: those of the carrier one after the other from the outside.
    free = sorted(_MOTIONS - set(placed.locked[0]))
    turns = tuple(dof - FIRST_ROTATION for dof in free if dof >= FIRST_ROTATION)
    slides = tuple(dof for dof in free if dof < FIRST_ROTATION)
    if not inwards and slides and turns and (slides != turns):
        raise WriteError(
            f"joint '{joint.name}': it slides along axes of the body that it carries, and those of 42 are fixed to the "
            "inner one; name the interface of the inner body first (`connect`)"
        )
    turns = turns[::-1] if inwards and len(turns) < 3 else turns
    # A spring of 42 is without force where its motion is zero: rotations with springs start there, and slides with
    # springs. So do the rotations of a ball, which 42 holds as a quaternion.
    sprung = [element.dof for element in joint.elements if element.stiffness]
    turns_from_zero = len(turns) == 3 or any(dof >= FIRST_ROTATION for dof in sprung)
    values = placed.values.copy()
    if turns_from_zero:
        values[FIRST_ROTATION:] = 0.0
    if any(dof < FIRST_ROTATION for dof in sprung):
        values[:FIRST_ROTATION] = 0.0
    angles = tuple(float(values[FIRST_ROTATION + axis]) for axis in turns)
    places = tuple(float(values[axis]) for axis in slides)
    turned = np.eye(3)
    for axis, angle in zip(turns, angles, strict=True):
        turned = Rotation.from_rotvec(angle * np.eye(3)[axis]).as_matrix().T @ turned
    now = placed.first_axes @ first.placement.rotation.T
    inside, outside = (now, turned @ now) if inwards else (turned.T @ now, now)
    if turns_from_zero:
        inside = outside = placed.second_axes @ second.placement.rotation.T
        if abs(inside[list(slides)] - now[list(slides)]).max(initial=0.0) > _TURNED:
            raise WriteError(
                f"joint '{joint.name}': it has a spring on one of two rotations, which the configuration turns, and "
                "slides along another axis; 42 has one set of axes for both. Split the joint in two, or export to "
                "exudyn"
            )
    slid = inside.T @ np.array([values[axis] if axis in slides else 0.0 for axis in range(3)])
    parts = tree.parts[inner], tree.parts[outer]
    coefficients = np.zeros((2, _SIX))
    for element in joint.elements:
        coefficients[:, element.dof] = element.stiffness, element.damping
        if element.inertia:
            axis = now[element.dof - FIRST_ROTATION]
            carrier = tree.parts[inner if inwards else outer]
            about = carrier.axes @ axis
            carrier.inertia = carrier.inertia + element.inertia * np.outer(about, about)
    stiffness, damping = coefficients
    tree.hinges.append(
        Hinge(
            joint.name,
            inner,
            outer,
            inside @ parts[0].axes.T,
            outside @ parts[1].axes.T,
            parts[0].local(at - slid),
            parts[1].local(at),
            turns,
            slides,
            angles,
            places,
            tuple(float(stiffness[FIRST_ROTATION + axis]) for axis in turns),
            tuple(float(damping[FIRST_ROTATION + axis]) for axis in turns),
            tuple(float(stiffness[axis]) for axis in slides),
            tuple(float(damping[axis]) for axis in slides),
            1 if inwards else -1,
        )
    )
