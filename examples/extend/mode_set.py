"""A mode set of your own: static shapes of the interface, the responses to their inertia, and so on (docs/extend.md).

It needs no eigenproblem (Wilson, Yuan and Dickens, 1982). Its place would be cmsreduce/reduce/krylov.py.
"""

from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

import cmsreduce as cms
from cmsreduce.model import FEModel, ModeBlock, ModeSet
from cmsreduce.reduce.basis import Basis
from cmsreduce.reduce.reduction import Reduction
from cmsreduce.reduce.static_shapes import Loads, elastic_solve, residual_shapes, unit_loads

__all__ = ["Krylov"]

Array = NDArray[np.float64]


class Krylov(Reduction):
    """Static shapes of the interface, and the responses to their inertia in place of normal modes."""

    method: ClassVar[str] = "krylov"
    generations: ClassVar[int] = 4

    def basis(self, body: FEModel, interface: NDArray[np.int64], rigid: Array, loads: Array) -> Basis:
        """See `Reduction.basis`."""
        solve = elastic_solve(body, rigid)
        shapes, forces = np.empty((body.n, 0)), Loads.of(unit_loads(body.n, interface, loads))
        labels: list[str] = []
        for generation in range(self.generations):
            new, load = residual_shapes(solve, body.K, forces, shapes)
            shapes, forces = np.hstack([shapes, new]), Loads.of(body.M @ new)
            labels += [f"generation {generation}, load {number + 1}" for number in load]
        names = [f"rigid {number + 1}" for number in range(rigid.shape[1])]
        modes = ModeSet.of(self.method, [ModeBlock("rigid", rigid, names), ModeBlock("residual", shapes, labels)])
        return Basis(modes, solve, body.K, (shapes,), forces, np.arange(body.n))


SAMPLE = Path(__file__).parents[2] / "sample_models" / "galileo"


def test_first_modes_of_the_stator() -> None:
    """Frequencies of any basis lie above the exact ones; this one converges from the lowest mode on."""
    body = cms.read_body(
        "stator",
        stiffness=(f"{SAMPLE}/stator.op4", "KAA"),
        mass=(f"{SAMPLE}/stator.op4", "MAA"),
        geometry=f"{SAMPLE}/stator.bdf",
        interfaces={"bearing": 2001},
    )
    stator = cms.orthogonalise(Krylov(cutoff_hz=20).reduce(body))
    exact = cms.orthogonalise(cms.MacNealRubin(cutoff_hz=100).reduce(body))
    found, true = (each.frequencies_hz[each.elastic][:3] for each in (stator, exact))
    assert stator.rigid_count == exact.rigid_count == 6
    assert stator.basis_size < exact.basis_size
    assert (found > true * (1 - 1e-9)).all()
    assert abs(found / true - 1).max() < 1e-3
