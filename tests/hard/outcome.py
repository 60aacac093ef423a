"""Run one mode set on one hard case, and measure what comes out."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.model import Channel, ModalComponent
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import reduction
from cmsreduce.verify import channel_scales, frf_error
from tests.hard.case import COMPLETE, LIMITS, LOADED, Case
from tests.hard.measure import (
    LARGE,
    elastic_modes,
    elastic_response,
    orthogonality,
    orthonormal,
    static_response,
    strain_error,
)

__all__ = ["Outcome", "Truth", "outcome", "reduce", "truth"]

# Distances from a resonance at which responses are compared, in half-power half-widths; a large body's at its peak.
_OFFSETS = np.array([-8.0, -2.0, -0.7, 0.0, 0.7, 2.0, 8.0])
# Elastic modes that a large body's are compared with.
_COMPARED = 20
# What is granted beside the error of modal truncation.
_SLACK = 1e-3
# A first-order estimate is trusted to half of itself; beside the peaks there is the response between them.
_FIRST_ORDER, _STATIC = 1.5, 0.01


@dataclass(frozen=True, eq=False)
class Truth:
    """What the unreduced body does, solved directly."""

    case: Case

    @cached_property
    def omega(self) -> NDArray[np.float64]:
        """Elastic frequencies of the body alone, rad/s."""
        body = self.case.exact
        return elastic_modes(body.K, body.M, self.case.rigid, body.n if body.n <= LARGE else _COMPARED)[0]

    @cached_property
    def company(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Elastic frequencies in company, rad/s, and the shapes of the body in them."""
        K, M = self.case.joined()
        return elastic_modes(K, M, self.case.rigid, _COMPARED if self.case.body.n > LARGE else self.case.body.n)

    @cached_property
    def grid(self) -> NDArray[np.float64]:
        """Circular frequencies that responses are compared at: over the band, and around resonances in company."""
        case = self.case
        low, high = (2 * np.pi * f for f in case.band_hz)
        base = np.geomspace(low, high, case.points)
        w = self.company[0]
        w = w[w <= high]
        if case.loss == 0:
            # Halfway between resonances: an undamped response has no other place that a frequency error spares.
            w = np.unique(np.concatenate([[low], w, [high]]))
            return np.sqrt(w[1:] * w[:-1])
        offsets = _OFFSETS if case.exact.n <= LARGE else np.zeros(1)
        near = (w[:, None] * (1 + case.loss / 2 * offsets)).ravel()
        return np.unique(np.concatenate([base, near[(near >= low) & (near <= high)]]))

    @cached_property
    def response(self) -> NDArray[np.complex128]:
        """Elastic response in company."""
        case = self.case
        K, M = case.joined()
        return elastic_response(K, M, case.rigid, case.inputs, case.outputs, self.grid, case.loss)

    @cached_property
    def truncation(self) -> float:
        """frf_error of the modes in company up to twice the band, alone: what a set of loaded modes has to reach."""
        case, (w, X) = self.case, self.company
        kept = w <= 2 * np.pi * case.cutoff_hz * (1 + 1e-9)
        w, X = w[kept], X[:, kept]
        gain = 1 / (w**2 * (1 + 1j * case.loss) - self.grid[:, None] ** 2)
        H = np.einsum("yk,fk,ku->fyu", X[case.outputs], gain, X.T @ case.inputs, optimize=True)
        return frf_error(self.grid, self.response, H, *_scales(case))

    @cached_property
    def detuning(self) -> float:
        """frf_error that Craig-Bampton owes to the fixed-interface modes it leaves out, to first order.

        Left out, they stiffen the interface by w^4 sum p p^T / (w_k^2 - w^2), p what they exert on it, and each mode in
        company moves up by half of that over its own w. A peak of half-width zeta w moved by d half-widths is missed by
        sqrt(2 d^2 / (4 + d^2)), at its top by d / sqrt(1 + d^2). Peaks count by their energy.
        """
        case, body, i = self.case, self.case.exact, self.case.interface
        w, X = self.company
        inside = (w >= 2 * np.pi * case.band_hz[0]) & (w <= 2 * np.pi * case.band_hz[1])
        w, X = w[inside], X[:, inside]
        j = np.setdiff1d(np.arange(body.n), i)
        if not (i.size and j.size and w.size):
            return 0.0
        Kjj, Mjj = (sp.csc_array(A[j][:, j]) for A in (body.K, body.M))
        fixed, phi = elastic_modes(Kjj, Mjj, np.empty((j.size, 0)), j.size)
        out = fixed > 2 * np.pi * case.cutoff_hz
        fixed, phi = fixed[out], phi[:, out]
        # The coupling mass of a mode: what is left of its reaction beside that of the constraint modes.
        exerted = (body.K[i][:, j] @ phi) / fixed**2 - body.M[i][:, j] @ phi
        seen = X[i].T @ exerted
        excess = w**4 * np.sum(seen**2 / (fixed**2 - w[:, None] ** 2), axis=1)
        d = excess / (2 * w) / (case.loss / 2 * w)
        row, column = _scales(case)
        strength = np.linalg.norm(X[case.outputs].T * row, axis=1) * np.linalg.norm(X.T @ case.inputs * column, axis=1)
        energy = strength**2 / w**3
        if not energy.any():
            return 0.0
        missed = 2 * d**2 / (4 + d**2) if body.n <= LARGE else d**2 / (1 + d**2)
        return float(np.sqrt(np.sum(energy * missed) / np.sum(energy)))

    @cached_property
    def static(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Static loads on the interface and inside the body, and the response to them, (n, i + l) each."""
        case, body = self.case, self.case.exact
        return case.loading, static_response(body.K, body.M, case.rigid, case.loading)

    @cached_property
    def balanced(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The same for loads that balance on the interface by themselves, which constraint modes hold."""
        case, body, i = self.case, self.case.exact, self.case.interface
        R = case.rigid[i] / np.maximum(np.linalg.norm(case.rigid, axis=0), 1e-300)
        free = la.null_space(R.T) if R.size else np.eye(i.size)
        F = case.loading[:, : i.size] @ free
        if case.loads is not None:
            F = np.hstack([F, case.loads])
        return F, static_response(body.K, body.M, case.rigid, F)


@dataclass(frozen=True)
class Outcome:
    """Figures of one mode set on one body.

    Parameters
    ----------
    columns : int
        Size of the basis.
    rigid : int
        Rigid-body modes found.
    error : float
        frf_error over the band, joined to the neighbour.
    limit : float or None
        What theory allows it, and what noise detunes peaks in the band by; None where theory promises nothing.
    completeness : float or None
        Share of the strain energy of static responses that is missed, worst load; None where nothing is claimed.
    mass, stiffness, strain : float
        Errors of orthonormality in M, in K, and of K on rigid modes.
    below : float
        By how much a frequency lies below the full body's, relative; negative if above.
    noise : float
        What arithmetic in double leaves of a strain energy, relative to it: the worst of abs(phi)^T abs(K) abs(phi)
        over w^2, in roundings.
    seconds : float
        To reduce and orthogonalise.
    """

    columns: int
    rigid: int
    error: float
    limit: float | None
    completeness: float | None
    mass: float
    stiffness: float
    strain: float
    below: float
    noise: float
    seconds: float


def reduce(case: Case, method: str) -> ModalComponent:
    """Orthonormal modes of a case by a mode set."""
    loading = case.neighbour if method in LOADED else None
    mode_set = reduction(method, case.cutoff_hz, loading=loading)
    return orthogonalise(mode_set.reduce(case.body, case.interface, case.loads))


def outcome(case: Case, method: str) -> Outcome:
    """Reduce, and measure against the full body."""
    started = time.perf_counter()
    modal = reduce(case, method)
    seconds = time.perf_counter() - started
    full, body, r = truth(case), case.exact, modal.rigid_count
    elastic = slice(r, r + modal.elastic_count)
    omega = modal.omega[elastic]
    mass, stiffness, strain = orthogonality(case.body.K, case.body.M, modal.Phi[:, :r], modal.Phi[:, elastic], omega)
    count = min(omega.size, full.omega.size)
    below = float((1 - omega[:count] / full.omega[:count]).max(initial=-np.inf))
    completeness = None
    if method in COMPLETE:
        F, u = full.static if method == "macneal-rubin" else full.balanced
        flexible = modal.Phi[:, r:]
        completeness = strain_error(body.K, u, flexible @ ((flexible.T @ F) / modal.stiffness[r:, None]))
    shapes = abs(modal.Phi[:, elastic])
    noise = 2.0**-53 * np.einsum("ij,ij->j", shapes, abs(case.body.K) @ shapes) / omega**2
    low, high = (2 * np.pi * f for f in case.band_hz)
    in_band = float(noise[(omega >= low) & (omega <= high)].max(initial=0.0))
    return Outcome(
        columns=modal.omega.size,
        rigid=r,
        error=_response_error(case, modal),
        limit=_limit(case, method, in_band),
        completeness=completeness,
        mass=mass,
        stiffness=stiffness,
        strain=strain,
        below=below,
        noise=float(noise.max(initial=0.0)),
        seconds=seconds,
    )


def _response_error(case: Case, modal: ModalComponent) -> float:
    full = truth(case)
    Phi, inputs, outputs = modal.Phi, case.inputs, case.outputs
    K, M = np.diag(modal.stiffness), np.diag(modal.mass)
    if case.neighbour is not None:
        face = Phi[case.interface]
        K, M = K + face.T @ case.neighbour.K @ face, M + face.T @ case.neighbour.M @ face
    rigid = np.eye(modal.omega.size)[:, : modal.rigid_count]
    if case.neighbour is None:
        H = _modal_response(modal, inputs, outputs, full.grid, case.loss)
    else:
        H = elastic_response(K, M, rigid, Phi.T @ inputs, Phi[outputs], full.grid, case.loss)
    return frf_error(full.grid, full.response, H, *_scales(case))


def _modal_response(
    modal: ModalComponent, B: NDArray[np.float64], rows: NDArray[np.int64], omega: NDArray[np.float64], loss: float
) -> NDArray[np.complex128]:
    Phi = modal.Phi[:, modal.rigid_count :]
    stiffness, mass = modal.stiffness[modal.rigid_count :], modal.mass[modal.rigid_count :]
    gain = 1 / (stiffness * (1 + 1j * loss) - omega[:, None] ** 2 * mass)
    return np.einsum("yk,fk,ku->fyu", Phi[rows], gain, Phi.T @ B, optimize=True)


def _scales(case: Case) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    component = case.body.dofs.component

    def channels(rows: NDArray[np.int64]) -> list[Channel]:
        return [Channel(str(row), (), "rotation" if component[row] > 3 else "translation") for row in rows]

    loads = 0 if case.loads is None else case.loads.shape[1]
    forces = channels(case.interface if case.probes is None else case.probes) + [
        Channel(f"load {k}", (), "combination") for k in range(loads)
    ]
    H, w = truth(case).response, truth(case).grid[:, None, None]
    R = orthonormal(case.rigid, case.joined()[1])
    return channel_scales(forces, channels(case.outputs), H, H - R[case.outputs] @ (R.T @ case.inputs) / w**2)


def _limit(case: Case, method: str, noise: float) -> float | None:
    allowed = case.limits.get(method, LIMITS.get(method))
    if method == "craig-bampton" and allowed is None:
        allowed = _FIRST_ORDER * truth(case).detuning + _STATIC
    # Mass alone makes the modes those of the company only if the neighbour adds no stiffness.
    exact = case.neighbour is None or not case.neighbour.K.any()
    if method == "benfield-hruda" or (method == "augmented" and exact):
        allowed = truth(case).truncation * (1 + _SLACK) + _SLACK
    # A frequency is off by half the noise; in half-widths, to first order, over the root of two.
    return None if allowed is None else allowed + (noise / case.loss / np.sqrt(2) if case.loss else 0.0)


@lru_cache(maxsize=4)
def truth(case: Case) -> Truth:
    """What the unreduced body does; solved once for all mode sets."""
    return Truth(case)
