"""A reduced model of the scene, and the mass products that compare its modes with those of the reference model."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import column_blocks, symmetric_product
from cmsreduce.model import Configuration, FEModel, Matrix, ModalComponent, Substructure, Values, varied
from cmsreduce.pipeline.store import once
from cmsreduce.pipeline.system.assembled import AssembledModel
from cmsreduce.pipeline.system.reference_model import ReferenceModel
from cmsreduce.pipeline.system.resonances import Number

__all__ = ["ReducedModel", "cross_orthogonality", "mass_products"]


class ReducedModel:
    """A reduced model of the scene with the modes of its coordinates.

    Parameters
    ----------
    assembled : AssembledModel
        The model.
    shapes : mapping of name to ModalComponent or None
        Modes whose amplitudes are the coordinates of each flexible body; None where these are its dofs.
    """

    def __init__(self, assembled: AssembledModel, shapes: Mapping[str, ModalComponent | None]) -> None:
        self.assembled, self.shapes = assembled, shapes
        self._wider: tuple[ReducedModel, Mapping[str, NDArray[np.int64]]] | None = None

    def narrowed(self, kept: Mapping[str, NDArray[np.int64]]) -> ReducedModel:
        """The model with some columns of some bodies alone; products of large matrices are taken from this one."""
        shapes = {name: None if name in kept else shape for name, shape in self.shapes.items()}
        found = ReducedModel(self.assembled.narrowed(kept), shapes)
        found._wider = self, kept
        return found

    def masses(self, reference: ReferenceModel, configuration: Configuration) -> dict[str, Matrix]:
        """Mass of each body between its coordinates in the reference model and in this model."""
        if self._wider is not None:
            wider, kept = self._wider
            found = wider.masses(reference, configuration)
            return {name: M[:, kept[name]] if name in kept else M for name, M in found.items()}
        return self._masses(reference, tuple(configuration.parameters.items()))

    @once
    def _masses(self, reference: ReferenceModel, values: tuple[tuple[str, float], ...]) -> dict[str, Matrix]:
        subs = reference.assembled.at(Configuration("", parameters=dict(values))).substructures
        return mass_products(reference.bodies, reference.shapes, self.shapes, subs, dict(values))


def mass_products(
    bodies: Mapping[str, FEModel],
    reference: Mapping[str, ModalComponent | None],
    reduced: Mapping[str, ModalComponent | None],
    substructures: Mapping[str, Substructure],
    values: Values | None = None,
) -> dict[str, Matrix]:
    """Mass of each body between its coordinates in two models, body: (m_i, r_i) array.

    Parameters
    ----------
    bodies : mapping of name to FEModel
        Mass matrices of the flexible bodies.
    reference, reduced : mapping of name to ModalComponent or None
        Modes whose amplitudes are the coordinates of either model; None where these are dofs.
    substructures : mapping of name to Substructure
        Bodies of the reference model; the rigid ones have their mass here.
    values : mapping of parameter to float, optional
        Values of the parameters, where they change the mass.
    """
    found: dict[str, Matrix] = {}
    for name, sub in substructures.items():
        if name not in bodies:
            found[name] = sub.M
            continue
        body = bodies[name]
        M, left, right = varied(body.M, body.terms, "M", values or {}), reference[name], reduced[name]
        assert isinstance(M, sp.csc_array)
        if right is None:
            found[name] = M if left is None else _times(M, left.Phi).T
        else:
            found[name] = _times(M, right.Phi, None if left is None else left.Phi)
    return found


def cross_orthogonality(
    reference: Mapping[str, NDArray[Number]], reduced: Mapping[str, NDArray[Number]], masses: Mapping[str, Matrix]
) -> NDArray[Number]:
    """Mass products of the shapes of two models (reference modes, reduced modes), those of the reference conjugated.

    Parameters
    ----------
    reference, reduced : mapping of body to (m_i, k) array
        Shapes of either model in each body's own coordinates, real or complex.
    masses : mapping of body to (m_i, r_i) array
        See `mass_products`.
    """
    cross = [np.asarray(reference[name].conj().T @ (M @ reduced[name])) for name, M in masses.items()]
    return np.asarray(np.sum(cross, axis=0))


def _times(M: sp.csc_array, Phi: NDArray[np.float64], Psi: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
    """M Phi of a symmetric matrix, or Psi^T M Phi."""
    product = symmetric_product(M)
    found = np.empty(((Phi if Psi is None else Psi.T).shape[0], Phi.shape[1]))
    for part in column_blocks(Phi.shape[1]):
        moved = product(Phi[:, part])
        found[:, part] = moved if Psi is None else Psi.T @ moved
    return found
