"""Shapes for a flexibility model: the modes below a frequency, then what its own residuals ask for.

A block Krylov method deflated by the modes: one real factor of K turns the residuals of many frequencies into shapes,
of which as many are taken as carry a residual that counts. Real arithmetic, no factorisation at any frequency.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.dynamic_stiffness import DynamicStiffness
from cmsreduce.linalg.eigenpairs import modes_below
from cmsreduce.linalg.factorise import factorise
from cmsreduce.linalg.flexibility import ElasticFlexibility, Solve
from cmsreduce.linalg.flexibility_model import FlexibilityModel, frequency_blocks
from cmsreduce.linalg.flexibility_shapes import FlexibilityShapes

__all__ = ["RESPONSE_TOLERANCE", "UnconfirmedError", "adaptive_flexibility"]

RESPONSE_TOLERANCE = 1e-6
"""Largest error of a receptance, relative to the driving-point receptances of its two ends (``Evaluation.size``)."""

# Modes are computed to this many times the highest frequency: what is left then answers at most 1/(1 - 1/1.25^2) = 2.8
# times as much as in statics.
_BEYOND = 1.25
# Shapes are sought until the bound is this share of the tolerance where it is looked at, so that it holds between.
_SHARE = 0.1
# Frequencies looked at, and as many resonances again.
_LOOKED_AT = 150
# Rounds of shapes. Each divides the error of what lies far above the band by many; four or five are usual.
_ROUNDS = 12
# Directions of the residuals that carry less than this share of what is allowed are left out.
_COUNTS = 0.1
# More shapes than this share of the dofs save nothing.
_MOST = 0.5
# A frequency is clear of resonances where stiffness and inertia of every mode leave this share of its stiffness:
# nearer to one without damping, rounding of the matrices is what a comparison would show.
_CLEAR = 1e-3

Real = NDArray[np.float64]


class UnconfirmedError(MatrixError):
    """A model whose error, measured, is more than its bound allows."""


def adaptive_flexibility(
    Z: DynamicStiffness,
    load: Real,
    omega: Real,
    *,
    rigid: Real,
    braked: bool = False,
    rounding: float = 2.0**-53,
    tolerance: float = RESPONSE_TOLERANCE,
) -> FlexibilityModel:
    """Build a flexibility model that is good at given frequencies, and between them as far as its own bound says.

    Parameters
    ----------
    Z : DynamicStiffness
        Matrices; stiffness, damping and loss positive semidefinite.
    load : (n, p) float64
        Loads, in balance with rigid motion unless that is ``braked``.
    omega : (f,) float64
        Circular frequencies in rad/s.
    rigid : (n, r) float64
        Rigid-body modes, in any scaling.
    braked : bool
        Whether D acts on rigid motion, which is then a part of the response.
    rounding : float
        Relative rounding of the entries of K and M, where they come from a file.
    tolerance : float
        Error to stay below.

    Returns
    -------
    FlexibilityModel
        The best one found; its own bound says where it stays below the tolerance.

    Raises
    ------
    MatrixError
        If stiffness is not definite on elastic motion, or its modes do not converge.
    UnconfirmedError
        If the error of the model, measured at two frequencies, is more than the tolerance.

    Notes
    -----
    The model is confirmed at two frequencies: by solving the body there, or, where damping leaves the modes uncoupled
    so that the bound is one strictly, from the residual r of the body's own matrices, r^T (K - w^2 M)^-1 r.

    Source: Galerkin models from residuals, Hetmaniuk, Tezaur and Farhat, Int. J. Numer. Meth. Engng 90 (2012),
    1636-1662; deflation by modes and correction by static solves, MacNeal, Computers & Structures 1 (1971), 581-601.
    """
    if rigid.shape[1]:
        L = la.cholesky(rigid.T @ (Z.M @ rigid), lower=True)
        rigid = la.solve_triangular(L, rigid.T, lower=True).T
    flexibility: Solve = ElasticFlexibility(Z.K, Z.M, rigid) if rigid.shape[1] else factorise(Z.K)
    ceiling = _BEYOND * float(omega.max())
    w, Phi = modes_below(Z.K, Z.M, ceiling, rigid=rigid, solve=flexibility, rounding=rounding)
    shapes = FlexibilityShapes(Z, load, flexibility, rigid if braked else rigid[:, :0])
    shapes.add(Phi)
    grid = _looked_at(omega, w)
    model = shapes.model(ceiling)
    for _ in range(_ROUNDS):
        wanted = _wanted(model, grid, _SHARE * tolerance)
        if not wanted.shape[1] or shapes.every.shape[1] + wanted.shape[1] > _MOST * Z.n:
            break
        shapes.add(shapes.toward(wanted))
        model = shapes.model(ceiling)
    _confirm(Z, load, shapes, model, omega, tolerance)
    return model


def _confirm(
    Z: DynamicStiffness, load: Real, shapes: FlexibilityShapes, model: FlexibilityModel, omega: Real, tolerance: float
) -> None:
    """Measure the error with the body's own matrices: where its bound is largest, and at one frequency by chance."""
    detuned = model.detuning(omega)
    clear = omega[detuned >= min(_CLEAR, detuned.max())]
    error = np.concatenate([model(clear[part]).error for part in frequency_blocks(clear.size, model.bytes_each)])
    clear, error = clear[error <= tolerance], error[error <= tolerance]
    if not clear.size:
        return
    chance = np.random.default_rng(clear.size).integers(clear.size)
    for w in np.unique(clear[[int(error.argmax()), int(chance)]]):
        found = model(np.array([w]))
        if model.coupled:
            difference = Z.flexibility(load, w) - found.Y[0]
        else:
            r = load - Z.at(w) @ (shapes.every @ (shapes.turn @ model.amplitudes(np.array([w]))[0]))
            undamped = factorise(sp.csc_array(Z.K - w**2 * Z.M), definite=False, what="the dynamic stiffness")
            difference = r.T @ (undamped(r.real) + 1j * undamped(r.imag))
        measured = float((abs(difference) / np.sqrt(np.outer(found.size[0], found.size[0]))).max())
        if not measured <= tolerance:
            raise UnconfirmedError(
                f"the flexibility model errs by {measured:.1e} at {w / 2 / np.pi:.6g} Hz where its bound is "
                f"{found.error[0]:.1e}"
            )


def _looked_at(omega: Real, resonances: Real) -> Real:
    """Frequencies over the whole grid, and the resonances within it."""
    grid = np.unique(omega)
    inside = resonances[(resonances > grid[0]) & (resonances < grid[-1])]
    picked = [
        values[np.unique(np.linspace(0, values.size - 1, _LOOKED_AT).astype(int))]
        for values in (grid, inside)
        if values.size
    ]
    return np.unique(np.concatenate(picked))


def _wanted(model: FlexibilityModel, omega: Real, allowed: float) -> Real:
    """Directions (q, d) of the residuals that count, over all frequencies whose error is more than is allowed."""
    omega = omega[~model.hits(omega)]
    q = model.residual.load.shape[0]
    gathered = np.zeros((q, q))
    for part in frequency_blocks(omega.size, model.bytes_each):
        found = model(omega[part])
        late = found.error > allowed
        weight = model.amplification(omega[part])[late, None] / (allowed * found.size[late])
        r = found.residual[late] * np.sqrt(weight)[:, None, :]
        r = np.moveaxis(r, 1, 0).reshape(q, -1)
        gathered += r.real @ r.real.T + r.imag @ r.imag.T
    if not q:
        return gathered
    weight, directions = la.eigh(gathered)
    return np.asarray(directions[:, weight > _COUNTS**2])
