"""A controller on the reduced system: its spillover, and the stability of the full loop."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg as la

from cmsreduce.assemble import state_space
from cmsreduce.errors import CmsReduceError
from cmsreduce.model import ConfigurationResult, Controller, ControllerMargin, System
from cmsreduce.pipeline.system.assembled import AssembledModel
from cmsreduce.verify import controller_response, stability_margin

__all__ = ["controller_margins", "growing_roots"]

# Rigid motion that the loop does not hold has double roots at zero; rounding moves them by its square root.
_AT_REST = 1e-5


def controller_margins(
    controller: Controller, results: Sequence[ConfigurationResult], model: AssembledModel, label: str
) -> tuple[ControllerMargin, ...]:
    """Spillover of a controller in every configuration.

    Parameters
    ----------
    controller : Controller
        From the sensors to the actuators, u = -K y.
    results : sequence of ConfigurationResult
        Responses of the full and of the reduced system on the same grids.
    model : AssembledModel
        The reduced system.
    label : str
        Label of the reduced responses.

    Raises
    ------
    MatrixError
        If a frequency of the grid is a pole of the controller.
    """
    A, B, C, D = controller.A, controller.B, controller.C, controller.D
    found = []
    for result in results:
        hz, response = result.response.frequency_hz, result.response
        K = controller_response(A, B, C, D, hz)
        spillover, borne = stability_margin(response.full, response.reduced[label], K)
        unstable = growing_roots(model.system(result.configuration), controller, model.scene.band[1])
        found.append(ControllerMargin(result.configuration.name, hz, spillover, borne, unstable))
    return tuple(found)


def growing_roots(system: System, controller: Controller, band_hz: float) -> int | None:
    """Number of unstable roots of a closed loop.

    Parameters
    ----------
    system : System
        Reduced.
    controller : Controller
        u = -K y.
    band_hz : float
        Roots below a small share of it count as zero.

    Returns
    -------
    int or None
        None where the system has no real state space.
    """
    try:
        plant = state_space(system)
    except CmsReduceError:
        return None
    # u = -(C_k x_k + D_k y), y = C x + D u: the direct terms form a loop of their own.
    loop = np.linalg.inv(np.eye(controller.D.shape[0]) + controller.D @ plant.D)
    to_u = np.hstack([-loop @ controller.D @ plant.C, -loop @ controller.C])
    y_of = np.hstack([plant.C, np.zeros((plant.C.shape[0], controller.states))]) + plant.D @ to_u
    A = la.block_diag(plant.A, controller.A)
    closed = A + np.vstack([plant.B @ to_u, controller.B @ y_of])
    roots = np.asarray(la.eigvals(closed), dtype=np.complex128)
    return int(np.count_nonzero(roots.real > _AT_REST * 2 * np.pi * band_hz))
