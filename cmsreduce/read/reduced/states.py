"""Bodies in state space: {A, B, C} that is proven to be a mechanical body, and {M, D, K, B, C}."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import NoReturn

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError, MatrixError, ReadError
from cmsreduce.linalg.blocks import svd
from cmsreduce.model import Source, Units
from cmsreduce.read.files import sha256_of
from cmsreduce.read.geometry import read_geometry
from cmsreduce.read.matrix import matrix_names, read_matrix, read_rows
from cmsreduce.read.reduced.modal_body import ModalBody
from cmsreduce.read.reduced.modes import with_rigid_motions

__all__ = ["read_states"]

_LETTERS = ("A", "B", "C", "D", "K", "M")
_MOST_STATES = 5000
# Relative to the matrices compared: eigenvectors of models in double precision keep eight digits or more.
_PROVEN = 1e-6
# Relative to the largest eigenvalue: a smaller one is none, and those closer together are one.
_NONE, _TOGETHER = 1e-11, 1e-9
# Relative to the inverse mass of the ports: less of it in a mode is round-off of eigenvectors.
_UNSEEN = 1e-12
# Imaginary part of an eigenvalue, relative to the largest: less is round-off of a double one with a single eigenvector,
# such as of a rigid motion and its rate, which the root of round-off splits.
_STILL = 5e-8
# Of modal matrices made with eigenvectors of states.
_DIGITS = 1e-10
_HELP = (
    "A body has A = [0 I; -M\\K -M\\D], B = [0; M\\L], C = [L' 0] for displacements or [0 L'] for their rates, where "
    "column i of L is the dof that input i drives and output i measures"
)

Array = NDArray[np.float64]
Matrices = Mapping[str, Array]


@dataclass(frozen=True, eq=False)
class _Modes:
    """Coordinates of unit mass: squares of frequencies, damping matrix, and the motion of the ports."""

    lam: Array
    D: Array
    shapes: Array
    unseen: int = 0


def read_states(
    name: str, path: Path, struct: str | None, *, geometry: Path, rows: Path, units: Units, grounded: bool = False
) -> ModalBody:
    r"""Read a body in state space, whose inputs are forces on some dofs and whose outputs are the motions of these.

    Parameters
    ----------
    name : str
        Name of the component.
    path : Path
        File with A, B and C, or with M, K, B and perhaps D and C.
    struct : str, optional
        Name of the struct that holds them.
    geometry : Path
        Deck or mesh with the nodes.
    rows : Path
        Dof of each input: a list of node.component.
    units : Units
        Unit system of the file.
    grounded : bool
        True if the body was held to the ground.

    Returns
    -------
    ModalBody
        Coordinates of unit modal mass.

    Raises
    ------
    ReadError
        If the file cannot be read, or lacks a matrix.
    DofMapError
        If the list of dofs does not fit the inputs.
    MatrixError
        If the model is no mechanical body: the message has the figure that says so.

    Notes
    -----
    A mechanical body with forces u on the dofs that y measures is symmetric and reciprocal: in coordinates of unit
    mass, its stiffness and damping are symmetric, and B is the transpose of C. In companion form, the eigenvectors of
    M\K give these coordinates, scaled so that drive and motion of each are equal; any damping matrix is allowed.
    In another form, each residue of the transfer function must be phi phi^T / (2 i w) with a real phi, which holds for
    proportional damping only.
    """
    found = _matrices(path, struct)
    dofs, shape = read_rows(rows), read_geometry(geometry)
    ports = found["B"].shape[1]
    if len(dofs) != ports:
        raise DofMapError(f"body '{name}': {rows} names {len(dofs)} dofs, but B of {path} has {ports} inputs")
    lost = shape.nodes.index(dofs.node) < 0
    if lost.any():
        raise DofMapError(f"body '{name}': node {dofs.node[lost.argmax()]} of {rows} is not in {geometry}")
    prove = _Proof(name, path)
    modes = _of_second_order(prove, found) if "K" in found else _of_first_order(prove, found)
    remarks = (
        (f"{name}: {modes.unseen} modes of {path} are neither driven nor seen, and are left out",)
        if modes.unseen
        else ()
    )
    modal = ModalBody(
        name=name,
        K=np.diag(modes.lam),
        M=np.eye(modes.lam.size),
        D=modes.D,
        dofs=dofs,
        shapes=modes.shapes,
        nodes=shape.nodes,
        units=units,
        rounding=_DIGITS,
        sources=tuple(
            Source(str(each), sha256_of(each), what)
            for each, what in ((path, "states"), (rows, "row order"), (geometry, "geometry"))
        ),
        remarks=remarks,
    )
    return with_rigid_motions(modal, None, grounded)


def _matrices(path: Path, struct: str | None) -> dict[str, Array]:
    prefix = f"{struct}." if struct else ""
    there = [str(info.name) for info in matrix_names(path)]
    names = {letter: prefix + letter for letter in _LETTERS if prefix + letter in there}
    lacking = [letter for letter in ("K", "M", "B") if letter not in names]
    if lacking and "A" in names:
        lacking = [letter for letter in "BC" if letter not in names]
        names = {letter: names[letter] for letter in "ABCD" if letter in names}
    elif not lacking:
        names.pop("A", None)
    if lacking:
        known = ", ".join(filter(None, there)) or "no named matrix"
        raise ReadError(
            f"{path}: {prefix}{lacking[0]} is not in it (it holds {known}); a body in state space has A, B and C, "
            "or M, K and B; name the struct that holds them: `states: {file: FILE, matrix: STRUCT}`"
        )
    sparse = {letter: read_matrix(path, each, rectangular=True).A for letter, each in names.items()}
    for letter, matrix in sparse.items():
        if max(matrix.shape) > _MOST_STATES:
            raise ReadError(
                f"{path}: {letter} is {matrix.shape[0]} x {matrix.shape[1]}; a body in state space has {_MOST_STATES} "
                "states at most; give its sparse matrices as `stiffness` and `mass`"
            )
        if not np.isfinite(matrix.data).all():
            raise ReadError(f"{path}: {letter} holds a number that is not finite")
    dense = {letter: np.asarray(matrix.toarray(), dtype=np.float64) for letter, matrix in sparse.items()}
    n = dense["K" if "K" in dense else "A"].shape[0]
    ports = dense["B"].shape[1]
    feedthrough = (n, n) if "K" in dense else (ports, ports)
    wanted = {**dict.fromkeys("AKM", (n, n)), "B": (n, ports), "C": (ports, n), "D": feedthrough}
    for letter, full in dense.items():
        if full.shape != wanted[letter]:
            raise ReadError(
                f"{path}: {letter} is {full.shape[0]} x {full.shape[1]}, where {wanted[letter][0]} x "
                f"{wanted[letter][1]} fits: each input has an output, the motion of the same dof"
            )
    return dense


@dataclass(frozen=True)
class _Proof:
    """Refuses a model that is no body."""

    name: str
    path: Path

    def __call__(self, figure: float, what: str) -> None:
        """Refuse if a relative figure is above what rounding explains."""
        if not figure <= _PROVEN:
            self.refuse(f"{what} ({figure:.2g})")

    def refuse(self, what: str) -> NoReturn:
        """Refuse the model."""
        raise MatrixError(f"body '{self.name}': {self.path} is no mechanical body: {what}. {_HELP}")

    def equal(self, A: Array, B: Array, what: str) -> None:
        """Refuse if two matrices differ."""
        size = max(np.linalg.norm(A), np.linalg.norm(B))
        self(float(np.linalg.norm(A - B) / size) if size else 0.0, f"{what} differ, relative to their size")


def _of_second_order(prove: _Proof, found: Matrices) -> _Modes:
    """Modes of M, K and perhaps D, with the ports of B."""
    K, M, B = found["K"], found["M"], found["B"]
    D = found.get("D", np.zeros_like(K))
    for letter, A in (("K", K), ("M", M), ("D", D)):
        prove.equal(A, A.T, f"{letter} and its transpose")
    if "C" in found:
        prove.equal(found["C"], B.T, "C and the transpose of B")
    if np.linalg.eigvalsh((M + M.T) / 2)[0] <= 0:
        prove.refuse("its mass matrix M is not positive definite, and has no inverse")
    lam, V = la.eigh((K + K.T) / 2, (M + M.T) / 2)
    _check_stable(prove, lam)
    return _Modes(_without_rounding(lam), V.T @ ((D + D.T) / 2) @ V, B.T @ V)


def _of_first_order(prove: _Proof, found: Matrices) -> _Modes:
    A, B, C = found["A"], found["B"], found["C"]
    if "D" in found and found["D"].any():
        gain = abs(found["D"]).max()
        raise MatrixError(
            f"body '{prove.name}': D of {prove.path} is not zero (largest entry {gain:.3g}): outputs that follow "
            "inputs at once are accelerations, or the flexibility of modes that were cut off. Measure displacements or "
            "their rates, and keep those modes as states"
        )
    h = A.shape[0] // 2
    size = abs(A).max(initial=0.0)
    companion = (
        2 * h == A.shape[0]
        and not A[:h, :h].any()
        and abs(A[:h, h:] - np.eye(h)).max(initial=0.0) <= _NONE
        and abs(B[:h]).max(initial=0.0) <= _NONE * abs(B).max(initial=0.0)
    )
    if not size:
        prove.refuse("A is zero")
    return _of_companion(prove, A, B, C) if companion else _of_residues(prove, A, B, C)


def _of_companion(prove: _Proof, A: Array, B: Array, C: Array) -> _Modes:
    """Coordinates of unit mass of displacements and their rates."""
    h = A.shape[0] // 2
    K, D, drive = -A[h:, :h], -A[h:, h:], B[h:]
    still, rates = abs(C[:, :h]).max(initial=0.0), abs(C[:, h:]).max(initial=0.0)
    prove(min(still, rates) / max(still, rates, np.finfo(float).tiny), "outputs mix displacements and rates")
    seen = C[:, :h] if still > rates else C[:, h:]
    if abs(K - K.T).max(initial=0.0) <= _NONE * abs(K).max(initial=0.0):
        lam, V = la.eigh((K + K.T) / 2)
        back = V.T
    else:
        lam, V = la.eig(K)
        top = abs(lam).max(initial=0.0)
        prove(float(abs(lam.imag).max(initial=0.0) / top) if top else 0.0, "squares of its frequencies are complex")
        order = np.argsort(lam.real)
        lam, V = lam.real[order], V.real[:, order]
        # Rigid motions of a body have as many eigenvectors as there are. Round-off gives a repeated eigenvalue a
        # complex pair, whose real parts are one vector.
        for part in _clusters(lam, _TOGETHER * top):
            if (several := part.stop - part.start) > 1:
                V[:, part] = svd(K - lam[part].mean() * np.eye(h))[2][-several:].T
        if (left := float(abs(K @ V - V * lam).max(initial=0.0))) > _TOGETHER * top:
            prove.refuse(f"an eigenvalue lacks eigenvectors (forces of {left / top:.2g} are left)")
        prove(float(np.finfo(float).eps * np.linalg.cond(V)), "its modes are dependent")
        back = np.linalg.inv(V)
    _check_stable(prove, lam)
    gains = _gains(prove, seen @ drive)
    into, out = back @ (drive / gains), (seen.T / gains).T @ V
    T = np.zeros((h, h))
    for part in _clusters(lam, _TOGETHER * abs(lam).max(initial=0.0)):
        phi = _factor(prove, out[:, part] @ into[part])
        block = np.linalg.lstsq(out[:, part], phi, rcond=None)[0]
        # What no output sees has any scale.
        rest = la.null_space(block.T)[:, : block.shape[0] - block.shape[1]]
        T[part, part] = np.hstack([block, rest]) if block.shape[1] else np.eye(block.shape[0])
    V, back = V @ T, la.solve(T, back)
    shapes = (seen.T / gains).T @ V
    prove.equal(back @ (drive / gains), shapes.T, "drive and motion of its modes")
    damping = back @ D @ V
    prove.equal(damping, damping.T, "its damping matrix, for unit modal mass, and its transpose")
    return _Modes(_without_rounding(lam), (damping + damping.T) / 2, shapes * gains[:, None])


def _of_residues(prove: _Proof, A: Array, B: Array, C: Array) -> _Modes:
    """Modes of proportional damping, by the residues of the transfer function."""
    poles, X = la.eig(A)
    top = abs(poles).max(initial=0.0)
    flat = int((abs(poles.imag) <= _STILL * top).sum())
    if flat:
        raise MatrixError(
            f"body '{prove.name}': {prove.path} is no body of second order as it stands: {flat} of its "
            f"{poles.size} eigenvalues are real, as of rigid motions or of no vibration. {_HELP}, in which rigid "
            "motions are allowed"
        )
    weights = la.solve(X, B.astype(np.complex128))
    upper = np.flatnonzero(poles.imag > 0)
    upper = upper[np.argsort(abs(poles[upper]), kind="stable")]
    markov = C @ B
    rates = np.linalg.norm(markov) > _PROVEN * np.linalg.norm(C) * np.linalg.norm(B)
    residues = np.einsum("pk,kq->kpq", C @ X[:, upper], weights[upper])
    if rates:
        residues = residues / poles[upper, None, None]
    scaled = 2j * poles[upper].imag[:, None, None] * residues
    gains = _gains(prove, scaled.sum(axis=0).real)
    scaled = scaled / np.outer(gains, gains)
    lam, zeta, shapes = [], [], []
    for part in _clusters(abs(poles[upper]), _TOGETHER * top):
        S = scaled[part].sum(axis=0)
        hz = abs(poles[upper[part]][0]) / (2 * np.pi)
        complexity = float(np.linalg.norm(S.imag))
        prove(complexity, f"the mode of {hz:g} Hz is complex, so that its damping is not proportional")
        phi = _factor(prove, S.real)
        pole = poles[upper[part]].mean()
        lam += [abs(pole) ** 2] * phi.shape[1]
        zeta += [-2 * pole.real] * phi.shape[1]
        shapes.append(phi)
    return _Modes(np.array(lam), np.diag(zeta), gains[:, None] * np.hstack(shapes), upper.size - len(lam))


def _gains(prove: _Proof, inverse: Array) -> Array:
    """Root of the inverse mass at each port (p,), which makes ports of unlike units comparable."""
    own = inverse.diagonal()
    top = abs(inverse).max(initial=0.0)
    prove(float(max(-own.min(), 0.0) / top) if top else 0.0, "a port moves against its force, as with a negative mass")
    still = np.flatnonzero(own <= _UNSEEN * top)
    if still.size:
        prove.refuse(f"output {still[0] + 1} does not answer the force of input {still[0] + 1}")
    return np.asarray(np.sqrt(own))


def _factor(prove: _Proof, S: Array) -> Array:
    """Shapes phi of S = phi phi^T (p, k) at ports of unit inverse mass, without those that nothing drives or sees."""
    prove(float(np.linalg.norm(S - S.T)), "force at one port and motion at another are not reciprocal, in a mode")
    s, U = la.eigh((S + S.T) / 2)
    prove(float(max(-s[0], 0.0)), "a port moves against its force, as with a negative mass")
    kept = s > _UNSEEN
    return np.asarray(U[:, kept] * np.sqrt(s[kept]))


def _clusters(values: Array, apart: float) -> Iterator[slice]:
    """Runs of ascending values that are closer together than a distance."""
    breaks = np.flatnonzero(np.diff(values) > apart) + 1
    edges = [0, *breaks.tolist(), values.size]
    yield from (slice(a, b) for a, b in pairwise(edges))


def _check_stable(prove: _Proof, lam: Array) -> None:
    top = abs(lam).max(initial=0.0)
    prove(float(max(-lam.min(initial=0.0), 0.0) / top) if top else 0.0, "its stiffness is negative in some motion")


def _without_rounding(lam: Array) -> Array:
    """Squares of frequencies, in which rigid motions have exactly zero."""
    return np.where(lam <= _NONE * lam.max(initial=0.0), 0.0, lam)
