"""The balance stage: which modes of which body a model keeps."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from cmsreduce.assemble import Ports
from cmsreduce.balance import Selection, keep_all, keep_error, keep_fraction, keep_modes
from cmsreduce.config import KeepKeys
from cmsreduce.errors import ConfigError
from cmsreduce.model import ModalChannels, ModalComponent

__all__ = ["modal_channels", "select", "truncate"]

# The search runs on frequencies that the first candidate set; a model that fails on its own is searched anew, to a
# limit smaller by what it missed.
_ATTEMPTS = 6
_MARGIN = 0.97


def modal_channels(component: ModalComponent, ports: Ports) -> ModalChannels:
    """A body's elastic modes between its inputs and outputs.

    Interface dofs count as inputs and as displacement and rate outputs (theory section 4).

    Parameters
    ----------
    component : ModalComponent
        Orthonormal modes.
    ports : Ports
        i-set, struts, sensors.
    """
    e = component.elastic
    Phi = component.Phi[:, e]
    at_interface = Phi[ports.interface]
    return ModalChannels(
        component.name,
        component.omega[e],
        component.zeta[e],
        np.hstack([at_interface.T, Phi.T @ ports.loads]),
        np.vstack([at_interface, ports.displacements @ Phi]),
        np.vstack([at_interface, ports.rates @ Phi]),
    )


def select(
    components: Mapping[str, ModalComponent],
    keep: KeepKeys,
    error_of: Callable[[Selection], float] | None,
    exact_error_of: Callable[[Selection], float] | None,
) -> Selection:
    """Apply a keep rule to ranked bodies.

    Parameters
    ----------
    components : mapping of name to ModalComponent
        Ranked.
    keep : KeepKeys
        Rule.
    error_of, exact_error_of : callable, optional
        Worst response error of a selection on a fixed grid, and on one refined for it.

    Raises
    ------
    ConfigError
        If the rule cannot be met.
    """
    if keep.rule == "modes":
        assert keep.modes is not None
        return keep_modes(components, keep.modes)
    if keep.rule == "fraction":
        assert keep.fraction is not None
        return keep_fraction(components, keep.fraction)
    if keep.rule == "all":
        return keep_all(components)
    assert keep.frf_error is not None
    if error_of is None or exact_error_of is None:
        raise ConfigError(
            "balance.keep.frf_error needs a response to measure: name at least one actuator and one sensor in the scene"
        )
    limit = keep.frf_error
    for _ in range(_ATTEMPTS):
        selection = keep_error(components, error_of, limit)
        exact = exact_error_of(selection)
        if exact <= keep.frf_error:
            return selection
        limit *= _MARGIN * keep.frf_error / exact
    raise ConfigError(
        f"balance.keep.frf_error: no model was found that stays below {keep.frf_error:g} on a grid of its own; the "
        f"last one reached {exact:.3g}. Raise reduce.cutoff, or allow a larger error"
    )


def truncate(
    components: Mapping[str, ModalComponent], selection: Selection, reasons: Mapping[str, str]
) -> dict[str, ModalComponent]:
    """Keep the selected modes of every body, and say why."""
    kept = {}
    for name, component in components.items():
        e = component.elastic
        why = component.why[: e.start] + (reasons[name],) * component.elastic_count + component.why[e.stop :]
        kept[name] = replace(component, why=why).truncated(selection[name])
    return kept
