"""What parameters of the scene add to the matrices of a body: read, proven, in the rows and units of the body."""

from __future__ import annotations

from itertools import product
from typing import Literal

import numpy as np
import scipy.sparse as sp

from cmsreduce.config import Pipeline
from cmsreduce.errors import MatrixError
from cmsreduce.model import FEModel, ParameterTerm, Scene, Values, matrix_in_units
from cmsreduce.pipeline.bodies.modal_input import matrix_source
from cmsreduce.pipeline.bodies.stiffening import row_motions
from cmsreduce.read import read_parameter_matrix

__all__ = ["body_corners", "body_terms"]

# Corners of a box, or configurations of a list, at which a body's mode set is computed.
_MOST = 64


def body_terms(pipeline: Pipeline, body: FEModel, as_read: FEModel) -> tuple[tuple[ParameterTerm, ...], list[str]]:
    """Matrices that parameters add to a body, and remarks on facts that could not be proven.

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
        If a matrix is not in its file, or does not fit the body.
    """
    found, remarks = [], []
    letters: tuple[Literal["K", "M", "D"], ...] = ("K", "M", "D")
    for name, keys in pipeline.scene.parameters.items():
        unit = keys.unit.number_in(pipeline.units)
        for letter in letters:
            given = keys.matrices()[letter].get(body.name)
            if given is None:
                continue
            source, what = matrix_source(given), f"parameter '{name}'"
            A, remark = read_parameter_matrix(source, as_read, letter, what, grounded=keys.grounded)
            restated = matrix_in_units(A, as_read.dofs, letter, as_read.units, body.units)
            T = row_motions(body, as_read)
            _refuse_held(restated, T, body, f"{what}: {given.file.name}", as_read)
            term = sp.csc_array(T.T @ restated @ T)
            term = sp.csc_array((term + term.T) * (0.5 / unit**given.power))
            found.append(ParameterTerm(name, letter, term, given.power))
            if remark:
                remarks.append(remark)
    return tuple(found), remarks


def body_corners(terms: tuple[ParameterTerm, ...], scene: Scene, name: str) -> tuple[Values, ...]:
    """Values of the parameters of a body at the corners of their range, those without any effect left out.

    Values that fill a grid have the corners of its box; those of a list of configurations are all taken.

    Raises
    ------
    MatrixError
        If there are too many.
    """
    own = sorted({term.parameter for term in terms})
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
