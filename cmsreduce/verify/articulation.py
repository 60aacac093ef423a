"""Completeness of modes at hinges: the share of the inertia at each articulation axis that they represent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ConstraintError
from cmsreduce.linalg.blocks import dense
from cmsreduce.model import DOF_NAMES, Channel, JointTerm, Scene, System

__all__ = ["articulation_inertia", "articulation_sensors", "free_index", "hinges_locked", "locked_index"]

Array = NDArray[np.float64]

_ROTATION = 3
# Mobilities of independent hinges, scaled to a unit diagonal, have eigenvalues above this; those of a loop round to 0.
_INDEPENDENT = 1e-10


def articulation_sensors(scene: Scene) -> tuple[Channel, ...]:
    """Make a sensor for each free motion of each joint: the articulation axes.

    Parameters
    ----------
    scene : Scene
        Joints with free motions, a in all.

    Returns
    -------
    tuple of Channel
        a displacement sensors, named JOINT.DOF, joint by joint.
    """
    return tuple(
        Channel(
            f"{joint.name}.{DOF_NAMES[dof]}",
            (JointTerm(joint.name, dof),),
            "rotation" if dof >= _ROTATION else "translation",
        )
        for joint in scene.joints
        for dof in sorted(joint.free)
    )


def hinges_locked(scene: Scene) -> Scene:
    """Lock every joint of a scene in all motions.

    Parameters
    ----------
    scene : Scene
        Joints as given.

    Returns
    -------
    Scene
        Assemble it in the configurations of the scene as given. Actuators and sensors in joints are left out, because
        nothing moves there. A joint that slides is locked where it was built: a slide separates its interfaces, which
        the assembly refuses.
    """

    def not_in_joints(channels: tuple[Channel, ...]) -> tuple[Channel, ...]:
        return tuple(c for c in channels if not any(isinstance(term, JointTerm) for term in c.terms))

    return replace(
        scene,
        joints=tuple(joint.locked() for joint in scene.joints),
        # A locked joint has no angle of its own; the configuration passed to the assembly turns it nevertheless.
        configurations=(replace(scene.configurations[0], angles={}),),
        actuators=not_in_joints(scene.actuators),
        sensors=not_in_joints(scene.sensors),
    )


def articulation_inertia(system: System) -> Array:
    """Inertia J~ of the rigid bodies at the hinges that carry them, everything else free to move.

    Parameters
    ----------
    system : System
        Hinges free; its displacement outputs are those of `articulation_sensors`, a of them.

    Returns
    -------
    (a, a) float64
        (c Phi_r Phi_r^T c^T)^-1 with the rigid motions Phi_r of the system: the inverse of the accelerations of the
        hinges under unit efforts.

    Raises
    ------
    ConstraintError
        If a hinge cannot move by itself without straining a body, as in a closed loop.
    """
    motion = system.C1 @ system.rigid
    mobility = motion @ motion.T
    size = np.sqrt(mobility.diagonal())
    lost = size <= _INDEPENDENT * size.max(initial=0.0)
    scaled = mobility / np.outer(np.where(lost, 1.0, size), np.where(lost, 1.0, size))
    if lost.any() or (size.size and np.linalg.eigvalsh(scaled)[0] < _INDEPENDENT):
        raise ConstraintError(
            f"configuration '{system.configuration.name}': the motions {', '.join(system.outputs)} are not independent "
            "unless a body is strained, as in a closed loop, so that they have no inertia of their own; leave enough "
            "of them out of the articulation axes"
        )
    return np.asarray(np.linalg.inv(mobility))


def free_index(system: System, Phi: Array) -> Array:
    """Completeness of hinges-free modes for each articulation axis: 1 without modes, towards 0 with all of them.

    Parameters
    ----------
    system : System
        Hinges free; its displacement outputs are those of `articulation_sensors`, a of them.
    Phi : (N, k) float64
        Elastic modes of it, orthonormal in its mass, in the order in which they are taken.

    Returns
    -------
    (k, a) float64
        e_kk = [(I + Phi_h^T Phi_h J~)^-1]_kk after 1, 2, .. k modes, Phi_h their hinge motions. With all modes it is
        the share of the inertia at the hinge nodes themselves.

    Raises
    ------
    ConstraintError
        As in `articulation_inertia`.

    Notes
    -----
    Source: Hablani, AIAA 89-0544 (1989). Frequencies may converge long before this index does.
    """
    inertia, motion = articulation_inertia(system), system.C1 @ Phi
    mobility = np.cumsum(np.einsum("am,bm->mab", motion, motion), axis=0)
    return _diagonals(np.asarray(np.linalg.inv(np.eye(motion.shape[0]) + mobility @ inertia)))


def locked_index(system: System, locked: System, Phi: Array) -> Array:
    """Completeness of hinges-locked modes for each articulation axis: 0 without modes, towards 1 with all of them.

    Parameters
    ----------
    system : System
        Hinges free; its displacement outputs are those of `articulation_sensors`, a of them.
    locked : System
        The same bodies and configuration in the scene from `hinges_locked`.
    Phi : (N_l, k) float64
        Elastic modes of the locked system, orthonormal in its mass, in the order in which they are taken.

    Returns
    -------
    (k, a) float64
        C_kk = [h^T h J~^-1]_kk after 1, 2, .. k modes; h, their momentum about the hinges, is their mass coupling to
        the motions that turn one hinge each and give the system no momentum.

    Raises
    ------
    ConstraintError
        As in `articulation_inertia`.

    Notes
    -----
    With all modes h^T h is J~ without the inertia at the hinge nodes, so that 1 - C and the index of the free modes
    converge to one value. Source: Hablani, AIAA 89-0544 (1989).
    """
    inertia = articulation_inertia(system)
    turn = system.rigid @ (system.C1 @ system.rigid).T @ inertia
    # Locked motions are some of the free ones, and the columns of T over its scale are orthonormal.
    weight = 1.0 if system.scale is None else 1 / system.scale[:, None] ** 2
    shapes = dense(system.T.T @ (weight * _in_stack(system, locked, dense(locked.T @ Phi))))
    h = shapes.T @ (system.M @ turn)
    coupled = np.cumsum(np.einsum("ma,mb->mab", h, h), axis=0)
    return _diagonals(coupled @ np.linalg.inv(inertia))


def _in_stack(system: System, locked: System, X: Array) -> Array:
    """Motions of the locked bodies in the coordinates of the free ones, in which no spring of a joint is strained."""
    parts, at = [], 0
    for name, size in system.sizes.items():
        own = locked.sizes.get(name, 0)
        # The coordinates of a joint's springs come before those of its inertias.
        parts += [np.zeros((size - own, X.shape[1])), X[at : at + own]]
        at += own
    return np.vstack(parts)


def _diagonals(A: Array) -> Array:
    return np.asarray(np.einsum("maa->ma", A))
