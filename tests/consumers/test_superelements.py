"""Superelements that NASTRAN reduced, in Exudyn: their frequencies, free and held at their boundary grids."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.read import InterfaceSpec, read_body, superelement_matrices
from tests.consumers.bodies import modes, npz

pytest.importorskip("exudyn")
from tests.consumers.exudyn_scene import ExudynScene

pytestmark = [pytest.mark.exudyn, pytest.mark.shared]

GRIDS = (3, 11, 19, 27)


@pytest.mark.parametrize("held", [(), GRIDS], ids=["free", "held"])
def test_frequencies_of_a_superelement(shared_data: Path, tmp_path: Path, held: tuple[int, ...]) -> None:
    stem = shared_data / "nas2cam" / "outboard"
    found = superelement_matrices(stem.with_suffix(".op4"))
    faces = {"boundary": InterfaceSpec(GRIDS)}
    geometry = stem.with_suffix(".asm")
    body = read_body("outboard", stiffness=found.stiffness, mass=found.mass, geometry=geometry, interfaces=faces)
    scene = ExudynScene()
    made = scene.add(npz(tmp_path, modes(body)))
    for grid in held:
        place = body.nodes.xyz[body.nodes.id == grid][0]
        scene.ball(scene.ground_at(place), scene.marker_at(made, GRIDS.index(grid)))
    free = ~(np.isin(body.dofs.node, held) & (body.dofs.component <= 3) & (body.dofs.component > 0))
    K, M = (A.toarray()[np.ix_(free, free)] for A in (body.K, body.M))
    squares = la.eigh(K, M, eigvals_only=True)[0 if held else 6 :]
    seen = scene.frequencies()[-squares.size :]
    np.testing.assert_allclose(seen, np.sqrt(squares), rtol=1e-6)
