"""Orthonormal modes of a reduced body (theory section 3)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import DampingError, MatrixError
from cmsreduce.linalg.blocks import (
    absolute_parts,
    column_blocks,
    combine,
    combined,
    congruence,
    one_norm,
    row_blocks,
    skew_congruence,
)
from cmsreduce.linalg.eigen import UndeterminedError, elastic_and_massless, refine
from cmsreduce.mechanics import refuse_gain, refuse_overdamped, without_drag
from cmsreduce.model import (
    FEModel,
    ModalComponent,
    ModeKind,
    ParameterTerm,
    ReducedComponent,
    Values,
    error_of_sum,
    parameter_label,
    unresisted,
    varied,
)

__all__ = ["ORTHOGONAL", "STATIC", "at_parameters", "orthogonalise", "orthogonality_errors"]

Array = NDArray[np.float64]

ORTHOGONAL = 1e-10
"""Modes are orthonormal to this share of their norms in M and in K."""
STATIC = "static: carries no mass"
"""Reason why a static mode is kept."""

# Stiffness between a rigid and an elastic mode that is taken out, as `orthogonality_errors` measures it: less may be
# rounding of K, which would bend an exact motion; more, also than ten roundings of relative places, is shown.
_COUPLED, _WRONG, _PLACES = 0.5 * ORTHOGONAL, 100 * ORTHOGONAL, 10.0
# Strain energy of a static mode below this many roundings of its terms over all dofs: shapes repeat each other.
_REPEATS = 100.0
# Shapes that cancel leave this share as a displacement: the root of the share in an energy.
_NO_MOTION = 1e-7


def orthogonalise(component: ReducedComponent) -> ModalComponent:
    """Solve the reduced pencil, so that M becomes the identity and K the squared frequencies.

    Shapes that carry no mass have no frequency; they are kept as static modes, which follow their load without delay.

    Parameters
    ----------
    component : ReducedComponent
        m columns, r rigid modes.

    Returns
    -------
    ModalComponent
        Rigid modes first, r of them with frequency exactly zero, then elastic ones by frequency, then static ones.

    Raises
    ------
    MatrixError
        If the basis holds the same shape twice, or a motion with neither mass nor stiffness, or if a damping matrix
        gives energy to a motion of the modes.
    DampingError
        If a damping matrix, or Rayleigh factors, leave no mode that oscillates.
    """
    modes, body, r = component.modes, component.body, component.rigid.shape[1]
    try:
        lam, X, N = elastic_and_massless(component.K, component.M, component.rigid, body.rounding)
    except UndeterminedError as error:
        raise MatrixError(_undetermined(component, error.shape)) from None
    _refuse_repeats(component, N)
    Phi = combined(modes.Phi, np.hstack([component.rigid, X, N]))
    lam = _polish(body, Phi, r, N.shape[1], lam)
    D = None if body.D is None else without_drag(body.D, Phi, congruence(body.D, Phi), r, body.rounding)
    w, s, m = np.sqrt(lam), N.shape[1], modes.m
    zeta = body.damping.ratios(w) if D is None else D.diagonal()[r : m - s] / (2 * w)
    omega = np.concatenate([np.zeros(r), w, np.full(s, np.inf)])
    if D is not None:
        refuse_gain(body, Phi, D, omega)
    if D is None or not _vibrates(D[r : m - s, r : m - s], w):
        refuse_overdamped(body, w, zeta)
    kind, source = _origin(component, X, N)
    rank, condition = _rank_and_condition(component)
    return ModalComponent(
        body=body,
        method=modes.method,
        Phi=Phi,
        omega=omega,
        zeta=np.concatenate([np.zeros(r), zeta, np.zeros(s)]),
        rigid_count=r,
        D=D,
        kind=kind,
        source_hz=source,
        sigma=np.full(m, np.nan),
        spacing=np.full(m, np.nan),
        why=("rigid body",) * r + ("all modes kept",) * w.size + (STATIC,) * s,
        basis_size=m,
        basis_rank=rank,
        basis_condition=condition,
        static_count=s,
        certificate=modes.certificate,
        terms=_modal_terms(body, Phi, r),
    )


def _vibrates(D: Array, w: Array) -> bool:
    """True if a motion W^-1/2 y of coupled modes (e, e) oscillates: y^T W y times y^T W^-1 y is at least (y^T y)^2."""
    size = np.sqrt(w)
    return bool(np.linalg.eigvalsh(D / np.outer(size, size)).min(initial=np.inf) < 2)


def _modal_terms(body: FEModel, Phi: Array, r: int) -> tuple[ParameterTerm, ...]:
    """Parts that parameters add to the modal matrices; exactly nothing on rigid motions that they do not resist."""
    found = []
    for term in body.terms:
        A = skew_congruence(term.matrix, Phi) if term.gyroscopic else congruence(term.matrix, Phi)
        if term.letter != "M" and r:
            still = unresisted([term.matrix], Phi[:, :r])
            P = np.eye(Phi.shape[1])
            P[:r, :r] = 0.0 if still.shape[1] == r else np.eye(r) - still @ still.T
            A = P @ A @ P
        found.append(replace(term, matrix=np.asarray((A - A.T if term.gyroscopic else A + A.T) / 2)))
    return tuple(found)


def at_parameters(component: ModalComponent, values: Values) -> ModalComponent:
    """The same shapes as orthonormal modes of the body at some values of its parameters.

    Parameters
    ----------
    component : ModalComponent
        Modes of the body without parameters.
    values : mapping of parameter to float

    Returns
    -------
    ModalComponent
        Without parameters; the component itself where they add nothing. Its damping is a matrix: that of the body's law
        in the modes without parameters, and what the parameters add. Gyroscopic matrices stay beside it.

    Raises
    ------
    DampingError
        If the damping is structural, which has no such matrix.
    MatrixError
        If the mass or the stiffness is not positive there.
    """
    acting = [term for term in component.terms if term.factor(values)]
    gyroscopic = [term for term in acting if term.gyroscopic]
    if not any(term.letter in "MDK" for term in acting):
        return replace(component, terms=tuple(_fixed(term, values) for term in gyroscopic))
    label = f"body '{component.name}' with {parameter_label(values)}"
    if component.damping.structural is not None:
        raise DampingError(f"{label}: structural damping is a share of the stiffness, which a parameter changes")
    m, r = component.omega.size, component.rigid_count
    M, K, D = (
        np.asarray(varied(np.diag(diagonal), acting, letter, values))
        for letter, diagonal in (("M", component.mass), ("K", component.stiffness), ("D", component.viscous))
    )
    if component.D is not None:
        D = D - np.diag(component.viscous) + component.D
    body = component.body.undamped_at(values)
    rigid = np.eye(m, r) @ unresisted([term.matrix for term in acting if term.letter == "K"], np.eye(m, r))
    try:
        if rigid.shape[1]:
            weight = np.linalg.cholesky(rigid.T @ M @ rigid)
            rigid = np.asarray(np.linalg.solve(weight, rigid.T).T, dtype=np.float64)
        lam, X, N = elastic_and_massless(K, M, rigid, body.rounding)
    except (np.linalg.LinAlgError, UndeterminedError):
        raise MatrixError(f"{label}: its mass is not positive; look at the values") from None
    if lam.min(initial=np.inf) <= 0:
        raise MatrixError(f"{label}: its stiffness is not positive: it buckles; no mode can be written")
    change = np.hstack([rigid, X, N])
    most = abs(change).argmax(axis=0)
    r, s = rigid.shape[1], N.shape[1]
    D = change.T @ D @ change
    w = np.sqrt(lam)
    return replace(
        component,
        body=body,
        Phi=combined(component.Phi, change),
        omega=np.concatenate([np.zeros(r), w, np.full(s, np.inf)]),
        zeta=np.concatenate([np.zeros(r), D.diagonal()[r : m - s] / (2 * w), np.zeros(s)]),
        rigid_count=r,
        D=D,
        kind=("rigid",) * r + tuple(component.kind[k] for k in most[r:]),
        source_hz=np.concatenate([np.zeros(r), component.source_hz[most[r:]]]),
        sigma=np.full(m, np.nan),
        spacing=np.full(m, np.nan),
        why=("rigid body",) * r + tuple(component.why[k] for k in most[r:]),
        rankings={},
        cluster=None,
        static_count=s,
        neglected_count=0,
        terms=tuple(_fixed(term, values).over(change) for term in gyroscopic),
    )


def _fixed(term: ParameterTerm, values: Values) -> ParameterTerm:
    """A term at some values of the parameters, as one that does not depend on them."""
    return replace(term, parameter="", matrix=term.factor(values) * term.matrix, power=0)


def orthogonality_errors(component: ModalComponent) -> tuple[float, float]:
    """Largest errors of the modes' mass and stiffness matrices, which should be diagonal.

    Returns
    -------
    mass : float
        Error of Phi^T M Phi, relative to the modes' norms in M, which are 1. A static mode, which has no kinetic
        energy, is measured against the absolute parts of it, with the largest entry of M on dofs without mass.
    stiffness : float
        Error of Phi^T K Phi, relative to the modes' norms in K, which are w, and 1 for a static mode. Rigid modes,
        whose w is zero, are measured against the highest frequency: their strain energy is the rounding of the matrix.

    Notes
    -----
    Energy is a sum of parts abs(phi)^T abs(K) abs(phi) that cancel, and the rounding of the parts is no property of the
    modes. Where this is more than `ORTHOGONAL` of the energy, as in soft modes between stiff parts, it replaces the
    energy in the norm, so that a value beyond `ORTHOGONAL` is more than rounding.
    """
    Phi, body, static = component.Phi, component.body, slice(component.elastic.stop, None)
    inertia = absolute_parts(body.M, Phi)
    g = np.maximum(component.mass, error_of_sum(body.rounding) / ORTHOGONAL * inertia)
    w = component.stiffness.copy()
    if component.elastic_count:
        w[: component.rigid_count] = w[component.elastic][-1]
    w = np.maximum(w, error_of_sum(body.stiffness_rounding) / ORTHOGONAL * absolute_parts(body.K, Phi))
    bare = np.where(body.M.diagonal() > 0, 0.0, abs(body.M).max())
    g[static] = inertia[static] + np.concatenate(
        [bare @ Phi[:, static][:, part] ** 2 for part in column_blocks(component.static_count)] or [np.empty(0)]
    )
    mass = abs(congruence(body.M, Phi) - np.diag(component.mass))
    stiffness = abs(congruence(body.K, Phi) - np.diag(component.stiffness))
    # The mass of a mode that is treated statically was left out on purpose: it is no error.
    judged = np.delete(np.arange(g.size), component.neglected)
    mass, g = mass[np.ix_(judged, judged)], g[judged]
    return _largest(mass, np.sqrt(np.outer(g, g))), _largest(stiffness, np.sqrt(np.outer(w, w)))


def _rank_and_condition(component: ReducedComponent) -> tuple[int, float]:
    """Rank and condition of a basis, by the energies of its shapes."""
    K, M, Phi = component.K, component.M, component.modes.Phi
    if not K.shape[0]:
        return 0, 1.0
    # Shapes that are all rigid motion have a stiffness of rounding, which is none. Most others exceed a rough bound of
    # it, which takes no product.
    parts = one_norm(component.body.K) * np.einsum("ij,ij->", Phi, Phi)
    bare = K.trace() / (_REPEATS * np.finfo(float).eps)
    strained = bare > parts or bare > absolute_parts(component.body.K, Phi).sum()
    strain = K / K.trace() if strained else np.zeros_like(K)
    energy = strain + M / (M.trace() or 1.0)
    own = energy.diagonal()
    size = np.sqrt(np.where(own > 0, own, 1.0))
    values = np.linalg.eigvalsh(energy / np.outer(size, size))
    # Squares of the singular values: their rounding hides what is smaller.
    least = K.shape[0] * np.finfo(float).eps * values[-1]
    rank = int(np.count_nonzero(values > least))
    return rank, float(np.sqrt(values[-1] / values[0])) if values[0] > least else np.inf


def _polish(body: FEModel, Phi: Array, r: int, s: int, lam: Array) -> Array:
    """Make modes orthonormal once more over all dofs, in place, and return their squared frequencies.

    A basis of shapes that are nearly alike, such as constraint modes of neighbouring nodes, loses digits when its
    columns are combined; over the modes themselves the pencil is nearly diagonal, and one step restores them.
    """
    rigid, elastic, static = np.split(Phi, [r, Phi.shape[1] - s], axis=1)
    # Rigid motions of a stiffness alone leave the sum of its rounding at the few dofs where they are given. In a
    # Rayleigh-Ritz step it loads no elastic mode. Few digits leave much of a soft mode: one step does not restore it.
    loads, norm, steps = elastic.T @ (body.K @ rigid), np.append(np.full(r, lam.max(initial=0.0)), lam), 1
    if (abs(loads) > _COUPLED * np.sqrt(np.outer(lam, norm[:r]))).any():
        hidden = error_of_sum(body.stiffness_rounding) / ORTHOGONAL
        norm = np.maximum(norm, hidden * absolute_parts(body.K, Phi[:, : norm.size]))
        places = 0.0 if body.nodes is None else _PLACES * body.nodes.relative_rounding
        if _COUPLED < (abs(loads) / np.sqrt(np.outer(norm[r:], norm[:r]))).max() < max(_WRONG, places):
            steps = 3
    for _ in range(2):
        if steps > 1:
            rigid -= elastic @ (elastic.T @ (body.K @ rigid) / lam[:, None])
        combine(rigid, np.linalg.inv(np.linalg.cholesky(congruence(body.M, rigid))).T)
        combine(static, 1.5 * np.eye(s) - 0.5 * congruence(body.K, static))
        momentum = body.M @ rigid
        for part in column_blocks(lam.size):
            elastic[:, part] -= rigid @ (momentum.T @ elastic[:, part])
            if s:
                elastic[:, part] -= static @ (static.T @ (body.K @ elastic[:, part]))
    for _ in range(steps):
        lam, X = refine(congruence(body.K, elastic), congruence(body.M, elastic), lam, np.eye(lam.size))
        combine(elastic, X[:, np.argsort(lam, kind="stable")])
        lam = np.sort(lam)
    return lam


def _refuse_repeats(component: ReducedComponent, N: Array) -> None:
    """Refuse massless shapes that are combinations of the basis with a sum of zero."""
    energy = np.einsum("ij,ij->j", N, component.K @ N)
    K, Phi, parts = component.body.K, component.modes.Phi, np.empty(N.shape[1])
    for part in column_blocks(N.shape[1]):
        size = np.zeros((Phi.shape[0], part.stop - part.start))
        for rows in row_blocks(*Phi.shape):
            size[rows] = abs(Phi[rows]) @ abs(N[:, part])
        parts[part] = absolute_parts(K, size)
    nothing = energy <= _REPEATS * float(np.finfo(float).eps) * parts
    if nothing.any():
        raise MatrixError(_undetermined(component, N[:, int(np.argmax(nothing))]))


def _undetermined(component: ReducedComponent, shape: Array) -> str:
    """Message about a basis that holds a shape with neither mass nor stiffness."""
    modes, dofs = component.modes, component.body.dofs
    size = np.array([abs(column).max(initial=0.0) for column in modes.Phi.T]) * abs(shape)
    moved = abs(modes.Phi @ shape)
    if moved.max(initial=0.0) <= _NO_MOTION * size.max(initial=0.0):
        column = int(np.argmax(size))
        return (
            f"body '{component.name}': the {modes.m} shapes of its {modes.method} basis repeat each other, above all "
            f"{modes.kind[column]} shape {modes.label[column]}; leave one of them out"
        )
    return (
        f"body '{component.name}': a motion, above all of dof {dofs.labels[int(np.argmax(moved))]}, has neither mass "
        "nor stiffness, so that nothing determines it. Hold the dof by a constraint, or take its row out"
    )


def _origin(component: ReducedComponent, X: Array, N: Array) -> tuple[tuple[ModeKind, ...], Array]:
    """Kind and source frequency of the basis shapes with most of each mode's energy: kinetic, or strain if static."""
    modes, r, s = component.modes, component.rigid.shape[1], N.shape[1]
    share = np.hstack([abs(X * (component.M @ X)), abs(N * (component.K @ N))])
    names = sorted(set(modes.kind))
    by_kind = np.array([share[[k == name for k in modes.kind]].sum(axis=0) for name in names])
    kind = ["rigid"] * r + [names[k] for k in by_kind.argmax(axis=0)]
    source = np.concatenate([np.zeros(r), modes.source_hz[share[:, : X.shape[1]].argmax(axis=0)], np.full(s, np.nan)])
    return tuple(kind), source


def _largest(error: Array, scale: Array) -> float:
    """Largest relative error; zero where there is nothing to be relative to."""
    return float(np.divide(error, scale, out=np.zeros_like(error), where=scale > 0).max(initial=0.0))
