"""What the modes of a run carry: effective mass of each body, and gains between the channels."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.errors import CmsReduceError
from cmsreduce.model import EffectiveMassCurve, FEModel, GainCurve, ModalComponent, rigid_body_shapes
from cmsreduce.pipeline.run import Run
from cmsreduce.pipeline.system import channel_gains
from cmsreduce.verify import effective_mass

__all__ = ["effective_mass_curves", "gain_curves"]

Array = NDArray[np.float64]

# Motions of the interface below this share of the largest are none: modes are orthonormal to 1e-8 or better.
_MOVES = 1e-9
# Frequencies below this share of the highest are rigid motions that the interfaces do not hold.
_LOOSE = 1e-6


def effective_mass_curves(run: Run) -> dict[str, EffectiveMassCurve]:
    """Running effective mass of every body with a geometry, held at all its interfaces."""
    found = {}
    for name in run.reduced_names:
        body = run.bodies[name].body
        if body.nodes is None or not body.interfaces:
            continue
        whole, kept = (_running(body, modes) for modes in (run.modal(name), run.final[name]))
        if whole is not None and kept is not None:
            found[name] = EffectiveMassCurve(", ".join(body.interfaces), *whole, *kept)
    return found


def held_modes(component: ModalComponent, rows: NDArray[np.int64]) -> tuple[Array, Array] | None:
    """Modes of a reduced body with some of its rows held at zero.

    Parameters
    ----------
    component : ModalComponent
        m modes.
    rows : (b,) int64
        Rows of the body that are held.

    Returns
    -------
    hz : (k,) float64
        Natural frequencies.
    Q : (m, k) float64
        Amplitudes, of unit modal mass. Static shapes follow their load at once and carry no mass of their own.

    None where the rows do not hold the body, or hold all of it.
    """
    C = component.Phi[rows]
    # Static shapes have no mass, so that the pencil is singular in them: they only help to hold the rows.
    scale = np.linalg.norm(C, axis=0)
    C = C / max(float(scale.max(initial=0.0)), 1e-300)
    _, s, Vt = la.svd(C, full_matrices=True)
    free = Vt[int(np.sum(s > _MOVES)) :].T
    if not free.shape[1]:
        return None
    K, M = (free.T * values @ free for values in (component.stiffness, component.mass))
    # Mass may vanish in combinations of static shapes, stiffness does not: solved for 1 / w^2.
    try:
        inverse, V = la.eigh(M, K)
    except la.LinAlgError:
        return None
    order = np.argsort(-inverse)
    inverse, V = inverse[order], V[:, order]
    carried = inverse > _LOOSE**2 * inverse.max(initial=0.0)
    inverse, V = inverse[carried], V[:, carried]
    omega = 1 / np.sqrt(inverse)
    return omega / (2 * np.pi), np.asarray(free @ V * omega)


def gain_curves(run: Run) -> tuple[GainCurve, ...]:
    """Running sums of modal gains in every configuration; empty without channels, or for a system too large."""
    if not run.has_response:
        return ()
    whole = run.whole.assembled
    found = []
    for configuration in run.scene.configurations:
        kept, every = (channel_gains(model, configuration) for model in (run.model.assembled, whole))
        if kept is None or every is None:
            return ()
        found.append(GainCurve(configuration.name, kept, every))
    return tuple(found)


def _running(body: FEModel, component: ModalComponent) -> tuple[Array, Array] | None:
    if body.nodes is None:
        return None
    try:
        held = np.unique(np.concatenate([body.interface_rows(face) for face in body.interfaces]))
    except CmsReduceError:
        return None
    modes = held_modes(component, held)
    if modes is None:
        return None
    hz, Q = modes
    point = np.vstack([face.position for face in body.interfaces.values()]).mean(axis=0)
    R = rigid_body_shapes(body.dofs, body.nodes, point)
    MR = np.asarray(body.M @ R)
    found = effective_mass(hz, (MR.T @ component.Phi) @ Q, R.T @ MR)
    return found.hz, found.running
