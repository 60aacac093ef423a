"""Frequency response by coupling the receptances of the bodies (theory sections 1 and 6)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble.joint_elements import with_joint_bodies
from cmsreduce.assemble.points import PointStack
from cmsreduce.assemble.receptance import BRAKED, Receptance, receptance
from cmsreduce.assemble.system import Wiring, wire
from cmsreduce.linalg.dense import dense
from cmsreduce.linalg.flexibility_model import frequency_blocks
from cmsreduce.linalg.null_space import row_basis
from cmsreduce.model import Configuration, Scene, Substructure, System

__all__ = ["couple", "frequency_response", "rigid_response"]

# Memory of the receptances and joined flexibilities of the frequencies coupled at a time.
_BLOCK_BYTES = 2**27


def couple(
    receptances: Mapping[str, Receptance],
    stack: PointStack,
    wiring: Wiring,
    omega: NDArray[np.float64],
) -> NDArray[np.complex128]:
    """Response of the joined bodies from the receptances of the single ones.

    Parameters
    ----------
    receptances : mapping of body to Receptance
        Dynamic flexibilities over each body's points; they do not depend on how the bodies are turned.
    stack : PointStack
        Points of all bodies.
    wiring : Wiring
        Joints, inputs and outputs in one configuration.
    omega : (f,) float64
        Circular frequencies in rad/s.

    Returns
    -------
    H : (f, outputs, inputs) complex128

    Notes
    -----
    With lambda the joint forces, A Y (B u + A^T lambda) = 0. Rows of A that depend on others in the motions that the
    bodies have are dropped. Frequencies are taken in blocks: the receptances of none but these are in memory.
    """
    # Joints that lock the same motion of a reduced body twice would leave lambda undetermined.
    basis = row_basis(dense(stack.spread(wiring.A)))
    A = basis @ wiring.A
    c, u = A.shape[0], wiring.B.shape[0]
    left = np.vstack([A, wiring.C1, wiring.C2])
    right = np.vstack([A, wiring.B])
    out = np.empty((omega.size, wiring.C1.shape[0], u), dtype=np.complex128)
    columns = {name: stack.body_columns(name) for name in receptances}
    entries = sum((place.stop - place.start) ** 2 for place in columns.values()) + 3 * left.shape[0] * right.shape[0]
    for part in frequency_blocks(omega.size, 16 * entries, _BLOCK_BYTES):
        G = np.zeros((omega[part].size, left.shape[0], right.shape[0]), dtype=np.complex128)
        for name, receptance_of in receptances.items():
            G += _between(left[:, columns[name]], receptance_of(omega[part]), right[:, columns[name]])
        AYA, AYB = G[:, :c, :c], G[:, :c, c:]
        CYA, CYB = G[:, c:, :c], G[:, c:, c:]
        both = CYB - CYA @ np.linalg.solve(AYA, AYB) if c else CYB
        y = wiring.C1.shape[0]
        out[part] = both[:, :y] + 1j * omega[part, None, None] * both[:, y:]
    return out


def _between(
    left: NDArray[np.float64], Y: NDArray[np.complex128], right: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Give left Y right^T at every frequency, most of the work in one product of real matrices for all of them."""
    f, p = Y.shape[:2]
    rows = Y.reshape(f * p, p)
    columns = (rows.real @ right.T + 1j * (rows.imag @ right.T)).reshape(f, p, -1)
    return np.asarray((left @ columns.view(np.float64)).view(np.complex128))


def rigid_response(system: System, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Rigid-body part of a system's response: (f, outputs, inputs) complex128.

    Free motions that dampers of the joints, or of the ground, resist answer with their drag.
    """
    Pr = system.rigid
    gain = (system.C1 @ Pr)[None] + 1j * omega[:, None, None] * (system.C2 @ Pr)[None]
    load = Pr.T @ system.B
    drag = _drag(system)
    if not drag.any():
        return np.asarray(gain @ load / -(omega**2)[:, None, None])
    w = omega[:, None, None]
    return np.asarray(gain @ np.linalg.solve(1j * w * drag - w**2 * np.eye(drag.shape[0]), load[None] + 0j))


def _drag(system: System) -> NDArray[np.float64]:
    """Damping of the rigid motions, without its round-off (R, R)."""
    Pr = system.rigid
    if system.D is None or not Pr.shape[1]:
        return np.zeros((0, 0))
    forces = np.asarray(system.D @ Pr)
    size = float(abs(dense(system.D)).max()) * abs(Pr).max(axis=0)
    braked = abs(forces).max(axis=0) > BRAKED * size
    return np.where(np.outer(braked, braked), Pr.T @ forces, 0.0)


def frequency_response(
    substructures: Mapping[str, Substructure], scene: Scene, configuration: Configuration, omega: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Frequency response of the assembled bodies in one configuration.

    Parameters
    ----------
    substructures : mapping of name to Substructure
        Bodies in the scene's units.
    scene : Scene
        Joints, actuators, sensors.
    configuration : Configuration
        Setting of the joints.
    omega : (f,) float64
        Circular frequencies in rad/s.

    Returns
    -------
    H : (f, outputs, inputs) complex128
    """
    bodies = with_joint_bodies(substructures, scene)
    stack = PointStack(bodies)
    Y = {name: receptance(sub, omega, stack.motions(name)) for name, sub in bodies.items()}
    return couple(Y, stack, wire(stack, scene, configuration), omega)
