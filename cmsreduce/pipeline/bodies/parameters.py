"""Matrices that parameters and gyroscopic forces add to those of a body: read, proven, in its rows and units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.config import MatrixFile, ParameterMatrix, Pipeline, WheelKeys
from cmsreduce.errors import MatrixError, SceneError
from cmsreduce.mechanics import Determined
from cmsreduce.model import FEModel, Letter, ParameterTerm, Scene, Values, cross_matrix, matrix_in_units
from cmsreduce.pipeline.bodies.modal_input import matrix_source
from cmsreduce.pipeline.bodies.stiffening import row_motions
from cmsreduce.read import read_parameter_matrix

__all__ = ["body_corners", "body_terms", "refuse_undetermined"]

# Share of a momentum that the rounding of a frame's axes leaves about an axis.
_STRAY = 1e-9
# Corners of a box, or configurations of a list, at which a body's mode set is computed.
_MOST = 64


def body_terms(pipeline: Pipeline, body: FEModel, as_read: FEModel) -> tuple[tuple[ParameterTerm, ...], list[str]]:
    """Matrices that parameters add to a body and gyroscopic ones, and remarks on facts that could not be proven.

    Parameters
    ----------
    pipeline : Pipeline
        With its parameters.
    body : FEModel
        n dofs, in the scene's units, with its ties, and with undetermined motions held.
    as_read : FEModel
        The body as its files have it.

    Raises
    ------
    CmsReduceError
        If a matrix is not in its file, or does not fit the body, or a wheel is at a node that does not turn.
    """
    part, found, remarks = pipeline.components[body.name], list[ParameterTerm](), list[str]()

    def add(
        of: str,
        letter: Letter,
        given: MatrixFile,
        what: str,
        unit: float,
        power: int,
        grounded: bool,
        *values: float,
    ) -> None:
        factors = [(value / unit) ** power for value in values]
        source = matrix_source(given)
        whole = isinstance(given, ParameterMatrix) and given.whole
        A, remark = read_parameter_matrix(
            source, as_read, letter, what, grounded=grounded, factors=factors, whole=whole
        )
        restated = matrix_in_units(A, as_read.dofs, letter, as_read.units, body.units)
        T = row_motions(body, as_read)
        _refuse_held(restated, T, body, f"{what}: {given.file.name}", as_read)
        term = sp.csc_array(T.T @ restated @ T)
        term = sp.csc_array((term - term.T if letter == "G" else term + term.T) * (0.5 / unit**power))
        found.append(ParameterTerm(of, letter, term, power))
        if remark:
            remarks.append(remark)

    if part.gyroscopic is not None:
        add("", "G", part.gyroscopic, "the body", 1.0, 0, False)
    for name, keys in pipeline.scene.parameters.items():
        unit = keys.unit.number_in(pipeline.units)
        values = [value.number_in(pipeline.units) for value in keys.values]
        for letter, matrices in keys.matrices().items():
            if (given := matrices.get(body.name)) is not None:
                add(name, letter, given, f"parameter '{name}'", unit, given.power, keys.grounded, *values)
    for label, wheel in part.wheels.items():
        momentum = wheel.vector(pipeline.units)
        if momentum.any():
            found.append(ParameterTerm("", "G", _wheel(body, label, wheel, momentum), 0))
        for name, keys in pipeline.scene.parameters.items():
            if f"{body.name}.{label}" in keys.wheels:
                unit = keys.unit.number_in(pipeline.units)
                found.append(ParameterTerm(name, "G", _wheel(body, label, wheel, wheel.direction / unit), 1))
    return _merged(found, body.name), remarks


def _merged(terms: list[ParameterTerm], body: str) -> tuple[ParameterTerm, ...]:
    """One term for each parameter and letter: the matrix of a rotor and each of its wheels turn by one parameter."""
    found = dict[tuple[str, Letter], ParameterTerm]()
    for term in terms:
        same = found.setdefault((term.parameter, term.letter), term)
        if same.power != term.power:
            raise SceneError(
                f"body '{body}': parameter '{term.parameter}' adds a gyroscopic matrix by its power {same.power} and "
                f"the momentum of a wheel by its power {term.power}; give the wheel a parameter of its own"
            )
        if same is not term:
            summed = sp.csc_array(same.matrix + term.matrix)
            found[term.parameter, term.letter] = replace(same, matrix=summed)
    return tuple(found.values())


def _wheel(body: FEModel, wheel: str, keys: WheelKeys, momentum: NDArray[np.float64]) -> sp.csc_array:
    """Gyroscopic matrix (n, n) of a wheel: the moment w x h that holds it as its node turns at w."""
    where, label = f"body '{body.name}', wheel '{wheel}'", keys.at
    face = body.interfaces[label] if isinstance(label, str) else None
    if face is not None and face.node.size != 1:
        raise SceneError(f"{where}: the interface '{label}' has {face.node.size} nodes: give one of them, `at: NODE`")
    node = int(face.node[0]) if face is not None else int(str(label))
    at = -1 if body.nodes is None else int(body.nodes.index(node)[0])
    if body.nodes is None or at < 0:
        raise SceneError(f"{where}: the body has no node {node} in its geometry")
    known = body.recovery
    rows = known.dofs.rows(node, np.arange(4, 7))
    axes = body.nodes.frame[at]
    G = axes @ -cross_matrix(momentum) @ axes.T
    needed = abs(G).max(axis=1) > _STRAY * abs(G).max()
    if body.constrained is not None:
        # A rotation that is held does not turn the wheel.
        needed &= (rows >= 0) | (body.constrained.rows(node, np.arange(4, 7)) < 0)
    if (rows[needed] < 0).any():
        raise SceneError(
            f"{where}: node {node} has no rotation about an axis that its momentum resists; take a node with "
            "rotations, or an interface that is tied to the mesh (`tie`)"
        )
    T = known.T[rows[needed]]
    return sp.csc_array(T.T @ sp.csr_array(G[np.ix_(needed, needed)]) @ T)


def body_corners(terms: tuple[ParameterTerm, ...], scene: Scene, name: str) -> tuple[Values, ...]:
    """Values of the parameters of a body at the corners of their range, those without any effect left out.

    Values that fill a grid have the corners of its box; those of a list of configurations are all taken.

    Raises
    ------
    MatrixError
        If there are too many.
    """
    # Gyroscopic forces change no undamped mode and no static shape.
    own = sorted({term.parameter for term in terms if not term.gyroscopic})
    if not own:
        return ()
    sampled = list(dict.fromkeys(tuple(each.parameters.get(one, 0.0) for one in own) for each in scene.configurations))
    axes = [sorted(set(values)) for values in zip(*sampled, strict=True)]
    if len(sampled) == np.prod([len(axis) for axis in axes]):
        sampled = list(product(*({axis[0]: None, axis[-1]: None} for axis in axes)))
    if len(sampled) > _MOST:
        raise MatrixError(
            f"component '{name}': its parameters have {len(sampled)} corners, and a mode set is computed at each (at "
            f"most {_MOST}); vary fewer parameters of this body at once"
        )
    return tuple(dict(zip(own, values, strict=True)) for values in sampled if any(values))


def refuse_undetermined(terms: Sequence[ParameterTerm], determined: Determined) -> None:
    """Refuse a matrix on a motion that nothing else determines, where springs hold it to the rest of the body.

    Raises
    ------
    MatrixError
        Names a dof on which it acts.
    """
    # Motions that are held to the ground have no rows any more.
    body = determined.body
    if not terms or not determined.motions.shape[1] or not set(determined.held) & set(body.dofs.labels):
        return
    N = sp.diags_array(determined.moved.astype(float)) @ determined.motions
    for term in terms:
        A = sp.csr_array(term.matrix)
        force = abs(A @ N).max(axis=1).toarray()
        at = int(force.argmax())
        if force[at] > _STRAY * float((abs(A) @ abs(N)).max()):
            what = f"parameter '{term.parameter}'" if term.parameter else "its gyroscopic matrix"
            raise MatrixError(
                f"body '{body.name}': {what} acts on {body.dofs.labels[at]} in a motion that has neither stiffness nor "
                "mass without it and so is held; give the motion a small stiffness or mass in the body's own matrices"
            )


def _refuse_held(A: sp.csc_array, T: sp.csr_array, body: FEModel, what: str, as_read: FEModel) -> None:
    """Refuse a matrix on dofs that are held because nothing else determines their motion."""
    moves = np.diff(T.indptr) > 0
    size = np.asarray(abs(A).sum(axis=1)).ravel()
    lost = np.flatnonzero(~moves & (size > 0))
    if lost.size:
        raise MatrixError(
            f"body '{body.name}': {what} acts on {as_read.dofs.labels[lost[0]]}, which has neither stiffness nor mass "
            "without the parameter and so is held; give the dof a small stiffness or mass in the body's own matrices"
        )
