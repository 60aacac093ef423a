"""Rational Krylov shapes: static shapes, and responses of the assembled scene at chosen frequencies."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ConfigError
from cmsreduce.linalg.blocks import side_by_side
from cmsreduce.model import FEModel, ModeBlock, ModeSet
from cmsreduce.reduce.basis import Basis
from cmsreduce.reduce.reduction import Reduction
from cmsreduce.reduce.static_shapes import Loads, elastic_solve

__all__ = ["SceneKrylov"]

Array = NDArray[np.float64]


class SceneKrylov(Reduction):
    """Rigid motions, static shapes of all loads and motions in the scene, and responses of the assembled scene.

    Parameters
    ----------
    cutoff_hz : float
        Not used: there are no normal modes.
    responses : (n, k) float64, optional
        Elastic shapes of the body, orthonormal in K, static ones included.

    Notes
    -----
    Source: rational Krylov spaces by Galerkin projection, Gugercin, Antoulas and Beattie, SIAM J. Matrix Anal. Appl. 30
    (2008), 609-638; theory section "Scene shapes of large bodies".
    """

    method: ClassVar[str] = "scene"

    def __init__(self, cutoff_hz: float, responses: Array | None = None) -> None:
        super().__init__(cutoff_hz)
        self.responses = responses

    def basis(self, body: FEModel, interface: NDArray[np.int64], rigid: Array, loads: Array) -> Basis:
        """Shapes of the mode set, rigid modes first; see `Reduction.basis`.

        Raises
        ------
        ConfigError
            Without a scene.
        """
        if self.responses is None:
            raise ConfigError(
                f"reduce: method {self.method} makes shapes from the responses of a scene: it needs a pipeline with "
                "actuators and sensors; for a body alone use craig-bampton or macneal-rubin"
            )
        Phi, (rigid, shapes) = side_by_side(body.n, [(None, rigid), (None, self.responses)])
        modes = ModeSet.of(
            self.method,
            [
                ModeBlock("rigid", rigid, [f"rigid {k + 1}" for k in range(rigid.shape[1])]),
                ModeBlock("response", shapes, [str(k + 1) for k in range(shapes.shape[1])]),
            ],
            Phi=Phi,
        )
        inertia = Loads(shapes.shape[1], lambda part: body.M @ shapes[:, part])
        return Basis(modes, elastic_solve(body, rigid, interface), body.K, (shapes,), inertia, np.arange(body.n))
