"""Notes on the spin of a scene: frequencies of spinning bodies, and a warning where their stress is left out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.config import SpinKeys
from cmsreduce.linalg.blocks import combined
from cmsreduce.linalg.eigen import null_space
from cmsreduce.linalg.sparse import motions_held
from cmsreduce.mechanics import modal_integrals, modal_stiffening, spinning_modes
from cmsreduce.model import UNDETERMINED, ModalComponent
from cmsreduce.pipeline.bodies.bodies import FlexibleBody

__all__ = ["spin_notes"]

Array = NDArray[np.float64]

SLENDER = 0.1
"""Spins from this share of the lowest frequency of the held body are noted: centrifugal force then takes 1 % of the
stiffness of its first mode, and stress gives back more than that."""

# Number of the lowest modes that vibrations in the spinning frame are computed with; higher modes hardly change the
# first frequencies.
_MODES = 60
_LISTED = 3
# Frequencies of a body held at different interfaces that are equal to this share: round-off must not choose.
_ALIKE = 1e-6


def spin_notes(
    spins: Mapping[str, SpinKeys], bodies: Mapping[str, FlexibleBody], final: Mapping[str, ModalComponent]
) -> Iterator[str]:
    """Notes on the bodies that the scene spins.

    Parameters
    ----------
    spins : mapping of body to SpinKeys
        Rates and axes.
    bodies : mapping of name to FlexibleBody
        Bodies as read.
    final : mapping of name to ModalComponent
        Reduced bodies of the run.
    """
    for name, spin in spins.items():
        if name not in final:
            yield f"{name}: not reduced, so nothing is said of its spin of {spin.rate:.4g} Hz"
        elif bodies[name].body.nodes is None:
            yield f"{name}: without geometry nothing is known of its spin of {spin.rate:.4g} Hz"
        else:
            yield from _of_body(name, spin, bodies[name], final[name])


def _of_body(name: str, spin: SpinKeys, flexible: FlexibleBody, component: ModalComponent) -> Iterator[str]:
    Phi, omega, support = _held_modes(component)
    if not omega.size:
        return
    second_order = modal_integrals(component.body, Phi).second_order
    if second_order is None:
        yield f"{name}: nothing is said of its spin of {spin.rate:.4g} Hz: {UNDETERMINED}"
        return
    phi_phi = second_order.phi_phi
    named = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
    axes = {label: axis for label, axis in named.items() if spin.axis in (None, axis)}
    if spin.axis is not None and not axes:
        axes = {" ".join(f"{x:g}" for x in spin.axis): spin.axis}
    rate, K = 2 * np.pi * abs(spin.rate), np.diag(omega**2)
    stiffening = None if flexible.stiffening is None else modal_stiffening(flexible.stiffening, Phi)
    for label, axis in axes.items():
        w = rate * np.asarray(axis) / np.linalg.norm(axis)
        stress = None if stiffening is None else stiffening.spinning(w)
        if stress is not None:
            spun = spinning_modes(K, phi_phi, w, stress)
            yield (
                f"{name}: spinning at {spin.rate:.4g} Hz about {label}, stress included, {_frequencies(*spun)}; "
                f"at rest {_listed(omega)} ({support})"
            )
        elif rate >= SLENDER * omega[0]:
            yield (
                f"{name}: spins at {spin.rate:.4g} Hz about {label}, {rate / omega[0]:.0%} of its lowest frequency "
                f"({omega[0] / (2 * np.pi):.4g} Hz {support}), and has no geometric stiffness for it: its modes alone "
                f"{_without(*spinning_modes(K, phi_phi, w))}; give it `geometric_stiffness`"
            )


def _held_modes(component: ModalComponent) -> tuple[Array, Array, str]:
    """Lowest modes (n, k), orthonormal in mass, of the body held at its softest interface; rad/s; the support in words.

    The neighbour at an interface spins the body, so that interface holds it; a body that no interface holds is free.
    """
    rigid, mass = component.rigid_count, component.mass
    best: tuple[Array, Array, str] | None = None
    for face in component.body.interfaces if rigid else ():
        rows = component.body.interface_rows(face)
        if motions_held(component.Phi[:, :rigid], rows) < rigid:
            continue
        T, _ = null_space(component.Phi[rows])
        found = _modes(T.T @ (mass[:, None] * T), T.T @ (component.stiffness[:, None] * T))
        if found[1].size and (best is None or found[1][0] < (1 - _ALIKE) * best[1][0]):
            best = combined(component.Phi, T @ found[0]), found[1], f"held at {face}"
    if best is not None:
        return best
    elastic = np.arange(rigid, component.elastic.stop)[:_MODES]
    return component.Phi[:, elastic], component.omega[elastic], "free" if rigid else "as supported"


def _modes(M: Array, K: Array) -> tuple[Array, Array]:
    """Lowest modes with mass, of a stiffness that is positive definite."""
    if not K.size:
        return np.zeros(K.shape), np.zeros(0)
    flexibility, X = la.eigh(M, K)
    massive = np.flatnonzero(flexibility > np.finfo(float).eps * K.shape[0] * flexibility.max(initial=0.0))[::-1][
        :_MODES
    ]
    return X[:, massive] / np.sqrt(flexibility[massive]), 1 / np.sqrt(flexibility[massive])


def _listed(omega: Array) -> str:
    return ", ".join(f"{value:.4g}" for value in omega[:_LISTED] / (2 * np.pi)) + " Hz"


def _frequencies(omega: Array, growth: float) -> str:
    vibrates = f"it vibrates at {_listed(omega)}"
    return f"{vibrates}, and is unstable" if growth else vibrates


def _without(omega: Array, growth: float) -> str:
    if growth:
        return "diverge"
    return f"give {_listed(omega)}, where stress would raise them"
