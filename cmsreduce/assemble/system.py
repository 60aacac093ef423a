"""Assembly of the bodies in one configuration: the system's coordinates span the null space of the joints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.assemble.closed_loops import check_loops, nearest_closed
from cmsreduce.assemble.constraint_space import (
    congruent_damping,
    constraint_space,
    coordinate_scale,
    without_rounding,
)
from cmsreduce.assemble.joint_elements import element_rows, with_joint_bodies
from cmsreduce.assemble.joints import constrain, relative_motion
from cmsreduce.assemble.placement import place_bodies
from cmsreduce.assemble.points import PointStack, carried
from cmsreduce.assemble.redundant_joints import settle_redundant
from cmsreduce.errors import MatrixError, SceneError
from cmsreduce.linalg.blocks import dense
from cmsreduce.linalg.eigen import DEPENDENT, null_space
from cmsreduce.model import Channel, Configuration, Matrix, Placement, PointTerm, Scene, StrutTerm, Substructure, System

__all__ = ["Wiring", "assemble", "balanced_rigid", "channel_rows", "wire"]

Array = NDArray[np.float64]

# A channel is refused if more than this share of its weight is in a direction in which the point cannot move.
_STRAY = 1e-6
# Nodes without rotations that are joined over a gap resist rigid motion by the gap over their distance from the centre
# of mass. This distance is at least the size of the system divided by this number.
_OVER_GAP = 100.0
# A rigid motion with less than this share of the weights of its body in the joints is not made larger.
_LEAST_WEIGHT = 1e-4
# A free motion with less than this share of the largest modal mass carries none: inertia and mass differ by units.
_NO_MASS = 1e-20


def channel_rows(
    stack: PointStack, scene: Scene, placed: Mapping[str, Placement], channels: Sequence[Channel]
) -> Array:
    """Rows of actuators or sensors over the stacked motions.

    Parameters
    ----------
    stack : PointStack
        Points of all bodies.
    scene : Scene
        Joints to which the channels refer.
    placed : mapping of body to Placement
        Positions of the bodies.
    channels : sequence of Channel
        Actuators or sensors.

    Returns
    -------
    rows : (channels, size) float64
        Motions that sensors measure; for actuators the transposed input matrix. Sources: theory section 1 (P, H1, H2;
        struts as one column).

    Raises
    ------
    SceneError
        If a point cannot move in the direction of a channel, or a strut has no length.
    """
    rows = np.zeros((len(channels), stack.size))
    joints = {joint.name: joint for joint in scene.joints}
    for row, channel in zip(rows, channels, strict=True):
        for term in channel.terms:
            if isinstance(term, PointTerm):
                _add(stack, row, channel, term)
            elif isinstance(term, StrutTerm):
                _add_strut(stack, row, placed, channel, term)
            else:
                row += relative_motion(stack, scene, placed, joints[term.joint], term.dof)
    return rows


def _add(stack: PointStack, row: Array, channel: Channel, term: PointTerm) -> None:
    label = stack.label(term.at)
    sub = stack.substructures[term.at.body]
    axes, has = sub.axes[label], sub.has[label]
    along = np.concatenate([axes @ term.direction[:3], axes @ term.direction[3:]])
    if np.linalg.norm(along[~has]) > _STRAY * np.linalg.norm(along):
        can = "".join(str(k + 1) for k in np.flatnonzero(has))
        raise SceneError(
            f"'{channel.name}': point '{term.at}' has dofs {can or 'none'} only and cannot move in the direction asked "
            "for; choose a node with these dofs, or combine several nodes with `rows:`"
        )
    row[stack.columns(term.at.body, label)] += term.direction


def _add_strut(
    stack: PointStack, row: Array, placed: Mapping[str, Placement], channel: Channel, term: StrutTerm
) -> None:
    places = []
    for point in (term.a, term.b):
        place, label = placed[point.body], stack.label(point)
        places.append(place.rotation @ stack.substructures[point.body].position[label] + place.translation)
    line = places[1] - places[0]
    length = np.linalg.norm(line)
    if length <= _STRAY * max(float(abs(np.array(places)).max()), 1e-300):
        raise SceneError(f"'{channel.name}': points '{term.a}' and '{term.b}' coincide, so the strut has no direction")
    for point, sign in ((term.a, -1.0), (term.b, 1.0)):
        place = placed[point.body]
        direction = np.concatenate([sign * (line / length) @ place.rotation, np.zeros(3)])
        _add(stack, row, channel, PointTerm(point, direction))


@dataclass(frozen=True, eq=False)
class Wiring:
    """Constraints, inputs and outputs over the points in one configuration; the same for full and reduced bodies.

    Parameters
    ----------
    A : (c, size) float64
        Constraints over the stacked motions of a `PointStack`: joints, ground, and the ties of the joints' springs,
        dampers and inertias to the bodies.
    B : (inputs, size) float64
        Motions on which the actuators act; transposed, the input matrix.
    C1, C2 : (outputs, size) float64
        Displacements and rates that the sensors measure.
    placed : mapping of body to Placement
        Positions of the bodies.
    gap : float
        Largest distance between joined nodes, relative to the size of the system.
    notes : tuple of str
        Steps that the user may not expect.
    """

    A: Array
    B: Array
    C1: Array
    C2: Array
    placed: Mapping[str, Placement]
    gap: float
    notes: tuple[str, ...] = ()


def wire(stack: PointStack, scene: Scene, configuration: Configuration) -> Wiring:
    """Rows of joints, actuators and sensors over the points, in one configuration.

    Parameters
    ----------
    stack : PointStack
        Points of all bodies, including those of the joints (`with_joint_bodies`).
    scene : Scene
        Joints, ground, actuators, sensors.
    configuration : Configuration
        Angles of the joints.

    Raises
    ------
    SceneError, ConstraintError
        As in `place_bodies`, `check_loops`, `constrain`, `settle_redundant`, `element_rows` and `channel_rows`.
    """
    if configuration.between:
        configuration = nearest_closed(stack.substructures, scene, configuration) or configuration
    placed = place_bodies(stack.substructures, scene, configuration)
    turned = any(configuration.angles.values())
    if turned:
        constrain(stack, scene, place_bodies(stack.substructures, scene, Configuration("as built")), as_built=True)
        check_loops(stack.substructures, scene, configuration, placed)
    constraints, notes = settle_redundant(stack, constrain(stack, scene, placed, as_built=not turned), scene.redundant)
    ties, _ = element_rows(stack, scene, placed)
    A = np.vstack([constraints.A, *ties])
    B, C = (
        _unlocked(stack, A, channel_rows(stack, scene, placed, channels))
        for channels in (scene.actuators, scene.sensors)
    )
    rate = np.array([sensor.rate for sensor in scene.sensors], dtype=bool).reshape(-1, 1)
    return Wiring(
        A,
        B,
        np.where(rate, 0.0, C),
        np.where(rate, C, 0.0),
        placed,
        constraints.gap,
        notes,
    )


def _unlocked(stack: PointStack, A: Array, rows: Array) -> Array:
    """Rows of channels, zero where joints and ground lock the motion: its response would be rounding and nothing else.

    The points of a flexible body move independently, but for those that a joined point carries; those of a rigid body
    move together.
    """
    every = np.vstack([A, carried(stack, A, rows)])
    parts = [every[:, :0]]
    for name, sub in stack.substructures.items():
        own = every[:, stack.body_columns(name)]
        together = sub.omega is None and sub.rigid.shape[1] == sub.m
        parts.append(own @ dense(stack.motions(name)) if together else own)
    every = np.hstack(parts)
    locks, channels = every[: len(A)], every[len(A) :]
    touched = locks.any(axis=0)
    rows = rows.copy()
    for row, channel in zip(rows, channels, strict=True):
        if channel.any() and not channel[~touched].any():
            left = channel[touched] - la.lstsq(locks[:, touched].T, channel[touched])[0] @ locks[:, touched]
            if np.linalg.norm(left) <= DEPENDENT * np.linalg.norm(channel):
                row[:] = 0.0
    return rows


def assemble(
    substructures: Mapping[str, Substructure],
    scene: Scene,
    configuration: Configuration,
    wired: tuple[PointStack, Wiring] | None = None,
) -> System:
    """Assemble the bodies in one configuration.

    Parameters
    ----------
    substructures : mapping of name to Substructure
        Bodies in the scene's units, full or reduced or mixed.
    scene : Scene
        Joints, ground, actuators, sensors.
    configuration : Configuration
        Angles of the joints.
    wired : (PointStack, Wiring), optional
        Points of these bodies and of those of the joints, and the result of `wire` for this configuration, if known.

    Returns
    -------
    System
        Sparse where the bodies are.

    Raises
    ------
    SceneError, ConstraintError
        As in `wire`.
    MatrixError
        If a free motion of the joints carries no mass.

    Notes
    -----
    A T = 0 with T from a block reflector on the columns of A that joints touch; all other coordinates are kept.
    Source: theory section 6, with null(A_R) itself. Springs, dampers and inertias of joints are bodies of the joints,
    after the others.
    """
    if wired is None:
        stack = PointStack(with_joint_bodies(substructures, scene))
        wired = stack, wire(stack, scene, configuration)
    stack, wiring = wired
    substructures = stack.substructures
    A = stack.spread(wiring.A)
    space = constraint_space(A, coordinate_scale(tuple(substructures.values()), A))
    T = space.T
    M, K = (space.congruent([getattr(sub, letter) for sub in substructures.values()]) for letter in ("M", "K"))
    M = without_rounding(M, T, A, np.concatenate([sub.M.diagonal() for sub in substructures.values()]) > 0)
    D, loss = (
        congruent_damping(space, [_or_zero(getattr(sub, letter), sub.m) for sub in substructures.values()])
        if any(getattr(sub, letter) is not None for sub in substructures.values())
        else None
        for letter in ("D", "loss")
    )
    rigid = space.coordinates(_rigid_motions(A, substructures, wiring.gap))
    # The second time, beside motions of unit mass, the least of unlike masses has all its digits.
    for _ in range(2 if rigid.shape[1] else 0):
        weight, V = la.eigh(rigid.T @ (M @ rigid))
        if weight[0] <= _NO_MASS * weight[-1]:
            raise MatrixError(
                f"configuration '{configuration.name}': a motion that nothing holds carries no mass, such as the spin "
                "of a rod without inertia in a free hinge: lock it in its joint, or give the body its inertia"
            )
        rigid = rigid @ (V / np.sqrt(weight))
    B, C1, C2 = (dense(stack.spread(rows) @ T) for rows in (wiring.B, wiring.C1, wiring.C2))
    return System(
        configuration=configuration,
        T=T,
        M=M,
        K=K,
        D=D,
        loss=loss,
        B=B.T,
        C1=C1,
        C2=C2,
        rigid=rigid,
        sizes={name: sub.m for name, sub in substructures.items()},
        inputs=tuple(actuator.name for actuator in scene.actuators),
        outputs=tuple(sensor.name for sensor in scene.sensors),
        rounding=max(sub.rounding for sub in substructures.values()),
        joints=scene.joints,
        notes=wiring.notes,
        scale=space.scale,
    )


def _or_zero(block: Matrix | None, m: int) -> Matrix:
    return sp.csc_array((m, m)) if block is None else block


def balanced_rigid(A: Matrix | sp.csr_array, motions: Sequence[Array]) -> Array:
    """Rigid motions of all bodies, (sum m_i, sum r_i), those of each scaled by one number to weights of one size in A.

    A unit motion of a rigid body and a motion of unit modal mass of a heavy one differ by many decades.
    """
    rigid, at = la.block_diag(*motions), 0
    size = dense(abs(sp.csr_array(A)) @ abs(rigid)).max(axis=0, initial=0.0)
    for own in motions:
        columns = slice(at, at := at + own.shape[1])
        rigid[:, columns] /= size[columns].max(initial=0.0) or 1.0
    return rigid


def _rigid_motions(A: sp.csr_array, substructures: Mapping[str, Substructure], gap: float) -> Array:
    """Rigid motions that the joints allow, in which no body is strained (sum m_i, R)."""
    rigid = balanced_rigid(A, [sub.rigid for sub in substructures.values()])
    # Turns and translations of a body have weights of one size, or the constraints of the lighter ones lose digits.
    size = dense(abs(A) @ abs(rigid)).max(axis=0, initial=0.0)
    rigid = rigid / np.where(size > _LEAST_WEIGHT, size, 1.0)
    N, _ = null_space(dense(A @ rigid), _OVER_GAP * gap)
    return np.asarray(rigid @ N)
