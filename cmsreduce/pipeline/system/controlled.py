"""A controller on the reduced system: its spillover, and the stability of the full loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from cmsreduce.model import ConfigurationResult, Controller, ControllerMargin
from cmsreduce.pipeline.system.stability import SystemRoots
from cmsreduce.verify import controller_response, open_loop, stability_margin

__all__ = ["controller_margins"]


def controller_margins(
    controller: Controller,
    results: Sequence[ConfigurationResult],
    roots: Mapping[str, SystemRoots | None],
    full_roots: Mapping[str, SystemRoots | None],
    label: str,
) -> tuple[ControllerMargin, ...]:
    """Spillover of a controller in every configuration.

    Parameters
    ----------
    controller : Controller
        From the sensors to the actuators, u = -K y.
    results : sequence of ConfigurationResult
        Responses of the full and of the reduced system on the same grids.
    roots : mapping of configuration to SystemRoots or None
        Roots of the closed loop with the reduced system; None where they are not known.
    full_roots : mapping of configuration to SystemRoots or None
        Roots of the closed loop with the reference model.
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
        name = result.configuration.name
        own, full = (None if s is None else s.growing.size for s in (roots[name], full_roots[name]))
        loops = open_loop(response.full, K), open_loop(response.reduced[label], K)
        found.append(ControllerMargin(name, hz, spillover, borne, own, loops, full))
    return tuple(found)
