"""Complex modes: roots of a damped system up to a frequency, and their shapes.

The roots of a small system are computed all at once by dense algebra. In a large system a basis grows until the roots
no longer change.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.blocks import dense, svd
from cmsreduce.linalg.eigen.damped_pencil import DampedPencil, PencilBasis, PencilRoots, hermitian_energies
from cmsreduce.linalg.eigen.pencil import elastic_and_massless
from cmsreduce.linalg.sparse import factorise

__all__ = ["ALL_ROOTS_LIMIT", "ComplexModes", "complex_modes"]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

ALL_ROOTS_LIMIT = 150
"""Largest number of coordinates at which dense algebra, of twice the size, is the quickest way to some roots."""
# A root is accepted when the residual would move it by less than this share of its decay rate.
_ACCURACY = 1e-7
# A decay rate below this share of the frequency counts as this share, so that the accuracy asked for stays finite.
_LEAST_DECAY = 1e-6
# A shape is added to the basis if its energy exceeds this share of the error that is allowed.
_WORTHWHILE = 0.1
# Rounds in which the basis grows: discrete dampers take 8, dampers that lock half of a body 12.
_ROUNDS = 20
# Roots are followed up to this share of the highest frequency: the first bases hold them too high. One beyond that
# frequency counts if this many times the change that its residual would cause brings it there.
_ABOVE, _MAY_MOVE = 1.25, 10.0
# Growth rate s of the load whose responses extend the basis, as a share of the highest frequency. A smaller rate suits
# light damping, a larger one damping forces that exceed the stiffness forces.
_GROWTH = 0.3
# Largest number of coordinates at which the roots of a gyroscopic system are found all at once.
_ALL_GYROSCOPIC = 400
# Coordinates on which the gyroscopic matrix of a larger system may act.
_MOST_LOADED = 1000
# Damping acts on a rigid motion if more than this share of its terms is left there; round-off leaves less.
_DAMPED = 1e-9


@dataclass(frozen=True, eq=False)
class ComplexModes:
    """Roots of a damped system up to a frequency; of each conjugate pair the one with Im s > 0.

    Parameters
    ----------
    s : (k,) complex128
        Roots -zeta w + i w sqrt(1 - zeta^2) in rad/s, by ascending w = |s|.
    X : (N, k) complex128
        Shapes, of unit length in M.
    Y : (N, k) complex128
        Left shapes, Y^T Z(s) = 0: those of symmetric matrices are X.
    real : (q,) float64
        Real roots of overdamped modes and of damped rigid motions, by ascending magnitude. For a large system only
        those as accurate as ``s``.
    """

    s: Complex
    X: Complex
    Y: Complex
    real: Real

    @property
    def omega(self) -> Real:
        """Natural frequencies |s| in rad/s."""
        return np.asarray(abs(self.s))

    @property
    def zeta(self) -> Real:
        """Damping ratios -Re s / |s|."""
        return np.asarray(-self.s.real / abs(self.s))


def complex_modes(
    pencil: DampedPencil,
    omega: float,
    rigid: Real,
    undamped: tuple[Real, Real] | None = None,
    rounding: float = 2.0**-53,
) -> ComplexModes:
    """All complex modes up to a frequency.

    Parameters
    ----------
    pencil : DampedPencil
        Dense or sparse.
    omega : float
        Highest frequency |s| in rad/s.
    rigid : (N, R) float64
        Motions on which K and loss vanish, orthonormal in M. Their roots s = 0 are left out. If D damps a motion, its
        other root is among the real ones.
    undamped : ((k,), (N, k)) float64, optional
        Elastic modes without damping up to a little above ``omega``: frequencies in rad/s and shapes orthonormal in M.
        The search starts from them. A system of at most `ALL_ROOTS_LIMIT` coordinates needs none.
    rounding : float
        Relative rounding of the entries of M, for a file of few digits.

    Raises
    ------
    MatrixError
        If the roots of a large system do not settle, or its undamped modes are not given.

    Notes
    -----
    The basis of a large system starts with undamped modes and the responses t = Z(a)^-1 D x, a > 0, to their damping
    forces. It grows by t = Z(a)^-1 r for the residual r = Z(s) x of each oscillating root. It is complete when
    r^H t / x^H (2 |s| M + D) x, the change of s that r would cause, is a small share of the decay rate. The matrices
    are symmetric, so that left and right shapes are equal and the error of s is of second order in the error of x. The
    first basis contains a part of every mode: with viscous damping |s|^2 = x^H K x / x^H M x, so
    that an oscillating shape consists mainly of rigid motions and undamped modes up to a little above |s|.

    Gyroscopic forces change this: they may bring a mode from far above the band into it, and left shapes are others
    than right ones. The first basis then also contains the responses to all loads of these forces, and grows by the
    residuals of both sides.
    """
    damped_rigid, coupled_rigid = _damped_rigid(pencil, rigid)
    few = _ALL_GYROSCOPIC if pencil.gyroscopic else ALL_ROOTS_LIMIT
    if few >= pencil.N:
        lam, V, N = elastic_and_massless(dense(pencil.K), dense(pencil.M), rigid, rounding)
        root_mass = np.append(1 / np.sqrt(lam), np.zeros(N.shape[1]))
        whole = PencilBasis(np.hstack([V / np.sqrt(lam), N]), root_mass, damped_rigid, coupled_rigid)
        found = pencil.roots(whole, omega)
    elif undamped is None:
        raise MatrixError(f"a system of {pencil.N} coordinates needs its undamped modes as a start for the damped ones")
    else:
        start = PencilBasis(undamped[1] / undamped[0], 1 / undamped[0], damped_rigid, coupled_rigid)
        found = _settled(pencil, start, rigid, omega)
    oscillates = found.s.imag > 0
    X, Y = (sides / np.sqrt(hermitian_energies(sides, pencil.M)) for sides in (found.X, found.Y))
    return ComplexModes(found.s[oscillates], X[:, oscillates], Y[:, oscillates], found.s[~oscillates].real)


def _damped_rigid(pencil: DampedPencil, rigid: Real) -> tuple[Real, Real]:
    """Rigid motions between which D is regular, and those that it may couple to elastic motion alone.

    The first are orthonormal in M, and orthogonal in D if it is symmetric. The symmetric part of D is semidefinite:
    what D takes to zero within the rigid motions, its transpose does, too.
    """
    if pencil.D is None or not rigid.shape[1]:
        return rigid[:, :0], rigid[:, :0]
    between = rigid.T @ (pencil.D @ rigid)
    if pencil.gyroscopic:
        _, drag, V = svd(between)
        Y = V.T
    else:
        drag, Y = la.eigh(between)
    motions = rigid @ Y
    size = spla.norm(sp.csc_array(pencil.D), 1) * np.sum(motions**2, axis=0)
    damped = drag > _DAMPED * size
    return motions[:, damped], motions[:, ~damped] if pencil.gyroscopic else rigid[:, :0]


def _settled(pencil: DampedPencil, start: PencilBasis, rigid: Real, omega: float) -> PencilRoots:
    """Roots in a basis that grows until all oscillating roots settle, and the real roots that have settled too."""
    solve, momentum = _solver(pencil, omega), np.asarray(pencil.M @ rigid)

    def elastic(shapes: Real) -> Real:
        shapes -= rigid @ (momentum.T @ shapes)
        return shapes

    start_KV = np.asarray(pencil.M @ start.V) / start.root_mass**2
    basis, KV, grown = start, start_KV, start.V[:, :0]
    more = grown if pencil.D is None else solve(_damping_loads(pencil, start, omega))
    if pencil.gyroscopic:
        extra = elastic(solve(_gyroscopic_loads(pencil, momentum, rigid)))
        energy = float(np.einsum("ij,ij->j", extra, pencil.K @ extra).max(initial=0.0)) or 1.0
        more = np.hstack([more, extra * np.sqrt(_WORTHWHILE / (_DAMPED * energy))])
    for _ in range(_ROUNDS):
        if more.shape[1]:
            for _ in range(2):
                more = elastic(more)
                more -= basis.V @ (KV.T @ more)
            grown, root_mass = _grown(pencil, grown, more)
            basis = start._replace(V=np.hstack([start.V, grown]), root_mass=np.append(start.root_mass, root_mass))
            KV = np.hstack([start_KV, np.asarray(pencil.K @ grown)])
        found = pencil.roots(basis, _ABOVE * omega)
        size, slope = np.abs(found.s), pencil.slope(found)
        allowed = _allowed(-found.s.real, size) * slope
        sides = [(pencil, found)]
        if pencil.gyroscopic:
            sides.append((pencil.transposed(), found.mirrored()))
        left, responses = np.zeros(found.s.size), []
        for of, roots in sides:
            r = of.residual(roots, KV)
            r -= momentum @ (rigid.T @ r)
            t = solve(np.hstack([r.real, r.imag]))
            t = t[:, : found.s.size] + 1j * t[:, found.s.size :]
            left = np.maximum(left, abs(np.einsum("ij,ij->j", r.conj(), t)))
            responses.append(t)
        settled = left <= allowed
        # A root above the band belongs to it if the residual may bring it there.
        within = size <= omega
        moving = ~settled & (found.s.imag > 0) & (size - _MAY_MOVE * left / slope <= omega)
        if not moving.any():
            return found.chosen(settled & within)
        more = np.hstack([t[:, moving] / np.sqrt(allowed[moving]) for t in responses])
        more = np.hstack([more.real, more.imag])
    worst = int(np.argmax(np.where(moving, left / allowed, 0.0)))
    raise MatrixError(
        f"the complex mode at {abs(found.s[worst]) / 2 / np.pi:.6g} Hz did not settle in {_ROUNDS} rounds: it is known "
        f"to {_ACCURACY * left[worst] / allowed[worst]:.1e} of its decay rate. Check the damping matrix for entries "
        "much larger than stiffness over frequency"
    )


def _allowed(decay: Real, omega: Real) -> Real:
    """Error of a root that is accepted, by its decay rate and its size."""
    return np.asarray(_ACCURACY * np.maximum(decay, _LEAST_DECAY * omega))


def _damping_loads(pencil: DampedPencil, start: PencilBasis, omega: float) -> Real:
    """Loads (N, k) that damping exerts in the first basis, divided by the root of the error that is allowed.

    A strong damper overdamps all of a first basis that moves it, so that no oscillating root is left there whose
    residual shows the shapes that hold the damper still.
    """
    w = np.append(np.full(start.damped_rigid.shape[1], omega), 1 / start.root_mass)
    motions = np.hstack([start.damped_rigid, start.V / start.root_mass])
    force = dense(pencil.D @ motions)
    # What holds a strong damper still has light damping: its error counts no less than at critical damping.
    drag = np.clip(np.einsum("ij,ij->j", motions, force), 0.0, 2 * w)
    return np.asarray(force * w / np.sqrt(_allowed(drag / 2, w) * (2 * w + drag)))


def _gyroscopic_loads(pencil: DampedPencil, momentum: Real, rigid: Real) -> Real:
    """Loads (N, k) that span what the skew part of D exerts, without those that move the rigid motions."""
    assert pencil.D is not None
    D = sp.csc_array(pencil.D)
    skew = sp.csc_array(D - D.T)
    rows = np.unique(skew.indices)
    if rows.size > _MOST_LOADED:
        raise MatrixError(
            f"the gyroscopic matrix of a system of {pencil.N} coordinates acts on {rows.size} of them, and roots that "
            f"it brings into the band are found for certain up to {_MOST_LOADED}: reduce the body first"
        )
    U, size, _ = svd(skew[rows][:, rows].toarray())
    U = U[:, size > _DAMPED * size[0]]
    loads = np.zeros((pencil.N, U.shape[1]))
    loads[rows] = U
    return np.asarray(loads - momentum @ (rigid.T @ loads))


def _grown(pencil: DampedPencil, grown: Real, more: Real) -> tuple[Real, Real]:
    """Shapes with the worthwhile part of ``more``, orthonormal in K, orthogonal in M, and roots of their masses."""
    gain, Y = la.eigh(more.T @ (pencil.K @ more))
    worth = gain > _WORTHWHILE
    grown = np.hstack([grown, more @ (Y[:, worth] / np.sqrt(gain[worth]))])
    mass, Y = la.eigh(grown.T @ (pencil.M @ grown))
    return grown @ Y, np.sqrt(np.maximum(mass, 0.0))


def _solver(pencil: DampedPencil, omega: float) -> Callable[[Real], Real]:
    """Solve with Z(s) for a positive s, where Z is real and definite for any damping and rigid motions."""
    s = _GROWTH * omega
    Z = pencil.K + s**2 * pencil.M
    if pencil.D is not None:
        # Without gyroscopic forces: any definite matrix serves.
        Z = Z + 0.5 * s * (pencil.D + pencil.D.T)
    if sp.issparse(Z):
        return factorise(sp.csc_array(Z), what="the system under a growing load")
    factor = la.cho_factor(np.asarray(Z))
    return lambda b: np.asarray(la.cho_solve(factor, b))
